"""Files that were cut, damaged or made to exhaust the machine: a command says what is wrong, in words, and soon."""

import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import time
import zipfile

import numpy as np
import pytest

from asrsim.log import open_log
from asrsim.outfile import ABANDONED, write_json

CELL = '<table:table-cell office:value-type="float" office:value="{}"{}/>'
SPACES = " ".join(
    f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"' for name in ("office", "table", "text", "manifest")
)
LEARNING = """
ilc: {trajectory: {elbow: {minimum_jerk: {duration: 0.2, to: 0.1}}}, tolerance: 1e-9, max_iterations: 1}
"""


@pytest.fixture
def log(tiny, asrsim_command):
    """Log of a run of the tiny scenario."""
    assert asrsim_command("run", tiny.scenario, "--no-plot", "-q", "--out", "made").code == 0
    return tiny.folder / "made" / "log.mcap"


def no_crash(outcome):
    assert "unexpected error" not in outcome.err
    return outcome


@pytest.mark.parametrize("quiet", [[], ["-q"]])
def test_rerun_says_that_a_log_has_no_samples(log, asrsim_command, quiet):
    place = open_log(log)._structure.chunks[0].offset - 9
    log.write_bytes(log.read_bytes()[:place])
    outcome = no_crash(asrsim_command("rerun", log, *quiet))
    assert outcome.code == 1
    assert "0 samples compared (the log is truncated): nothing to compare" in outcome.out + outcome.err


def test_a_stopped_rerun_says_that_it_compared_a_part(tiny, asrsim_command, monkeypatch):
    assert asrsim_command("run", tiny.scenario, "--no-plot", "-q", "--out", "long", "--set", "duration=20").code == 0
    monkeypatch.setattr("asrsim.cli.interrupt.Interruption.stop", lambda self: stopping())
    calls = []

    def stopping():
        calls.append(1)
        return len(calls) > 3

    outcome = asrsim_command("rerun", tiny.folder / "long" / "log.mcap")
    assert "identical so far; stopped before the end of the log" in outcome.out
    calls.clear()
    document = json.loads(asrsim_command("rerun", tiny.folder / "long" / "log.mcap", "--json").out)
    assert (document["partial"], document["identical"]) == (True, False)


@pytest.mark.parametrize(
    "times", [(1_500_000_000, 0), (0, 1_000_000_000), (10**18, 2 * 10**18)], ids=["swapped", "short", "far"]
)
def test_a_chunk_that_states_wrong_times_is_named(log, asrsim_command, times):
    chunk = open_log(log)._structure.chunks[0]
    data = bytearray(log.read_bytes()[: chunk.offset + chunk.length])
    data[chunk.offset : chunk.offset + 16] = struct.pack("<QQ", *times)
    log.write_bytes(data)
    for command in ("report", "plot", "rerun"):
        outcome = no_crash(asrsim_command(command, log))
        assert outcome.code == 1
        assert "log.mcap: the log is damaged: " in outcome.err


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("mot_J: 1.0e-30", "motor substeps in a substep of 0.001 s, and at most 10000 are possible"),
        ("mot_J: 1.0e-30, mot_tauStribeck: 1, mot_velStribeck: 1.0e-12", "motor substeps"),
    ],
)
def test_numbers_of_substeps_are_bounded_before_the_run(tiny, asrsim_command, wrong, said):
    tiny.scenario.write_text(
        "robot: pendulum.urdf\nmodes: 5\nduration: 1\nreferences: {elbow: {reference_1: 0.1}}\n"
        f"parameters: {{elbow: {{{wrong}}}}}\n"
    )
    for command in ("check", "run"):
        outcome = no_crash(asrsim_command(command, tiny.scenario))
        assert outcome.code == 1
        assert said in outcome.out + outcome.err


def test_a_compiled_run_of_many_motor_substeps_ends_with_a_readable_log(tiny):
    """Ctrl-C; SIGTERM is handled alike, which tests/cli/test_writers.py shows."""
    pytest.importorskip("numba")
    tiny.scenario.write_text(
        "robot: pendulum.urdf\nmodes: 5\nduration: 1000\nmotor_substeps: 9999\ncompiled: true\n"
        "references: {elbow: {reference_1: 0.1}}\n"
    )
    command = [sys.executable, "-m", "asrsim", "run", tiny.scenario, "--no-plot", "--out", "out"]
    with subprocess.Popen(command, cwd=tiny.folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        log = tiny.folder / "out" / "log.mcap"
        limit = time.monotonic() + 120
        while not (log.is_file() and len(open_log(log)._structure.chunks) > 0) and time.monotonic() < limit:
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        assert running.wait(20) == 130
    assert open_log(log).status == "interrupted"


@pytest.mark.parametrize("outputs", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("inputs", [0.0, np.nan])
def test_a_learning_folder_without_finite_outputs_is_refused_or_continued(tiny, asrsim_command, outputs, inputs):
    tiny.scenario.write_text("robot: pendulum.urdf\nduration: 0.2" + LEARNING)
    asrsim_command("ilc", tiny.scenario, "--out", "learned", "--no-plot", "-q")
    state = tiny.folder / "learned" / "state.npz"
    stored = dict(np.load(state))
    np.savez(state, **(stored | {"outputs": stored["outputs"] + outputs, "inputs": stored["inputs"] + inputs}))
    outcome = no_crash(asrsim_command("ilc", tiny.scenario, "--out", "learned", "--no-plot", "--resume"))
    refused = "its numbers are too large for a robot" in outcome.err
    assert refused is not (np.isnan(outputs) and inputs == 0.0)


def test_foreign_files_among_the_parts_of_a_study_are_left_alone(tiny, asrsim_command):
    pytest.importorskip("pyarrow")
    arguments = ("sweep", tiny.scenario, "--over", "elbow.damping=[0.1, 0.2]", "--out", "study", "--workers", "1", "--no-plot")
    swept = asrsim_command(*arguments)
    assert swept.code == 0
    assert f"wrote study{os.sep}: study.json, rows.parquet\n" in swept.out
    names = ("part-notes.parquet", "part-.parquet", "part-\u00b2.parquet", "part-000001-old.parquet")
    for name in names:
        (tiny.folder / "study" / name).write_bytes(b"mine")
    assert no_crash(asrsim_command(*arguments, "--resume")).code == 0
    assert all((tiny.folder / "study" / name).read_bytes() == b"mine" for name in names)


@pytest.mark.parametrize("repeated", [(10**9, 10**9), (1, 2 * 10**6), (10**6, 100)])
def test_repeated_cells_of_a_workbook_stand_for_no_more_than_a_limit(log, asrsim_command, repeated):
    rows, columns = repeated
    filled = CELL.format(0.5, f' table:number-columns-repeated="{columns}"')
    body = "".join(f"<table:table-row>{CELL.format(k, '')}{CELL.format(2 * k, '')}</table:table-row>" for k in range(5))
    with zipfile.ZipFile(log.parent / "lab.ods", "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        book.writestr("META-INF/manifest.xml", f"<manifest:manifest {SPACES}/>")
        book.writestr(
            "content.xml",
            f'<office:document-content {SPACES}><office:body><office:spreadsheet><table:table table:name="S">{body}'
            f'<table:table-row table:number-rows-repeated="{rows}">{filled}</table:table-row>'
            "</table:table></office:spreadsheet></office:body></office:document-content>",
        )
    began = time.monotonic()
    outcome = no_crash(asrsim_command("plot", log, "--experiment", log.parent / "lab.ods"))
    assert outcome.code == 1
    assert "lab.ods: " in outcome.err
    assert time.monotonic() - began < 60


def test_unfinished_files_of_killed_processes_are_removed(tmp_path):
    def made(name, *, old=True):
        path = tmp_path / f".asrsim-{name * 16}.part"
        path.write_bytes(b"half")
        if old:
            os.utime(path, times=(time.time() - 2 * ABANDONED,) * 2)
        return path

    abandoned, fresh, locked = made("a"), made("b", old=False), made("c")
    foreign = tmp_path / ".asrsim-notes.part"
    foreign.write_bytes(b"mine")
    os.utime(foreign, times=(0, 0))
    with locked.open("rb") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        write_json(tmp_path / "a.json", {})
    assert sorted(tmp_path.iterdir()) == sorted([fresh, locked, foreign, tmp_path / "a.json"])
    assert not abandoned.exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("gravity: [0, 0, -981]", "is stronger than on any planet"),
        ("references: {elbow: {equilibrium_position: 45}}", "jumps by 7.16 turns of 'elbow'"),
        ("references: {elbow: {equilibrium_position: {step: {at: 0.1, to: 1.0e6}}}}", "jumps by 1.59e+05 turns of 'elbow'"),
    ],
)
@pytest.mark.parametrize("quiet", [[], ["-q"]])
def test_probable_mistakes_are_printed_also_in_quiet_mode(tiny, asrsim_command, more, said, quiet):
    robot = tiny.robot.read_text().replace('lower="-3" upper="3"', "").replace('type="revolute"', 'type="continuous"')
    tiny.robot.write_text(robot)
    scenario = "" if "references" in more else "references: {elbow: {equilibrium_position: 0}}"
    tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 0.2\n{more}\n{scenario}\n")
    outcome = asrsim_command("run", tiny.scenario, "--no-plot", *quiet)
    assert said in outcome.err


def test_turns_that_a_reference_makes_gradually_are_no_mistake(tiny, asrsim_command):
    robot = tiny.robot.read_text().replace('lower="-3" upper="3"', "").replace('type="revolute"', 'type="continuous"')
    tiny.robot.write_text(robot)
    ramp = "{ramp: {start: 0, duration: 2, to: 20}}"
    tiny.scenario.write_text(f"robot: pendulum.urdf\nduration: 2\nreferences: {{elbow: {{equilibrium_position: {ramp}}}}}\n")
    assert "turns of" not in asrsim_command("check", tiny.scenario).out


def test_too_little_memory_is_said_in_words(tiny, asrsim_command, monkeypatch):
    def exhausted(*_, **__):
        raise MemoryError

    monkeypatch.setattr("asrsim.simulation.examine.read_scenarios", exhausted)
    outcome = no_crash(asrsim_command("run", tiny.scenario))
    assert (outcome.code, outcome.err) == (1, "asrsim: the command needs more memory than this machine has\n")
