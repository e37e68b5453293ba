"""Finds the examples that come with asrsim, in a checkout or in the installed package, and copies them."""

from __future__ import annotations

from pathlib import Path

from asrsim.errors import InputError, OutputError, listed
from asrsim.outfile import make_folder, write_text

PLACES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[2] / "examples")
"""Folder of the examples in an installed package, and folder of the examples in a checkout."""


def examples_folder() -> Path:
    """Folder of the examples, with the subfolders `scenarios` and `urdf`. Raises InputError if the installation lacks it."""
    for target in PLACES:
        if (target / "scenarios").is_dir():
            return target
    raise InputError(
        "the example scenarios are missing from this installation",
        hint="Reinstall asrsim, or run it from a checkout of its repository",
        code="no-examples",
    )


def copy_examples(out: Path, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Copy all examples into the folder `out`. Returns the paths of the copies.

    Raises OutputError and writes nothing if files of the same names have other content there, unless `overwrite` is given.
    """
    source = examples_folder()
    pairs = {
        path: out / path.relative_to(source)
        for path in sorted(source.rglob("*"))
        if path.is_file() and "__pycache__" not in path.parts and not path.is_relative_to(out.absolute())
    }
    differing = [target for path, target in pairs.items() if target.exists() and target.read_bytes() != path.read_bytes()]
    if differing and not overwrite:
        raise OutputError(
            f"{listed(differing, 1)} differ from the example; use --overwrite to replace them, or another folder with --out"
        )
    for path, target in pairs.items():
        if not target.exists() or target in differing:
            make_folder(target.parent)
            write_text(target, path.read_bytes().decode(), "schema", replace=True)
    return tuple(pairs.values())
