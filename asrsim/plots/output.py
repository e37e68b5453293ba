"""Writes figures to files."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.errors import InputError, Problem
from asrsim.outfile import written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("png", "pdf", "svg")
METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": "asrsim"},
    "pdf": {"Creator": "asrsim", "CreationDate": None},
    "svg": {"Creator": "asrsim", "Date": None},
}
"""Metadata of picture files by format: the mark that identifies files of asrsim. Dates are omitted, so that equal logs give
equal files.
"""


def check_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """Picture formats without repetitions; raises InputError for an unknown format."""
    unknown = [name for name in formats if name not in FORMATS]
    if unknown:
        raise InputError(
            Problem(f"no picture format is called '{name}'", key="format", choices=FORMATS, meant=name, code="unknown-format")
            for name in unknown
        )
    return tuple(dict.fromkeys(formats))


def load_undocumented() -> None:
    """Load Matplotlib without the property lists in its docstrings, which take a sixth of the drawing time. Call this function
    only in a process that does not show these docstrings. The function does nothing if Matplotlib is already loaded.
    """
    if "matplotlib.artist" not in sys.modules:
        from matplotlib import artist

        documented, artist.kwdoc = artist.kwdoc, lambda artist: ""
        try:
            import matplotlib.backends.backend_agg
            import matplotlib.figure  # noqa: F401
        finally:
            artist.kwdoc = documented


@contextmanager
def styled(*, mathematics: bool = True) -> Iterator[None]:
    """Apply asrsim's Matplotlib settings while figures are made and written; restore the user's settings afterwards.

    mathematics: whether text between dollar signs is a formula. If False, names from users' files need no escaping.
    """
    import matplotlib

    from asrsim.plots.style import RC

    settings: Any = {**RC, "text.parse_math": mathematics}
    with matplotlib.rc_context(settings):
        yield


def save_figure(figure: Figure, folder: Path, name: str, formats: Sequence[str]) -> list[Path]:
    """Write a figure as `folder/name.format` for each format; call this function inside `styled`. Raises OutputError."""
    paths = []
    for kind in formats:
        path = folder / f"{name}.{kind}"
        # Use a low compression level, since a higher level would take longer than the drawing.
        more: dict[str, Any] = {"pil_kwargs": {"compress_level": 2}} if kind == "png" else {}
        with written(path, "picture") as stream, warnings.catch_warnings():
            # Suppress the warning if the font lacks letters of a joint's name. Boxes are drawn instead of these letters.
            warnings.filterwarnings("ignore", message="Glyph ")
            figure.savefig(stream, format=kind, metadata=METADATA[kind], **more)
        paths.append(path)
    return paths
