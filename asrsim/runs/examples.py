"""The bundled examples: in the repository, or packed with the installed library."""

from __future__ import annotations

from pathlib import Path

from asrsim.errors import InputError, OutputError
from asrsim.outfile import make_folder, write_text

PLACES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[2] / "examples")
"""In an installed package; in a checkout."""


def examples_folder() -> Path:
    """The folder with `scenarios` and `urdf`. Raises InputError if this installation has none."""
    for place in PLACES:
        if (place / "scenarios").is_dir():
            return place
    raise InputError(
        "the example scenarios are missing from this installation",
        hint="Install asrsim anew, or run from a checkout of its repository",
        code="no-examples",
    )


def copy_examples(out: Path, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Copy all examples into `out`; gives the files written.

    Raises OutputError, with nothing written, where files of other content are in the way (unless `overwrite`).
    """
    source = examples_folder()
    pairs = {
        path: out / path.relative_to(source)
        for path in sorted(source.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts and not path.is_relative_to(out.absolute())
    }
    taken = [place for path, place in pairs.items() if place.exists() and place.read_bytes() != path.read_bytes()]
    if taken and not overwrite:
        more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
        raise OutputError(f"{taken[0]}{more} differ from the example; use --overwrite to replace, or --out for elsewhere")
    for path, place in pairs.items():
        if not place.exists() or place in taken:
            make_folder(place.parent)
            write_text(place, path.read_bytes().decode(), "schema", replace=True)
    return tuple(pairs.values())
