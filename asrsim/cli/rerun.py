"""`asrsim rerun`: repeats a run from its log alone and compares."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def rerun(
    log: Annotated[Path, typer.Argument(help="Log of a run (MCAP).", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the repeated run here too.", show_default="not written")
    ] = None,
) -> None:
    """Repeat.

    Example: asrsim rerun log.mcap
    """
