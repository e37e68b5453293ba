"""Worker processes: results, repeated crashes, errors, and the end of the processes."""

import math
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from asrsim.workers import Lost
from asrsim.workers.local import Processes
from support.paths import EXAMPLES, ROOT

ITEMS = ["1", "__import__('os')._exit(9)", "3"]


def in_order(workers, task, items):
    return [result for _, result in sorted(pair for some in workers.results(task, items) for pair in some)]


@pytest.fixture(scope="module")
def workers():
    with Processes(2) as made:
        yield made


def test_results_come_in_order_each_once(workers):
    assert in_order(workers, math.sqrt, range(2000)) == [math.sqrt(n) for n in range(2000)]


def test_an_exception_of_a_task_is_raised_and_workers_continue(workers):
    with pytest.raises(ValueError, match="math domain"):
        in_order(workers, math.sqrt, [4.0, -1.0, 9.0])
    assert in_order(workers, abs, [-1, 2]) == [1, 2]


def test_nothing_is_done_of_what_nobody_wants(workers):
    assert in_order(workers, math.sqrt, []) == []
    assert list(workers.results(math.sqrt, [4.0], stop=lambda: True)) == []
    assert in_order(workers, abs, [-3]) == [3]


def test_workers_find_plugins_of_a_program_that_went_to_another_folder(tmp_path, monkeypatch):
    shutil.copy(EXAMPLES / "plugins" / "my_vsa.py", tmp_path)
    monkeypatch.chdir(tmp_path)
    with Processes(1, plugins=[Path("my_vsa.py")]) as workers:
        monkeypatch.chdir(ROOT)
        assert in_order(workers, is_actuator, ["my_vsa", "my_other_vsa"]) == [True, False]


def is_actuator(name):
    from asrsim.actuators import ACTUATORS

    return name in ACTUATORS.names()


def test_running_items_are_not_lost_when_the_work_stops(tmp_path):
    """Each item writes a file when it is finished."""
    items = [str(tmp_path / f"{n}") for n in range(40)]
    found = []
    with Processes(2) as workers:
        for some in workers.results(slow, items, stop=lambda: found != []):
            found.extend(number for number, _ in some)
    assert 1 < len(found) < 40
    assert {path.name for path in tmp_path.iterdir()} == set(map(str, found))


def slow(path):
    time.sleep(0.3)
    Path(path).touch()


PROGRAM = """
import signal
from asrsim.workers.local import Processes
signal.signal(signal.SIGINT, lambda *_: None)
print(flush=True)
with Processes(2) as workers:
    print(sum(len(some) for some in workers.results(abs, [-1] * 4)))
"""


def test_ctrl_c_reaches_no_worker_even_as_it_starts():
    command = [sys.executable, "-c", PROGRAM]
    how = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "start_new_session": True}
    with subprocess.Popen(command, **how) as process:
        process.stdout.readline()
        while process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.02)
        assert process.stdout.read() == "4\n"


def test_an_item_that_kills_its_workers_is_lost_alone():
    with Processes(2) as workers:
        found = dict(one for some in workers.results(eval, ITEMS) for one in some)
        assert (found[0], found[2]) == (1, 3)
        assert isinstance(found[1], Lost)
        assert "3 workers died" in found[1].reason
        assert "EXIT(9)" in found[1].reason
        pids = in_order(workers, eval, ["__import__('os').getpid()"] * 4)
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
