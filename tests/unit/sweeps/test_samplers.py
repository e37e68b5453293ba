"""Samplers of studies: a user's own, and what is wrong with one."""

import numpy as np
import pytest
import typer
from scipy.stats import qmc

from asrsim.cli.app import app
from asrsim.errors import InputError
from asrsim.sweeps import Table, make_study, sweep
from asrsim.sweeps.samplers import SAMPLERS, Saltelli, Sampler
from asrsim.sweeps.store import sealed
from asrsim.sweeps.study import read_study
from support.paths import ROOT

pytest.importorskip("pyarrow")


def test_a_plugin_s_sampler_places_the_draws(tiny, asrsim_command):
    plugin = ROOT / "examples" / "plugins" / "my_lab.py"
    done = asrsim_command(
        "sweep", tiny.scenario, "--over", "arm.mass=uniform(0.2, 0.6)", "--sampler", "halton", "--samples", "4", "--seed", "5",
        "--set", "duration=0.02", "--plugin", plugin, "--out", "study", "--workers", "1", "--no-plot", "-q",
    )  # fmt: skip
    assert done.code == 0, done.err
    drawn = qmc.Halton(1, rng=5).random(4)[:, 0]
    np.testing.assert_allclose(Table("study")["arm.mass"], 0.2 + 0.4 * drawn, rtol=1e-12)


def test_a_study_file_runs_with_its_own_sampler(tiny, asrsim_command):
    (tiny.folder / "study.yaml").write_text(
        f"scenario: {tiny.scenario.name}\nover: {{arm.mass: 'uniform(0.2, 0.6)'}}\nset: {{duration: 0.02}}\n"
        "sampler: lhs\nsamples: 2\n"
    )
    done = asrsim_command("sweep", "study.yaml", "--out", "study", "--workers", "1", "--no-plot", "-q")
    assert done.code == 0, done.err
    assert Table("study").study.sampler == "lhs"
    done = asrsim_command("sweep", "study.yaml", "--out", "again", "--seed", "0")
    assert done.code == 1
    assert "seed is valid with a scenario only" in done.err


def test_the_folder_of_an_earlier_study_is_read_by_its_old_names(tiny, tmp_path):
    varied = {"imperfections.commands.elbow.delay": "uniform(0.0, 0.01)"}
    table = sweep(tiny.scenario, varied, overrides={"duration": 0.02}, samples=2, out=tmp_path, workers=1)
    manifest = {**table.manifest, "study": dict(table.manifest["study"])}
    manifest["study"]["design"] = manifest["study"].pop("sampler")
    (tmp_path / "study.json").write_text(sealed(manifest))
    assert Table(tmp_path).study.sampler == "random"


def test_points_that_are_no_numbers_are_refused(tiny):
    class Words(Sampler):
        title = "words"

        def points(self, samples, dimensions, seed):
            return [["low"] * dimensions] * samples

    SAMPLERS.add("words", Words())
    study = make_study(tiny.scenario, {"arm.mass": "uniform(0.2, 0.6)"}, samples=4, sampler="words")
    with pytest.raises(InputError, match=r"'words' must return an array of numbers.*shape \(4, 1\).*low"):
        _ = study.table


@pytest.mark.parametrize("points", [np.zeros((3, 1)), np.full((4, 1), 1.5), np.full((4, 1), np.nan)])
def test_points_outside_the_cube_or_of_another_number_are_refused(tiny, points):
    class Wrong(Sampler):
        title = "wrong"

        def points(self, samples, dimensions, seed):
            return points

    SAMPLERS.add("wrong", Wrong())
    study = make_study(tiny.scenario, {"arm.mass": "uniform(0.2, 0.6)"}, samples=4, sampler="wrong")
    with pytest.raises(InputError, match=r"'wrong' must return an array of numbers from 0 to 1 of shape \(4, 1\)"):
        _ = study.table


def test_a_sampler_must_place_the_same_points_for_the_same_seed(tiny):
    class Fresh(Sampler):
        title = "fresh"

        def points(self, samples, dimensions, seed):
            return np.random.default_rng().random((samples, dimensions))

    SAMPLERS.add("fresh", Fresh())
    study = make_study(tiny.scenario, {"arm.mass": "uniform(0.2, 0.6)"}, samples=4, sampler="fresh")
    with pytest.raises(InputError, match="'fresh' must return the same points for the same seed"):
        _ = study.table


def test_the_help_names_every_sampler():
    sampler = next(one for one in typer.main.get_command(app).get_command(None, "sweep").params if one.name == "sampler")
    assert [name for name in SAMPLERS if name not in sampler.help] == []


@pytest.mark.parametrize("blocks", [False, True])
def test_a_finished_study_is_shown_without_the_sampler_that_placed_its_draws(tiny, asrsim_command, tmp_path, blocks):
    """Only a study in blocks has Sobol indices, which the sampler must confirm."""
    plugin = tmp_path / "my_sampler.py"
    plugin.write_text(
        "import numpy as np\nfrom asrsim.sweeps.samplers import SAMPLERS, Sampler\n\n\n"
        f"class Even(Sampler):\n    title, blocks = 'even', {blocks}\n\n    def points(self, samples, dimensions, seed):\n"
        "        first = np.linspace(0.1, 0.9, samples)[:, None]\n"
        f"        return {'np.concatenate([first, 0.5 * first, 0.5 * first])' if blocks else 'first'}\n\n\n"
        "SAMPLERS.add('even', Even())\n"
    )
    before = SAMPLERS.state()
    done = asrsim_command(
        "sweep", tiny.scenario, "--over", "arm.mass=uniform(0.2, 0.6)", "--sampler", "even", "--samples", "2",
        "--set", "duration=0.2", "--plugin", plugin, "--out", "study", "--workers", "1", "--no-plot", "-q",
    )  # fmt: skip
    assert done.code == 0, done.err
    SAMPLERS.put(before)
    shown = asrsim_command("sweep", "study", "--no-plot")
    assert shown.code == 0, shown.err
    assert ("6 of 6 runs" if blocks else "2 of 2 runs") in shown.out
    assert ("the sampler 'even' is not known here" in shown.out) == blocks
    assert ("my_sampler.py: name your copy with --plugin" in shown.out) == blocks


@pytest.mark.parametrize(
    ("samples", "wrong", "said"),
    [
        (2, "draws[4:6] = draws[6:8]", r"rows 4 to 5 must be A with column 0 of B; row 4 must be \[.*\] and is \["),
        (2, "draws[7, 0] += 1e-9", "rows 6 to 7 must be A with column 1 of B; row 7 must be"),
        (2, "draws[2:4, 1] = draws[:2, 1]", "the blocks A and B must be drawn separately, but their columns 1 are equal"),
        (64, "draws[64:128, 1] = draws[192:, 1] = (draws[:64, 1] + 0.3) % 1.0", "column 1 of B follows from column 1 of A"),
    ],
)
def test_draws_that_are_not_the_blocks_that_a_sampler_states_are_refused_with_the_first_wrong_row(tiny, samples, wrong, said):
    """Sobol indices of other draws would be wrong numbers."""

    class Mixed(Saltelli):
        title = "mixed"

        def points(self, samples, dimensions, seed):
            draws = super().points(samples, dimensions, seed)
            exec(wrong)
            return draws

    SAMPLERS.add("mixed", Mixed())
    varied = {"arm.mass": "uniform(0.2, 0.6)", "elbow.damping": "uniform(0.1, 0.2)"}
    study = make_study(tiny.scenario, varied, samples=samples, sampler="mixed")
    with pytest.raises(InputError, match=f"'mixed' states `blocks = True`: .*{said}"):
        _ = study.table


OWN = """
import numpy as np
from asrsim.sweeps.samplers import SAMPLERS, Sampler

class Even(Sampler):
    title = "even"

    def points(self, samples, dimensions, seed):
        return np.full((samples, dimensions), 0.5)

SAMPLERS.add("fresh_even", Even())
"""


@pytest.mark.parametrize("listed", [False, True])
def test_a_study_of_the_library_finds_the_sampler_of_its_plugins(tiny, listed):
    """Also a study file, which may list the plugin, too."""
    plugin = tiny.folder / "my_even.py"
    plugin.write_text(OWN)
    keys = f"scenario: {tiny.scenario.name}\nover: {{arm.mass: 'uniform(0.2, 0.6)'}}\nsampler: fresh_even\nsamples: 2\n"
    (tiny.folder / "study.yaml").write_text(keys + ("plugins: [my_even.py]\n" if listed else ""))
    study = read_study(tiny.folder / "study.yaml", [plugin])
    np.testing.assert_allclose(study.table, 0.4)
    SAMPLERS.forget_files()
    study = make_study(tiny.scenario, {"arm.mass": "uniform(0.2, 0.6)"}, sampler="fresh_even", plugins=[plugin])
    np.testing.assert_allclose(study.table, 0.4)
