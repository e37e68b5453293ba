"""Command-line options that several commands have, and the conversion of the options' values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from asrsim.cli import complete

if TYPE_CHECKING:
    from asrsim.recordings.align import LagChoice

Texts = list[str] | None
"""Type of an option for texts that may be repeated."""
Files = list[Path] | None
"""Type of an option for files that may be repeated."""


def option(words: str, *names: str, default: str | None = None, **details: Any) -> Any:
    """Option of a command.

    words: help text. names: long and short names; by default, the name of the parameter. default: description of the
    default value; "": the help shows no default; None: the help shows the value itself. details: further arguments of
    `typer.Option`.
    """
    shown = True if default is None else default or False
    return typer.Option(*names, help=words, show_default=shown, **details)


def argument(metavar: str, words: str, **details: Any) -> Any:
    """Argument of a command. words: help text; details: further arguments of `typer.Argument`."""
    return typer.Argument(metavar=metavar, help=words, show_default=False, **details)


Scenario = Annotated[Path, argument("SCENARIO", "Scenario file (YAML).")]
Variant = Annotated[str | None, option("Variant of the scenario.", default="the only one", autocompletion=complete.variants)]
Variants = Annotated[
    Texts,
    option("This variant only; may be repeated.", "--variant", default="all", autocompletion=complete.variants),
]
Arguments = Annotated[Texts, option("A xacro argument; may be repeated.", "--arg", metavar="NAME=VALUE")]
Packages = Annotated[Texts, option("Folder of a ROS package; may be repeated.", "--package", metavar="NAME=FOLDER")]
Overrides = Annotated[Texts, option("Replace a key of the scenario; may be repeated.", "--set", metavar="KEY=VALUE")]
ColumnMap = Annotated[
    Texts,
    option(
        "Meaning of a column of the recording, or a YAML file with the meanings of columns.",
        "--map",
        metavar="COLUMN=JOINT.QUANTITY",
    ),
]
Rate = Annotated[float | None, option("Sampling rate of a recording without time column, Hz.")]
Align = Annotated[
    str, option("How the recording's time is aligned with the simulation's time.", "--align", metavar="auto|off|start|SECONDS")
]
View = Annotated[bool, option("Show the robot in a browser, as `asrsim view` does.", "--view")]
Plot = Annotated[bool, option("Draw pictures.", "--plot/--no-plot")]
Overwrite = Annotated[bool, option("Also replace results that another scenario or study wrote.", "--overwrite")]
Start = Annotated[float | None, option("Start of the pictures, s.", default="the log's start")]
End = Annotated[float | None, option("End of the pictures, s.", default="the log's end")]


_OF_FILES = (".mcap", ".yaml", ".yml", ".json", ".csv", ".html", ".png", ".pdf", ".svg", ".gif", ".mp4", ".urdf", ".parquet")
"""Suffixes of the files that asrsim reads or writes, by which a file is recognised where a folder is needed."""


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


def pairs(texts: Sequence[str] | None, flag: str) -> dict[str, str]:
    """Values by name, parsed from the texts NAME=VALUE of the option `flag`. Raises typer's BadParameter."""
    found = {}
    for text in texts or ():
        # Accept `:=` instead of `=`, since ROS uses `:=`.
        name, separator, value = text.replace(":=", "=", 1).partition("=")
        if not separator or not name:
            raise typer.BadParameter(f"'{text}' is not NAME=VALUE", param_hint=flag)
        found[name] = value
    return found


def folders(texts: Sequence[str] | None, flag: str) -> dict[str, Path]:
    """Folders by name, parsed from the texts NAME=FOLDER of the option `flag`. Raises typer's BadParameter."""
    return {name: Path(folder) for name, folder in pairs(texts, flag).items()}


def lag_of(text: str) -> LagChoice:
    """Parsed value of the option `--align`. Raises typer's BadParameter."""
    if text in ("auto", "off", "start"):
        return text  # type: ignore[return-value]
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"'{text}' must be auto, off, start or a number of seconds", param_hint="--align") from None
