"""Writing figures to files."""

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
"""Of pictures by format: the mark by which we know our own. No dates: the same log gives the same file."""


def check_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """The formats without repetitions; raises InputError for one that we do not write."""
    unknown = [name for name in formats if name not in FORMATS]
    if unknown:
        raise InputError(
            Problem(f"no picture format is called '{name}'", key="format", choices=FORMATS,
                    meant=name, code="unknown-format")
            for name in unknown
        )  # fmt: skip
    return tuple(dict.fromkeys(formats))


def load_undocumented() -> None:
    """Load Matplotlib without the lists of properties in its documentation, a sixth of a picture's time: for a process in
    which nobody will read them. Where it is loaded already, nothing happens."""
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
    """Our look, for making and writing figures; the user's settings come back afterwards.

    mathematics: whether text between dollars is a formula. Without it, names of users' files need not be escaped.
    """
    import matplotlib

    from asrsim.plots.style import RC

    settings: Any = {**RC, "text.parse_math": mathematics}
    with matplotlib.rc_context(settings):
        yield


def save_figure(figure: Figure, folder: Path, name: str, formats: Sequence[str]) -> list[Path]:
    """Writes a figure as `folder/name.format` for each format; call it inside :func:`styled`. Raises OutputError."""
    paths = []
    for kind in formats:
        path = folder / f"{name}.{kind}"
        # Compressing harder takes longer than all of the drawing.
        more: dict[str, Any] = {"pil_kwargs": {"compress_level": 2}} if kind == "png" else {}
        with written(path, "picture") as stream, warnings.catch_warnings():
            # A joint may be called in letters that the font has not; boxes in a picture are no news for a terminal.
            warnings.filterwarnings("ignore", message="Glyph ")
            figure.savefig(stream, format=kind, metadata=METADATA[kind], **more)
        paths.append(path)
    return paths
