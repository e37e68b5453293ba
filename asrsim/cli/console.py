"""Functions that print lines and tables for all commands, with styles on a terminal and as plain text elsewhere."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from asrsim.errors import AsrsimError, InputError, Problem, listed, printable, shortened
from asrsim.plain import finite_or_none, mapped
from asrsim.tables import TableColumn, from_rows

if TYPE_CHECKING:
    from asrsim.recordings import Recording

STYLES = {"bold": "1", "dim": "2", "red": "31", "green": "32", "yellow": "33", "bold red": "1;31", "bold cyan": "1;36"}
"""ANSI escape code of each text style."""
MOST = 40
"""Largest number of lines that are printed for one error."""
COLUMNS = 40
"""Largest number of a recording's columns that are listed, since a file may have thousands of columns."""
NARROWEST = 20
"""Smallest width of a table's last column, characters."""
SHOWN = 6
"""Largest number of file positions listed for a problem that occurs at several positions."""
VALUES = 3
"""Largest number of values listed for a problem that occurs with several values."""


OWN_CODES = re.compile(r"(\x1b\[[0-9;]*m)")
"""ANSI escape codes that set colours and text styles."""
MOVING_CODES = re.compile(r"(\x1b\[(?:[0-9;]*m|[0-9]*[AK]|\?25[lh])|\r)")
"""Escape codes that asrsim itself prints: colours, and on stderr the cursor movements of progress bars."""


class CleanStream:
    """Text stream that removes control characters in texts from files, names and values."""

    def __init__(self, stream: IO[str], allowed: re.Pattern[str]) -> None:
        self._stream = stream
        self._allowed = allowed

    def write(self, text: str) -> int:
        """Write the text without control characters, except the escape codes that asrsim prints."""
        parts = self._allowed.split(text)
        parts[::2] = [printable(part) for part in parts[::2]]
        return self._stream.write("".join(parts))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def clean_streams() -> None:
    """Make stdout and stderr remove control characters, and replace characters that the terminal's encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if not isinstance(sys.stdout, CleanStream):
        sys.stdout = cast("IO[str]", CleanStream(sys.stdout, OWN_CODES))
    if not isinstance(sys.stderr, CleanStream):
        sys.stderr = cast("IO[str]", CleanStream(sys.stderr, MOVING_CODES))


def is_terminal(stream: IO[str] | None = None) -> bool:
    """Whether the stream (stdout by default) is a terminal."""
    stream = sys.stdout if stream is None else stream
    return bool(stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb")


def styled(text: str, style: str, stream: IO[str] | None = None) -> str:
    """Text in a style of `STYLES`; unchanged without a terminal or if NO_COLOR is set."""
    if not text or not style or os.environ.get("NO_COLOR") or not is_terminal(stream):
        return text
    return f"\x1b[{STYLES[style]}m{text}\x1b[0m"


def say(text: str = "", style: str = "") -> None:
    """Print a line on stdout."""
    sys.stdout.write(styled(text, style) + "\n")


def complain(text: str, style: str = "") -> None:
    """Print a line on stderr."""
    sys.stderr.write(styled(text, style, sys.stderr) + "\n")


def say_json(data: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print a JSON document on stdout. Numbers that are not finite become null, which is how JSON writes undefined numbers. The
    data may contain NumPy arrays and numbers, paths, dataclasses, and objects with `as_dict`.
    """
    say(printable(json.dumps(mapped(data, _encoded), indent=2, ensure_ascii=not _unicode(), allow_nan=False)))


def _encoded(value: Any) -> Any:
    """A value as data for JSON."""
    if isinstance(value, float):
        return finite_or_none(float(value))
    if value is None or isinstance(value, str | int):
        return value
    for method in ("as_dict", "tolist"):
        if hasattr(value, method):
            return mapped(getattr(value, method)(), _encoded)
    if is_dataclass(value):
        return mapped({one.name: getattr(value, one.name) for one in fields(value)}, _encoded)
    return os.fspath(value)


def say_table(columns: Sequence[TableColumn], styles: Sequence[str] = ()) -> None:
    """Print a table. Its last column is wrapped at the terminal's width. styles: text style of each row."""
    heads = [one.heading.split("\n") for one in columns]
    height = max(map(len, heads))
    rows = [[[""] * (height - len(head)) + head for head in heads]]
    rows += [[[cell] for cell in cells] for cells in zip(*(one.cells for one in columns), strict=True)]
    widths = [max(map(len, (text for row in rows for text in row[i]))) for i in range(len(columns))]
    widths[-1] = min(widths[-1], max(line_width() - sum(widths[:-1]) - 2 * len(widths), NARROWEST))
    rows.insert(1, [[("─" if _unicode() else "-") * width] for width in widths])
    for row, style in zip_longest(rows, ("bold", "dim", *styles), fillvalue=""):
        last = [part for text in row[-1] for part in textwrap.wrap(text, widths[-1], break_on_hyphens=False) or [""]]
        for texts in zip_longest(*row[:-1], last, fillvalue=""):
            cells = [
                text.rjust(width) if one.right else text.ljust(width)
                for text, width, one in zip(texts, widths, columns, strict=True)
            ]
            say(("  " + "  ".join(cells)).rstrip(), style)


def say_columns(recording: Recording) -> None:
    """Print a table of the recording's columns that are mapped to quantities, and the names of its other columns."""
    used = [column for column in recording.channels.values() if column.quantity]
    if used:
        headings = ("column", "read as", "unit", "conversion", "why")
        cells = [[r.source, r.meaning, r.unit, r.conversion, r.origin] for r in used[:COLUMNS]]
        say_table(from_rows(headings, cells))
        if len(used) > COLUMNS:
            say(f"  and {len(used) - COLUMNS} more", "dim")
    others = [column.source for column in recording.channels.values() if not column.quantity]
    if others:
        say(f"  not used: {listed(others, COLUMNS)}", "dim")


def line_width() -> int:
    """Width of a terminal line in characters; unlimited if the output is not a terminal."""
    return shutil.get_terminal_size().columns if is_terminal() else sys.maxsize


def say_written(paths: Sequence[Path], remark: str = "") -> None:
    """Print the files that a command wrote: their common folder and their names. remark: end of the line."""
    if paths:
        folder = Path(os.path.commonpath([path.parent for path in paths]))
        say(f"wrote {folder}{os.sep}: {', '.join(str(path.relative_to(folder)) for path in paths)}{remark}")


def say_problems(problems: Sequence[Problem], word: str) -> None:
    """Print one line per problem, warnings on stderr; problems that differ only in their position in the file share a line."""
    for line in problem_lines(problems):
        if word == "warning":  # stdout contains only results, which other programs may read
            complain(f"{styled(word, 'yellow', sys.stderr)} {line}")
        else:
            say(f"{styled(word, 'yellow')} {line}")


def problem_lines(problems: Sequence[Problem]) -> list[str]:
    """One text per problem; problems that differ only in their position in the file share a text."""
    groups: dict[tuple[object, ...], list[Problem]] = {}
    for problem in problems:
        groups.setdefault((problem.code, problem.message, problem.hint, problem.choices, problem.file), []).append(problem)
    return [_joined(group) for group in groups.values()]


def error_lines(error: AsrsimError) -> list[str]:
    """Lines of an error message, at most `MOST` lines."""
    lines = str(error).splitlines()
    if len(lines) > MOST:
        lines[MOST:] = [f"... and {len(lines) - MOST} more"]
    return lines


def _joined(group: Sequence[Problem]) -> str:
    first = group[0]
    if len(group) == 1:
        return str(first)
    places = [_place(problem) for problem in group]
    values = dict.fromkeys(shortened(repr(problem.value)) for problem in group if problem.value is not None)
    message = f"{first.message} (got {listed(values, VALUES)})" if values else first.message
    return str(replace(first, message=message, key=listed(places, SHOWN), line=None, value=None))


def _place(problem: Problem) -> str:
    """Key and line of a problem. A missing key has only a line."""
    if problem.line is None:
        return problem.key or ""
    return f"{problem.key} (line {problem.line})" if problem.key else f"line {problem.line}"


def error_as_dict(error: AsrsimError) -> dict[str, Any]:
    """Error as data for `--json`."""
    items: dict[str, Any] = {"kind": type(error).__name__, "message": str(error)}
    if isinstance(error, InputError):
        items["problems"] = error.problems
    return items


@contextmanager
def json_errors(json: bool) -> Iterator[None]:
    """Context manager that prints an expected error (exit code 1) or an interruption as JSON on stdout if `json` is set."""
    try:
        yield
    except AsrsimError as error:
        if not json:
            raise
        import typer

        say_json({"ok": False, "errors": [error_as_dict(error)]})
        raise typer.Exit(1) from error
    except KeyboardInterrupt:
        if json:
            say_json({"ok": False, "errors": [{"message": "interrupted"}]})
        raise


def _unicode() -> bool:
    return (getattr(sys.stdout, "encoding", None) or "").lower().replace("-", "") in ("utf8", "utf16", "utf32")
