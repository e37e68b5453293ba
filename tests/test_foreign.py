"""What C libraries print does not reach our streams, whenever they flush it and whoever else is at work."""

from __future__ import annotations

import subprocess
import sys

PRINTING = """
import ctypes, sys, threading
from asrsim.engines.foreign import crashes, quiet
c = ctypes.CDLL(None)

def work():
    for _ in range(200):
        with quiet():
            c.printf(b"foreign text\\n")

threads = [threading.Thread(target=work) for _ in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
with quiet(), quiet():
    c.printf(b"foreign text\\n")
assert not crashes(lambda: [c.printf(b"foreign text\\n") for _ in range(5000)])
assert crashes(lambda: c.abort())
sys.stdout.write("ours\\n")
sys.stderr.write("ours too\\n")
"""


def test_nothing_of_theirs_comes_out() -> None:
    done = subprocess.run([sys.executable, "-c", PRINTING], capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout, done.stderr) == ("ours\n", "ours too\n")


def test_a_closed_stream_is_no_trouble() -> None:
    code = "from asrsim.engines.foreign import quiet\nwith quiet(): pass\n"
    subprocess.run(f"{sys.executable} -c '{code}' >&-", shell=True, timeout=60, check=True)
