"""Commands that write files: foreign files and, on a full disk, earlier results stay; signals and kills end a run cleanly."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

import asrsim
from asrsim.errors import OutputError
from asrsim.log import open_log, read_log
from asrsim.runs.lock import owned
from support.tiny import PENDULUM, SCENARIO

HAND = "written by hand; asrsim run scenario.yaml\n"
MOTION = "time,elbow.position,elbow.velocity\n0,0,0\n0.001,0,0\n0.002,0,0\n"
LIFT = """\
robot: pendulum.urdf
duration: 0.2
ilc: {trajectory: {elbow: {minimum_jerk: {duration: 0.2, to: 0.3}}}, tolerance: 0.001, gain: 0.5, max_iterations: 1}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with a run in `made`, a recorded motion, and a scenario for learning."""
    folder = tmp_path_factory.mktemp("writers")
    files = {
        "pendulum.urdf": PENDULUM,
        "step.yaml": SCENARIO,
        "lift.yaml": LIFT,
        "motion.csv": MOTION,
        "motion.fit.yaml": MOTION,
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    asrsim.run(asrsim.load_scenario(folder / "step.yaml", overrides=["duration=0.1"])[0], out=folder / "made")
    return folder


@pytest.fixture
def place(made, tmp_path):
    """Copy of the folder `made`."""
    return Path(shutil.copytree(made, tmp_path, dirs_exist_ok=True))


WRITERS = {
    "run": ("run step.yaml --set duration=0.1 --out out --report", ["log.mcap", "summary.json", "report.html", "joints.png"]),
    "plot": ("plot made/log.mcap --out out", ["joints.png", "energy.png"]),
    "plot pdf svg": ("plot made/log.mcap --out out --format pdf --format svg", ["joints.pdf", "joints.svg"]),
    "render": ("render made/log.mcap --out out --frames 2 --gif", ["filmstrip.png", "motion.gif"]),
    "report": ("report made --out out/page.html --no-film", ["page.html"]),
    "ilc": ("ilc lift.yaml --out out", ["learned.csv", "learned.yaml", "ilc.json", "ilc.png", "state.npz"]),
    "init": ("init pendulum.urdf --out out/start.yaml", ["start.yaml"]),
}
"""Arguments with which each command writes into `out`, and the files that it writes."""


@pytest.mark.parametrize("name", WRITERS)
def test_commands_do_not_overwrite_foreign_files(place, asrsim_command, name):
    arguments, files = WRITERS[name]
    (place / "out").mkdir()
    for file in files:
        (place / "out" / file).write_text(HAND)
    outcome = asrsim_command(*arguments.split(), *(["--overwrite"] if name in ("run", "ilc") else []))
    assert outcome.code == 1
    assert any(file in outcome.err for file in files)
    assert all((place / "out" / file).read_text() == HAND for file in files)


@pytest.mark.parametrize("name", ["run", "render", "ilc"])
def test_planted_links_are_not_followed(place, asrsim_command, name):
    """The three commands whose logs, films and arrays other libraries write."""
    arguments, files = WRITERS[name]
    (place / "out").mkdir()
    (place / "precious").write_text(HAND)
    for file in files:
        for planted in (file, f".{file}.part", f"{file}.part"):
            (place / "out" / planted).symlink_to(place / "precious")
    asrsim_command(*arguments.split())
    assert (place / "precious").read_text() == HAND
    assert all((place / "out" / file).is_symlink() for file in files)


@pytest.mark.parametrize("name", [name for name in WRITERS if name not in ("init", "plot pdf svg")])
def test_commands_may_overwrite_their_own_files(place, asrsim_command, name):
    arguments, files = WRITERS[name]
    (place / "out").mkdir()
    for _ in range(2):
        outcome = asrsim_command(*arguments.split())
        assert "asrsim:" not in outcome.err, outcome.err
        assert all((place / "out" / file).stat().st_size for file in files)
    assert not [path for path in (place / "out").iterdir() if path.name.startswith(".") or path.name.endswith(".part")]


@pytest.mark.parametrize(
    "arguments",
    [
        "report made --out step.yaml",
        "report made --out made/log.mcap",
        "init pendulum.urdf --out pendulum.urdf --overwrite",
        "init pendulum.urdf --experiment motion.csv --out motion.csv --overwrite",
        "init pendulum.urdf --experiment motion.fit.yaml --out motion.yaml --overwrite",
    ],
)
def test_commands_never_overwrite_their_inputs(place, asrsim_command, arguments):
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    outcome = asrsim_command(*arguments.split())
    assert outcome.code in (1, 2)
    assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("render made --out film.gif", "must be a folder, but film.gif has the suffix of a file"),
        ("init pendulum.urdf --out here", "must end in .yaml or .yml, not here"),
        ("report made --out page", "must end in .html or .htm, not page"),
    ],
)
def test_folders_and_files_are_not_interchanged(place, asrsim_command, arguments, said):
    outcome = asrsim_command(*arguments.split())
    assert outcome.code == 2
    assert said in " ".join(outcome.err.split())


def test_a_run_keeps_the_log_that_it_is_compared_with(place, asrsim_command):
    what = "quantity: link_position, measure: rmse, value: 0, tolerance: 1, against: made/log.mcap"
    claim = f"\nexpect:\n  - {{joint: elbow, {what}}}\n"
    (place / "step.yaml").write_text((place / "step.yaml").read_text() + claim)
    outcome = asrsim_command("run", "step.yaml", "--set", "duration=0.1", "--out", "made", "--no-plot")
    assert outcome.code == 1
    assert "is an input of this command" in outcome.err
    assert open_log(place / "made/log.mcap").status == "complete"


def test_a_folder_in_use_is_refused(place, asrsim_command):
    with owned(place / "made"):
        for arguments in ("run step.yaml --out made", "ilc lift.yaml --out made"):
            outcome = asrsim_command(*arguments.split())
            assert outcome.code == 1
            assert "is in use" in outcome.err
        with pytest.raises(OutputError, match="is in use"):
            asrsim.run(place / "step.yaml", out=place / "made")
    assert asrsim_command(*["run", "step.yaml", "--set", "duration=0.1", "--out", "made", "--no-plot", "--overwrite"]).code == 0


def begin(place, size=50_000):
    """Start a long run in a separate process, and wait until its log has `size` bytes."""
    command = [
        sys.executable,
        *["-m", "asrsim.cli.app", "run", "step.yaml", "--no-plot", "--set", "duration=600", "--out", "long"],
    ]
    process = subprocess.Popen(command, cwd=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if any(path.stat().st_size > size for path in place.glob("long/**/log.mcap*")):
            return process
        time.sleep(0.05)
    process.kill()
    raise AssertionError(process.communicate()[1])


def test_a_signal_ends_a_run_with_a_readable_log(place):
    """SIGTERM is handled like Ctrl-C."""
    run = begin(place)
    run.send_signal(signal.SIGTERM)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "interrupted" in out
    assert "Traceback" not in err
    log = read_log(place / "long/log.mcap")
    assert (log.status, log.truncated) == ("interrupted", False)
    summary = json.loads((place / "long/summary.json").read_text())
    assert (summary["status"], summary["samples"]) == ("interrupted", len(log.samples.time))


def test_a_killed_run_leaves_a_repeatable_log_and_no_lock(place, asrsim_command):
    assert asrsim_command("run", "step.yaml", "--set", "duration=0.1", "--out", "long", "--no-plot").code == 0
    before = (place / "long/log.mcap").read_bytes()
    # A kill during the first chunk (576 kB) would leave no samples.
    first = begin(place, size=1_000_000)
    refused = asrsim_command("run", "step.yaml", "--out", "long", "--no-plot")
    first.kill()
    first.communicate()
    assert "is in use" in refused.err
    assert (place / "long/log.mcap").read_bytes() == before
    log = read_log((place / "long/log.mcap.part").rename(place / "killed.mcap"))
    assert log.status == "truncated"
    repeated = json.loads(asrsim_command("rerun", "killed.mcap", "--json").out)
    assert (repeated["identical"], repeated["samples"]) == (True, len(log.samples.time))
    assert asrsim_command("run", "step.yaml", "--set", "duration=0.1", "--out", "long", "--no-plot").code == 0
    assert sorted(path.name for path in (place / "long").iterdir()) == ["log.mcap", "summary.json"]


def test_workers_end_with_their_parent(tmp_path):
    code = (
        "import sys, time\nsys.path.insert(0, '.')\nfrom asrsim.workers.local import Processes\n"
        "with Processes(1) as workers:\n"
        "    ((_, pid),) = next(workers.results(eval, ['__import__(\\'os\\').getpid()']))\n    print(pid, flush=True)\n"
        "    next(workers.results(time.sleep, [600]))\n"
    )
    (tmp_path / "parent.py").write_text(code)
    parent = subprocess.Popen([sys.executable, "parent.py"], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        if Path(f"/proc/{worker}/stat").exists() and " Z " in Path(f"/proc/{worker}/stat").read_text():
            return
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    raise AssertionError("the worker outlived its parent")


@pytest.fixture
def disk(tmp_path):
    """Folder on a disk of 400 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if (
        os.name != "posix"
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(folder)], capture_output=True, check=False
        ).returncode
    ):
        pytest.skip("no small disk can be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "plot pdf svg"])
def test_full_disk_keeps_the_earlier_results(place, asrsim_command, disk, name):
    arguments, _ = WRITERS[name]
    arguments = re.sub(r"--out out", "--out disk", arguments)
    if name != "init":
        asrsim_command(*arguments.split())
    before = {path: path.read_bytes() for path in disk.rglob("*") if path.is_file()}
    filler = os.open(disk / "filler", os.O_WRONLY | os.O_CREAT)
    for size in (4096, 1):
        with suppress(OSError):
            while os.write(filler, bytes(size)):
                pass
    os.close(filler)
    outcome = asrsim_command(*arguments.split())
    assert outcome.code == 1
    assert "No space left" in outcome.err
    assert "unexpected" not in outcome.err
    after = {path: path.read_bytes() for path in disk.rglob("*") if path.is_file() and path.name != "filler"}
    assert after == before
