"""What stands in the help can be tried after `asrsim examples`; the recorded sample is what its page says."""

from __future__ import annotations

import os
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from asrsim.cli.app import COMMANDS, app
from asrsim.errors import OutputError
from asrsim.runs.examples import copy_examples
from support.paths import ROOT

LONG = ("reproduce", "ilc", "design")
"""Commands whose examples take half a minute or more."""


def examples_of_the_help() -> list[str]:
    """Every example that a command's help gives, in an order in which one can be tried after the other."""
    from typer.main import get_command

    group = get_command(app)
    order = ["run", "examples", "check", "actuators", "init", "run lab", *COMMANDS]
    found = []
    for name in dict.fromkeys(order):
        if name == "run lab":
            found.append("asrsim run lab.yaml")
        elif name not in LONG and name != "examples":
            texts = str(group.get_command(None, name).help).split("\n\n")
            found += [
                " ".join(text.split()).removeprefix("Example: ") for text in texts if text.strip().startswith("Example: ")
            ]
    return found


def run_command(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    words = shlex.split(line)
    assert words[0] == "asrsim"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "asrsim", *words[1:]]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_every_example_of_the_help_runs_after_asrsim_examples(asrsim_command):
    tried = ["asrsim examples", *examples_of_the_help()]
    assert len(tried) > 10
    for line in tried:
        done = asrsim_command(*shlex.split(line)[1:])
        assert done.code == 0, f"{line}\n{done.out}\n{done.err}"


def test_help_by_h_in_every_command(tmp_path):
    assert run_command("asrsim -h", tmp_path).stdout.startswith("Usage")
    done = run_command("asrsim init -h", tmp_path)
    assert done.returncode == 0
    assert "--actuator" in done.stdout


def test_examples_are_copied_whole_and_nothing_of_others_is_replaced(tmp_path):
    out = tmp_path / "examples"
    written = copy_examples(out)
    folders = {"paper", "plugins", "recordings", "ros2_control", "scenarios", "urdf"}
    shown = {"learn_reach.py", "plan_whip.py", "tune_gains.py", *folders}
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


def test_a_file_in_place_of_the_folder_is_one_clear_error(tmp_path):
    (tmp_path / "examples").write_text("", encoding="utf-8")
    with pytest.raises(OutputError):
        copy_examples(tmp_path / "examples")


def test_the_recorded_sample_is_made_by_its_script(tmp_path):
    shutil.copytree(ROOT / "examples" / "urdf", tmp_path / "urdf")
    place = tmp_path / "recordings"
    shutil.copytree(ROOT / "examples" / "recordings", place)
    runpy.run_path(str(place / "record.py"), run_name="sample")["main"](place)
    for name in ("two_joints.csv", "bench_motion.csv"):
        assert (place / name).read_text() == (ROOT / "examples" / "recordings" / name).read_text()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("run examples/scenarios/step_2dof.yaml --variant s", ["soft", "stiff"]),
        ("run nothing.yaml --variant s", []),
        ("live examples/scenarios/step_2dof.yaml --plugin x.py --variant so", ["soft"]),
        ("actuators b", ["bavs"]),
        ("init examples/urdf/plain_arm.urdf --actuator el", ["elbow="]),
        ("init examples/urdf/plain_arm.urdf --out arm.yaml --actuator q", ["qbmove"]),
        ("plot out --joint sh", ["shoulder"]),
        ("plot nowhere --joint sh", []),
        ("run x.yaml --engine ben", ["bench"]),
    ],
)
def test_the_shell_completes_variants_actuators_and_joints(line: str, offered: list[str], here: Path) -> None:
    """As bash asks for it: the option that is completed has no value yet, so that nothing behind it was parsed."""
    from typer.testing import CliRunner

    words = ["asrsim", *line.split()]
    asked = {"_ASRSIM_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
    assert CliRunner().invoke(app, env=asked, prog_name="asrsim").output.split() == offered


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the examples and a log."""
    from asrsim.log import LogWriter
    from asrsim.samples import JointInfo, RunInfo

    folder = tmp_path_factory.mktemp("examples")
    (folder / "out").mkdir()
    copy_examples(folder / "examples")
    joints = tuple(JointInfo(name=name, actuator="rigid", mode=None) for name in ("shoulder", "elbow"))
    with LogWriter(folder / "out" / "log.mcap", RunInfo(robot="arm", joints=joints, step=1e-3)):
        pass
    return folder


@pytest.fixture
def here(examples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(examples)
