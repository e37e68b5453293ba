"""Command-line options that several commands have, and the conversion of the options' values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from asrsim.recordings.align import LagChoice

Scenario = Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file (YAML).", show_default=False)]
Variant = Annotated[str | None, typer.Option(help="Variant of the scenario.", show_default="the only one")]
Variants = Annotated[
    list[str] | None,
    typer.Option("--variant", help="This variant only; may be repeated.", show_default="all"),
]
Arguments = Annotated[list[str] | None, typer.Option("--arg", metavar="NAME=VALUE", help="A xacro argument; may be repeated.")]
Packages = Annotated[
    list[str] | None, typer.Option("--package", metavar="NAME=FOLDER", help="Folder of a ROS package; may be repeated.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replace a key of the scenario; may be repeated.")
]
ColumnMap = Annotated[
    list[str] | None,
    typer.Option(
        "--map", metavar="COLUMN=JOINT.QUANTITY", help="Meaning of a column of the recording, or a YAML file with it."
    ),
]
Rate = Annotated[float | None, typer.Option(help="Sampling rate of a recording without time column, Hz.")]
Align = Annotated[
    str, typer.Option("--align", "--lag", metavar="auto|off|start|SECONDS", help="Alignment of the recording's time.")
]
Plot = Annotated[bool, typer.Option("--plot/--no-plot", help="Draw pictures.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Also replace results that another scenario or study wrote.")]
Start = Annotated[float | None, typer.Option(help="Start of the pictures, s.", show_default="the log's start")]
End = Annotated[float | None, typer.Option(help="End of the pictures, s.", show_default="the log's end")]


_OF_FILES = (".mcap", ".yaml", ".yml", ".json", ".csv", ".html", ".png", ".pdf", ".svg", ".gif", ".mp4", ".urdf", ".parquet")
"""Suffixes of files that asrsim reads or writes."""


def into_folder(words: str, default: str | None = None) -> Any:
    """Option `--out` of a command that writes several files; default: description of its default folder."""

    def fault(given: Path) -> str:
        a_file = given.suffix.lower() in _OF_FILES and not given.is_dir()
        return f"must be a folder, but {given.name} has the suffix of a file" if a_file else ""

    return _out(words, default, fault)


def into_file(words: str, *endings: str, default: str | None = None) -> Any:
    """Option `--out` of a command that writes one file with one of these suffixes."""

    def fault(given: Path) -> str:
        return "" if given.suffix.lower() in endings else f"must end in {' or '.join(endings)}, not {given.name}"

    return _out(words, default, fault)


def _out(words: str, default: str | None, fault: Callable[[Path], str]) -> Any:
    def check(given: Path | None) -> Path | None:
        if given is not None and (message := fault(given)):
            raise typer.BadParameter(message)
        return given

    return typer.Option("--out", "-o", help=words, show_default=default or True, callback=check)


def check_window(start: float | None, end: float | None) -> None:
    """Check that the end of a time window lies after its start. Raises typer's BadParameter."""
    if start is not None and end is not None and not end > start:
        raise typer.BadParameter(f"must be after --start {start:g}", param_hint="--end")


def pairs(texts: Sequence[str] | None, option: str) -> dict[str, str]:
    """Values by name, parsed from the texts NAME=VALUE of `option`. Raises typer's BadParameter."""
    found = {}
    for text in texts or ():
        # ROS uses `:=` instead of `=`.
        name, separator, value = text.replace(":=", "=", 1).partition("=")
        if not separator or not name:
            raise typer.BadParameter(f"'{text}' is not NAME=VALUE", param_hint=option)
        found[name] = value
    return found


def folders(texts: Sequence[str] | None, option: str) -> dict[str, Path]:
    """Folders by name, parsed from the texts NAME=FOLDER of `option`. Raises typer's BadParameter."""
    return {name: Path(folder) for name, folder in pairs(texts, option).items()}


def lag_of(text: str) -> LagChoice:
    """Parsed value of the option `--align`. Raises typer's BadParameter."""
    if text in ("auto", "off", "start"):
        return text  # type: ignore[return-value]
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"'{text}' must be auto, off, start or a number of seconds", param_hint="--align") from None
