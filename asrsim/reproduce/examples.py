"""Where the example scenarios are: in the repository, or packed with the installed library."""

from __future__ import annotations

from pathlib import Path

from asrsim.errors import InputError, Problem

PLACES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[2] / "examples")
"""In an installed package; in a checkout."""


def examples_folder() -> Path:
    """The folder with `scenarios` and `urdf`. Raises InputError if this installation has none."""
    for place in PLACES:
        if (place / "scenarios").is_dir():
            return place
    raise InputError(
        Problem(
            message="the example scenarios are missing from this installation",
            hint="Install asrsim anew, or run from a checkout of its repository",
            code="no-examples",
        )
    )
