"""`asrsim`, `python -m asrsim`: the command line; Ctrl-C is told of from the first import to the end of the process."""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Entry point of the script. An interruption that comes before the command, or behind it, finds nobody else."""
    try:
        from asrsim.cli.app import main as call

        call()
    except KeyboardInterrupt:
        sys.stderr.write("asrsim: aborted\n")
        sys.exit(130)
    finally:
        # All is done and written: Python's own end would only die of the signal, without a word and with another code.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        exec("pass")  # Python sends itself the signal again where text that it ran was interrupted last, as dataclasses have it


if __name__ == "__main__":
    main()
