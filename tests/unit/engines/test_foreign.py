"""What C libraries print does not reach our streams, whenever they flush it and whoever else is at work."""

import os
import subprocess
import sys
from pathlib import Path

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
with quiet(), quiet():
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
    """Nothing of what is written inside comes out, however deep; all before and after it does."""
    from asrsim.engines.foreign import quiet

    def write(text):
        for number in (1, 2):
            os.write(number, text.encode())

    def opened():
        """Descriptors of the process, where the system tells."""
        return len(list(DESCRIPTORS.iterdir())) if DESCRIPTORS.is_dir() else 0

    open_before = opened()
    for turn in range(2):
        write(f"before {turn};")
        with quiet():
            write("one")
            with quiet():
                write("two")
            write("three")
        write(f"after {turn};")
    said = "before 0;after 0;before 1;after 1;"
    assert capfd.readouterr() == (said, said)
    assert opened() == open_before


INTERRUPTED = """
import os, sys
from asrsim.engines import foreign

real, nested = {name: getattr(os, name) for name in ("dup", "dup2", "open", "close")}, False

def wrapped(call):
    def among(*values):
        global nested
        if not nested:
            nested = True
            with foreign.quiet():
                pass
            nested = False
        return call(*values)
    return among

flush = foreign._flush
for name, call in real.items():
    setattr(os, name, wrapped(call))
foreign._flush = wrapped(flush)
with foreign.quiet():
    os.write(1, b"unheard")
os.write(1, b"heard;")

def interrupted():
    raise KeyboardInterrupt

try:
    with foreign.quiet():
        foreign._flush = interrupted
except KeyboardInterrupt:
    os.write(1, b"told")
foreign._flush = flush
with foreign.quiet():
    os.write(1, b"unheard")
os.write(1, b" again")
"""


def test_engines_and_interrupts_may_end_a_call_at_any_time():
    """The collector ends what nobody holds any more, in the middle of anything: that waits for nobody, and no word is lost."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=20, check=True)
    assert done.stdout == "heard;told again"
