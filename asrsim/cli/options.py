"""Options that several commands share, and what is made of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from asrsim.recordings.align import LagChoice

Plugins = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin", metavar="FILE", help="Python file with your own actuators, signals, measures, readers; may be repeated."
    ),
]
Arguments = Annotated[list[str] | None, typer.Option("--arg", metavar="NAME=VALUE", help="A xacro argument; may be repeated.")]
Packages = Annotated[
    list[str] | None, typer.Option("--package", metavar="NAME=FOLDER", help="Where a ROS package is; may be repeated.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replace a key of the scenario; may be repeated.")
]
ColumnMap = Annotated[
    list[str] | None,
    typer.Option("--map", metavar="COLUMN=JOINT.QUANTITY", help="What a column of the recording is, or a YAML file of it."),
]
Rate = Annotated[float | None, typer.Option(help="Hz, sampling rate of a recording without time.")]
Align = Annotated[
    str, typer.Option("--align", "--lag", metavar="auto|off|start|SECONDS", help="How the recording's time is moved.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document, and nothing else, on stdout.")]
Start = Annotated[float | None, typer.Option(help="s, where the pictures begin.", show_default="the log's start")]
End = Annotated[float | None, typer.Option(help="s, where they end.", show_default="the log's end")]


_OF_FILES = (".mcap", ".yaml", ".yml", ".json", ".csv", ".html", ".png", ".pdf", ".svg", ".gif", ".mp4", ".urdf", ".parquet")
"""How names of files end that our commands write or read."""


def into_folder(words: str, default: str | None = None) -> Any:
    """`--out` of a command that writes several files; default: its folder, where that depends on the others."""

    def check(given: Path | None) -> Path | None:
        if given is not None and given.suffix.lower() in _OF_FILES and not given.is_dir():
            raise typer.BadParameter(f"is the name of a folder, and {given.name} reads like a file's")
        return given

    return typer.Option("--out", "-o", help=words, show_default=default or True, callback=check)


def into_file(words: str, *endings: str, default: str | None = None) -> Any:
    """`--out` of a command that writes one file, whose name ends so."""

    def check(given: Path | None) -> Path | None:
        if given is not None and given.suffix.lower() not in endings:
            raise typer.BadParameter(f"is the name of a file that ends in {' or '.join(endings)}, not {given.name}")
        return given

    return typer.Option("--out", "-o", help=words, show_default=default or True, callback=check)


def check_window(start: float | None, end: float | None) -> None:
    """A window of time that has an inside. Raises typer's BadParameter."""
    for name, value in (("--start", start), ("--end", end)):
        if value is not None and not math.isfinite(value):
            raise typer.BadParameter("must be a number of seconds", param_hint=name)
    if start is not None and end is not None and not end > start:
        raise typer.BadParameter(f"must be after --start {start:g}", param_hint="--end")


def load_plugins(paths: Sequence[Path] | None) -> None:
    """Register the actuators of users' files. Raises ActuatorError."""
    if paths:
        from asrsim.actuators.user import load_plugin_file

        for path in paths:
            load_plugin_file(path)


def pairs(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """NAME=VALUE texts of `option` as a table. Raises typer's BadParameter."""
    found = {}
    for text in texts or ():
        # `:=` is how ROS writes it.
        name, separator, value = text.replace(":=", "=", 1).partition("=")
        if not separator or not name:
            raise typer.BadParameter(f"'{text}' is not NAME=VALUE", param_hint=option)
        found[name] = value
    return found


def folders(texts: Sequence[str] | None, option: str) -> dict[str, Path]:
    """NAME=FOLDER texts of `option`, likewise."""
    return {name: Path(folder) for name, folder in pairs(texts, option).items()}


def mapping_of(texts: Sequence[str] | None) -> tuple[str, ...] | Path | None:
    """What `--map` says: columns, or one YAML file of them."""
    if texts and len(texts) == 1 and Path(texts[0]).suffix.lower() in (".yaml", ".yml") and Path(texts[0]).is_file():
        return Path(texts[0])
    return tuple(texts) if texts else None


def lag_of(text: str) -> LagChoice:
    """What `--align` says. Raises typer's BadParameter."""
    if text in ("auto", "off", "start"):
        return text  # type: ignore[return-value]
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is none of auto, off, start and no number of seconds", param_hint="--align"
        ) from None
