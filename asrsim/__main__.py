"""Command line `asrsim`, `python -m asrsim`. Ctrl-C gives a message at any time, also during the imports."""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Entry point of the script `asrsim`. It also reports interruptions before and after the command itself."""
    try:
        from asrsim.cli.app import main as call

        call()
    except KeyboardInterrupt:
        sys.stderr.write("asrsim: aborted\n")
        sys.exit(130)
    finally:
        # All files are written. After this line, a signal would only end Python without a message and with another exit code.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Clear the flag of an interrupted `exec` (dataclasses use it): with this flag, Python would end by SIGINT.
        exec("pass")


if __name__ == "__main__":
    main()
