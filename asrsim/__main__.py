"""`python -m asrsim`: the command line, where the script is not on the path."""

from __future__ import annotations

from asrsim.cli.app import main

if __name__ == "__main__":
    main()
