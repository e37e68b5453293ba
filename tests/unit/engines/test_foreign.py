"""C libraries print nothing to our streams, also from several threads and from buffers that are flushed late."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from asrsim.engines import foreign

DESCRIPTORS = Path("/proc/self/fd")
PRINTING = """
import ctypes, sys, threading
from asrsim.engines.foreign import quiet
c = ctypes.CDLL(None)

def work():
    for _ in range(200):
        with quiet():
            c.printf(b"foreign text\\n")

threads = [threading.Thread(target=work) for _ in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
with quiet():
    c.printf(b"foreign text\\n")
sys.stdout.write("ours\\n")
sys.stderr.write("ours too\\n")
"""


def test_nothing_of_theirs_comes_out():
    done = subprocess.run([sys.executable, "-c", PRINTING], capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout, done.stderr) == ("ours\n", "ours too\n")


def test_a_closed_stream_is_no_trouble():
    code = "from asrsim.engines.foreign import quiet\nwith quiet(): pass\n"
    subprocess.run(f"{sys.executable} -c '{code}' >&-", shell=True, timeout=60, check=True)


def test_streams_are_what_they_were_once_the_last_has_left(capfd):
    """Output inside `quiet` is discarded; output before and after it is kept."""

    def write(text):
        for number in (1, 2):
            os.write(number, text.encode())

    def opened():
        """Number of the process's open files; 0 on systems that do not list them."""
        return len(list(DESCRIPTORS.iterdir())) if DESCRIPTORS.is_dir() else 0

    open_before = opened()
    for turn in range(2):
        write(f"before {turn};")
        with foreign.quiet():
            write("inside")
        write(f"after {turn};")
    said = "before 0;after 0;before 1;after 1;"
    assert capfd.readouterr() == (said, said)
    assert opened() == open_before


def test_an_interrupt_restores_the_streams(capfd, monkeypatch):
    """Ctrl-C may come while the streams are restored."""

    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), foreign.quiet():
        monkeypatch.setattr(foreign, "_flush", interrupted)
    os.write(1, b"heard;")
    monkeypatch.undo()
    with foreign.quiet():
        os.write(1, b"unheard")
    os.write(1, b"again")
    assert capfd.readouterr().out == "heard;again"
