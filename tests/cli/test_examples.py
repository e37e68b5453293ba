"""Commands of the tutorial and of the help texts run as printed; `asrsim examples` copies the files that they need."""

import re
import runpy
import shlex
import shutil

import pytest

from asrsim.cli.app import COMMANDS, app
from asrsim.errors import OutputError
from asrsim.runs.examples import copy_examples
from support.paths import ROOT

LONG = ("reproduce", "ilc", "design")
"""Commands whose examples take half a minute or more."""
FASTER = {
    "run examples": ["--no-plot"],
    "render out/step_2dof": ["--size", "80"],
    "report out/step_2dof": ["--no-film"],
    "sweep examples": ["--set", "duration=0.1", "--workers", "1"],
    "twin lab": ["--no-plot"],
    "run lab.yaml": ["--no-plot"],
    "ilc examples": ["--set", "step=0.002"],
    "run out/ilc_2dof": ["--no-plot"],
    "plot out/step_2dof --format": ["--joint", "joint_1"],
    # Live runs and views would take the time that they simulate.
    "live examples": ["--speed", "5"],
    # How far a view gets in 2 s depends on the machine, so that its claims may not hold yet.
    "view examples": ["--speed", "5", "--duration", "2", "--set", "expect=[]"],
}
"""Options that make a command faster in this test, by words of the command."""
SAID = {
    "examples": r"^wrote \d\d files into examples; run one: asrsim run examples/scenarios/step_2dof\.yaml$",
    "check examples/urdf/plain_arm": r"· 2 moving joints · 0 actuators · not driven: shoulder, elbow$",
    "check examples/urdf/dof2_vertical.urdf examples": r"^2 joints: joint_1 \(line 92\), joint_2 \(line 108\)$",
    "check --strict": r"^1 file: 0 errors, 0 warnings$",
    "check --actuator": r"^my_vsa: all checks passed$",
    "check --stage": r"^clutch: all checks passed$",
    "init examples/urdf/plain_arm": r"; run it: asrsim run arm\.yaml$",
    "init examples/urdf/dof2_vertical": r"^find the robot's parameters: asrsim identify lab\.fit\.yaml$",
    "init --experiment": r": check this file; every command reads bench_motion\.csv as this file states$",
    "run arm": r"^arm / stiff  3 s simulated in .* step 1 ms, 2 substeps, leapfrog",
    "run lab": r"^pass joint_1: rmse of link_position against two_joints\.csv is .*, expected < .* rad: holds; compared with",
    "ilc": r"^play the learned inputs: asrsim run out/ilc_2dof/ilc/learned\.yaml$",
    "live": r"^repeat it: asrsim rerun out/step_2dof/soft_live/log\.mcap$",
    "view": r"^repeat it: asrsim rerun out/step_2dof/soft_view/log\.mcap$",
    "rerun": r"^out/step_2dof/soft/log\.mcap: 4001 samples compared: identical, bit for bit$",
    "plot out/step_2dof/soft/log": r"^two_joints\.csv beside soft: 12\.5 s late \(start\)$",
    "plot out/step_2dof/soft --bode": r"^note soft: joint_1: the input explains little of the output: median coherence 0\.",
    "identify": r"^joint_1\.\w+: no effect: .*\n(.*\n)*to identify more parameters:\n  ",
    "export": r"^Replayed in MuJoCo \(.*\)\.\nNot in the file:\n  ",
    "twin": r"^joint_1: its positions follow the commands .* s later than in the model",
    "sweep": r"^step_2dof: 20 of 20 runs, 20 complete$",
    "datasheet qbmove": r"^to repeat the simulations, run in datasheet/: asrsim run qbmove\.yaml$",
    "actuators qbmove": r"^motors  2; second reference in rad$|^<gazebo>$",
}
"""What commands say, by their first words. What they name as written must be there."""
GENERATE = runpy.run_path(str(ROOT / "docs" / "generate.py"))


def texts_of_examples(name):
    """The examples in the help of a command."""
    from typer.main import get_command

    texts = (" ".join(text.split()) for text in str(get_command(app).get_command(None, name).help).split("\n\n"))
    return [text.removeprefix("Example: ") for text in texts if text.startswith("Example: ")]


def examples_of_the_help():
    """Examples in the help texts of all commands, ordered so that input files are written before they are read."""
    names = dict.fromkeys(["run", *COMMANDS])
    return [text for name in names if name not in LONG for text in texts_of_examples(name)]


def test_every_command_of_the_tutorial_and_of_the_help_runs(asrsim_command, tmp_path):
    lines = dict.fromkeys([*GENERATE["tutorial_commands"](), *examples_of_the_help()])
    assert len(lines) > 25
    for line in lines:
        more = [word for words, options in FASTER.items() if words in line for word in options]
        done = asrsim_command(*shlex.split(line)[1:], *more)
        assert done.code == 0, f"{line}\n{done.out}\n{done.err}"
        for words, sentence in SAID.items():
            if line.startswith(f"asrsim {words}"):
                assert re.search(sentence, done.out, re.MULTILINE), f"{line}\n{done.out}"
        for folder, files in re.findall(r"^wrote (\S+/): (.*?)(?: \(\d+ replaced\))?$", done.out, re.MULTILINE):
            for name in files.split(", "):
                assert (tmp_path / folder / name).is_file(), f"{line}\n{done.out}"
    pictures = GENERATE["tutorial_pictures"](tmp_path)
    assert len(pictures) == len(re.findall(r"!\[", (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))) >= 5
    for shown, made in pictures.items():
        assert made.stat().st_size > 5000, made
        assert shown.stat().st_size < 150_000


@pytest.mark.slow
def test_the_example_of_design_designs_for_the_recorded_arm(asrsim_command):
    asrsim_command("examples")
    recorded = "examples/urdf/dof2_vertical.urdf --experiment examples/recordings/two_joints.csv --out lab.yaml"
    asrsim_command("init", *shlex.split(recorded))
    (example,) = texts_of_examples("design")
    done = asrsim_command(*shlex.split(example)[1:], "--duration", "0.5", "--no-plot")
    assert done.code == 0, done.err


def test_examples_are_copied_without_replacing_foreign_files(tmp_path):
    out = tmp_path / "examples"
    written = copy_examples(out)
    shown = {path.name for path in (ROOT / "examples").iterdir()} - {"__pycache__", "out"}
    assert {path.relative_to(out).parts[0] for path in written} == shown
    copy_examples(out)  # the same files again are no conflict
    mine = out / "urdf" / "plain_arm.urdf"
    mine.write_text("mine", encoding="utf-8")
    removed = out / "scenarios" / "step_2dof.yaml"
    removed.unlink()
    with pytest.raises(OutputError, match="plain_arm"):
        copy_examples(out)
    assert mine.read_text(encoding="utf-8") == "mine"
    assert not removed.exists()
    copy_examples(out, overwrite=True)
    assert removed.exists()
    assert mine.read_text(encoding="utf-8") != "mine"


def test_copying_examples_onto_a_file_is_an_error(tmp_path):
    (tmp_path / "examples").write_text("", encoding="utf-8")
    with pytest.raises(OutputError):
        copy_examples(tmp_path / "examples")


def test_sample_recordings_are_those_of_their_script(tmp_path):
    shutil.copytree(ROOT / "examples" / "urdf", tmp_path / "urdf")
    place = tmp_path / "recordings"
    shutil.copytree(ROOT / "examples" / "recordings", place)
    runpy.run_path(str(place / "record.py"), run_name="sample")["main"](place)
    for name in ("two_joints.csv", "bench_motion.csv"):
        assert (place / name).read_text() == (ROOT / "examples" / "recordings" / name).read_text()
