"""Options of the command line reach the functions of the library."""

import json
from importlib import import_module

import pytest

from asrsim.designs import design
from asrsim.errors import InputError
from asrsim.renamed import NAMES, OldKeyWarning
from asrsim.sweeps.study import read_study

SHARED = {"variant": "soft", "overrides": ["step=0.001"]}
CALLS = {
    "asrsim.identification.task.task_of": (
        """identify a.yaml -e a.csv --validate b.csv --free j.damping=1 --tie j.a=j.b --own j.c --map q=j.x --rate 50
        --hold-out 0.3 --variant soft --set step=0.001""",
        SHARED | {"given": ["a.yaml", ["a.csv"]], "validate": ["b.csv"], "free": ["j.damping=1"], "ties": ["j.a=j.b"],
                  "own": ["j.c"], "mapping": ["q=j.x"], "rate": 50.0, "hold_out": 0.3},
    ),
    "asrsim.designs.run.design": (
        """design a.yaml --limits l.yaml --free j.damping --tie j.a=j.b --duration 3 --experiment a.csv --robust 2 --seed 7
        --variant soft --set step=0.001""",
        SHARED | {"given": ["a.yaml", "l.yaml"], "free": ["j.damping"], "ties": ["j.a=j.b"], "duration": 3.0,
                  "experiments": ["a.csv"], "robust": 2, "seed": 7},
    ),
    "asrsim.exports.export": (
        "export a.yaml --out b.xml --knots 9 --step 0.002 --fit fit.json --variant soft --set step=0.001 --no-plot",
        {"given": ["a.yaml", "b.xml"], "knots": 9, "step": 0.002, "fit": "fit.json", "variant": "soft",
         "overrides": ["step=0.001"], "plot": False},
    ),
    "asrsim.twin.follow.follow_recording": (
        "twin a.yaml -e a.csv --bandwidth 4 --map q=j.x --rate 50 --clock-offset 0.2 --variant soft --set step=0.001",
        {"given": ["a.yaml", "a.csv"], "bandwidth": 4.0, "mapping": ["q=j.x"], "rate": 50.0, "clock_offset": 0.2,
         "variant": "soft", "overrides": ["step=0.001"]},
    ),
    "asrsim.sweeps.run.study_of": (
        "sweep a.yaml --over j.damping=1:2:3 --sampler sobol --samples 8 --seed 7 --fit f.json --variant soft --set step=0.001",
        {"given": ["a.yaml", ["j.damping=1:2:3"], {"variants": ["soft"], "overrides": ["step=0.001"], "sampler": "sobol",
                   "samples": 8, "seed": 7, "fit": "f.json"}]},
    ),
    "asrsim.plots.job.PlotJob": (
        """plot -e a.csv --map q=j.x --rate 50 --joint j --quantity stiffness --measure rms --align 0.2 --format pdf --bode
        --band 1 5 --input j.reference_1 --output j.deflection --start 0.1 --end 2 --out pictures""",
        {"experiments": ["a.csv"], "mapping": ["q=j.x"], "rate": 50.0, "joints": ["j"], "quantities": ["stiffness"],
         "measures": ["rms"], "lag": 0.2,
         "formats": ["pdf"], "bode": True, "band": [1.0, 5.0], "given": "j.reference_1", "output": "j.deflection",
         "start": 0.1, "end": 2.0, "folder": "pictures"},
    ),
}  # fmt: skip
"""Command line, and the arguments that the function receives: those without a name are called `given`."""


@pytest.mark.parametrize("function", CALLS)
def test_options_reach_the_library(function, monkeypatch, asrsim_command):
    line, expected = CALLS[function]
    passed = {}

    def receive(*given, **options):
        passed.update({"given": given, **options})
        raise InputError("received")

    monkeypatch.setattr(function, receive)
    done = asrsim_command(*line.split())
    plain = json.loads(json.dumps(passed, default=str))
    assert {name: plain.get(name) for name in expected} == expected, done.err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("design a.yaml --limits l.yaml --seconds 3", "--seconds is called --duration now"),
        ("export a.yaml --timestep 0.001", "--timestep is called --step now"),
        ("twin a.yaml -e a.csv --lag=0.2", "--lag is called --clock-offset now"),
        ("sweep a.yaml --over a.b=1 --design lhs", "--design is called --sampler now"),
        ("export a.yaml --to mjcf", "--to is called --format now"),
    ],
)
def test_an_old_name_of_an_option_works_and_says_the_new_one(asrsim_command, line, said):
    err = asrsim_command(*line.split()).err
    assert said in err
    assert "cannot be read" in err


def test_an_old_name_of_a_keyword_works_and_warns(tmp_path):
    with pytest.warns(DeprecationWarning, match="seconds is called duration now"), pytest.raises(InputError, match=r"l\.yaml"):
        design("a.yaml", tmp_path / "l.yaml", seconds=3.0)


def test_an_old_key_of_a_file_is_told_of_in_one_line(tiny, asrsim_command):
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}\nsubstep_cap: 50\n")
    done = asrsim_command("run", tiny.scenario, "--set", "effects.sensors.*.delay=0.01", "--set", "duration=0.01", "--no-plot")
    told = [line for line in done.err.splitlines() if "is called" in line]
    assert sorted(line.partition("the key ")[2] for line in told) == [
        "`effects` is called `imperfections` now; the next version drops the old name",
        "`substep_cap` is called `max_substeps` now; the next version drops the old name",
    ]
    assert any(f"{tiny.scenario.name}:{len(tiny.scenario.read_text().splitlines())}: the key" in line for line in told)


def test_an_old_key_of_a_study_has_the_same_meaning(tiny):
    (tiny.folder / "study.yaml").write_text("scenario: step.yaml\nover: {duration: 'uniform(0.1, 0.2)'}\ndesign: lhs\n")
    with pytest.warns(OldKeyWarning, match="`design` is called `sampler` now"):
        assert read_study(tiny.folder / "study.yaml").sampler == "lhs"


@pytest.mark.parametrize(("package", "names"), NAMES.items())
def test_an_old_name_of_a_package_works_and_warns(package, names):
    module = import_module(package)
    for old, new in names.items():
        with pytest.warns(DeprecationWarning, match=rf"{package}\.{old} is called {package}\.{new} now"):
            assert getattr(module, old) is getattr(module, new)
    with pytest.raises(AttributeError, match="no attribute 'older'"):
        _ = module.older
