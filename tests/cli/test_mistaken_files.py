"""If a command gets a file of the wrong kind, the error names the kind and the command that takes it."""

import pytest

from asrsim.document.file import COMMANDS, kind_of
from support.paths import EXAMPLES

TAKES = {
    "scenario": ("run", "live", "ilc", "check", "sweep", "identify"),
    "robot": ("init",),
    "log": ("plot", "render", "report", "rerun"),
}
"""Commands that take a kind of file as their first argument, by kind."""
ALSO = {"check": {"robot"}, "sweep": {"study"}, "identify": {"fit"}}
"""Further kinds of files that a command takes, by command."""


@pytest.fixture
def files(tmp_path, tiny, asrsim_command):
    """A file of each kind. The log is the example of the plot tests."""
    assert asrsim_command("run", tiny.scenario, "--no-plot", "--out", "made").code == 0
    found = {
        "robot": EXAMPLES / "urdf" / "dof1_sea.urdf",
        "scenario": tiny.scenario,
        "fit": tmp_path / "made.fit.yaml",
        "study": tmp_path / "study.yaml",
        "recording": EXAMPLES / "recordings" / "two_joints.csv",
        "file of limits": EXAMPLES / "recordings" / "limits.yaml",
        "log": next(tmp_path.rglob("log.mcap")),
        "summary": next(tmp_path.rglob("summary.json")),
    }
    found["fit"].write_text(f"scenario: {tiny.scenario}\nexperiments: [lab.csv]\nfree: {{elbow.damping: }}\n", encoding="utf-8")
    found["study"].write_text(f"scenario: {tiny.scenario}\nover: {{elbow.damping: [0.1, 0.2]}}\n", encoding="utf-8")
    return found


def test_file_kinds_are_recognised(files):
    assert {kind: kind_of(path) for kind, path in files.items()} == {kind: kind for kind in COMMANDS}
    assert kind_of(files["log"].parent) == "log"


@pytest.mark.parametrize("wanted", TAKES)
def test_commands_name_the_kind_of_a_wrong_file(wanted, files, asrsim_command):
    for command in TAKES[wanted]:
        for kind, path in files.items():
            if kind in {wanted} | ALSO.get(command, set()):
                continue
            done = asrsim_command(command, path)
            assert done.code == 1, (command, kind)
            assert f"is a {kind}, not a {wanted}" in done.err + done.out, (command, kind)
            known = COMMANDS[kind].format(path=path, folder=path.parent)
            assert f"Use it with: {known}" in done.err + done.out, (command, kind)


def test_files_without_recordings_are_named(files, asrsim_command):
    for kind in ("robot", "scenario", "fit", "study", "summary"):
        for arguments in (("plot", files["log"], "--experiment"), ("init", files["robot"], "--experiment")):
            done = asrsim_command(*arguments, files[kind])
            assert done.code == 1
            assert f"is a {kind}, not a recording" in done.err


def test_recording_with_scenario_keys_is_a_recording(tmp_path, files, asrsim_command):
    recording = tmp_path / "lab.json"
    rows = [[k / 100, k / 1000] for k in range(300)]
    times, places = zip(*rows, strict=True)
    recording.write_text(f'{{"duration": 3, "time": {list(times)}, "elbow.link_position": {list(places)}}}', encoding="utf-8")
    assert asrsim_command("plot", files["log"], "--experiment", recording).code == 0
