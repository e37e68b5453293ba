"""The one tree of errors, and the problem: a fault of an input, placed and with its cure.

Errors are raised at the boundary (a file that is read, a command that is typed) and collect *all* problems of a file.
The library raises them and never prints; the command line prints them and exits with 1.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from typing import Unpack

CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Characters that a terminal obeys and does not show, or by which it shows others in another order; not tab and newline."""


def printable(text: str) -> str:
    """The text with its control characters as escapes (JSON's, so that a JSON document stays what it is)."""
    return CONTROL.sub(lambda found: f"\\u{ord(found.group()):04x}", text)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One fault of an input (an error) or one thing to know about it (a warning)."""

    message: str = field(kw_only=False)
    """What is wrong, a sentence without a full stop."""
    file: Path | None = None
    line: int | None = None
    """Line in the file, counted from 1."""
    key: str | None = None
    """Dotted path of the key, tag or column, as the user wrote it."""
    value: object | None = None
    choices: tuple[str, ...] = ()
    """All valid choices, where there is a short list of them."""
    hint: str | None = None
    """What to do about it."""
    meant: str | None = None
    """A name that is none of the choices: the hint is the one that looks most like it."""
    code: str = ""
    """A stable short name of the kind of problem, such as `unknown-tag`, for machines."""

    def __post_init__(self) -> None:
        if self.meant is not None and self.hint is None:
            object.__setattr__(self, "hint", did_you_mean(self.meant, self.choices))

    def __str__(self) -> str:
        place = ""
        if self.file is not None:
            place = f"{self.file}:{self.line}: " if self.line is not None else f"{self.file}: "
        text = place + (f"{self.key}: " if self.key else "") + self.message
        if self.value is not None:
            text += f" (got {_short(repr(self.value))})"
        if self.choices:
            text += f"; choose from {', '.join(self.choices)}"
        if self.hint:
            text += f"{'' if text.endswith('?') else '.'} {self.hint}"
        return printable(text).replace("\n", "\\n")

    def as_dict(self) -> dict[str, object]:
        """For `--json`: plain values only, empty ones left out."""
        items: dict[str, object] = {
            "code": self.code,
            "message": self.message,
            "file": str(self.file) if self.file is not None else None,
            "line": self.line,
            "key": self.key,
            "value": None if self.value is None else str(self.value),
            "choices": list(self.choices),
            "hint": self.hint,
        }
        return {key: value for key, value in items.items() if value not in (None, "", [])}


def _short(text: str) -> str:
    """A value as it is shown: a file's one line may be a megabyte."""
    return text if len(text) <= 120 else f"{text[:100]} ... {len(text)} characters"


class AsrsimError(Exception):
    """Base of every error that asrsim raises on purpose."""


class Details(TypedDict, total=False):
    """What a :class:`Problem` says of a wrong value."""

    value: object | None
    choices: tuple[str, ...]
    hint: str | None
    meant: str | None


class Place(Details, total=False):
    """The same with where it stands."""

    line: int | None
    key: str | None


class InputError(AsrsimError):
    """An input (file, option) cannot be used; carries every problem found in it.

    problems: those, or the message of the only one, which the others complete. warnings: found on the way, not in its text.
    """

    def __init__(
        self,
        problems: Problem | Iterable[Problem] | str,
        *,
        warnings: Iterable[Problem] = (),
        file: Path | None = None,
        code: str = "",
        **place: Unpack[Place],
    ) -> None:
        if isinstance(problems, str):
            problems = Problem(problems, file=file, code=code, **place)
        self.problems: tuple[Problem, ...] = (problems,) if isinstance(problems, Problem) else tuple(problems)
        self.warnings: tuple[Problem, ...] = tuple(warnings)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class RobotError(InputError):
    """A URDF or xacro file cannot be simulated."""


class ActuatorError(InputError):
    """An actuator, ours or a user's, breaks its contract or does not exist."""


class ScenarioError(InputError):
    """A scenario file is invalid."""


class RecordingError(InputError):
    """A recording of an experiment cannot be read or compared."""


class LogError(InputError):
    """A log file cannot be read."""


class OutputError(AsrsimError):
    """A result cannot be written (folder, permissions, full disk)."""


class SimulationError(AsrsimError):
    """A run cannot be started or carried on."""


class UnresolvedSpringError(SimulationError):
    """A spring or damper is too stiff for the step within the cap on substeps."""


class DivergenceError(SimulationError):
    """The simulated motion left what physics allows."""

    def __init__(self, message: str, *, joint: str, time: float) -> None:
        super().__init__(message)
        self.joint = joint
        self.time = time
        self.run: object | None = None
        """The run up to there, where one was kept."""


def nearest(name: str, choices: Sequence[str]) -> str | None:
    """The choice that looks most like `name`, or None: for "did you mean"."""
    found = difflib.get_close_matches(name, choices, n=1, cutoff=0.6)
    return found[0] if found else None


def did_you_mean(name: str, choices: Sequence[str]) -> str | None:
    """A hint naming the nearest choice, or None."""
    found = nearest(name, choices)
    return f"Did you mean '{found}'?" if found else None


def listed(words: Iterable[object], most: int, between: str = ", ") -> str:
    """Words in a row: `a, b and 3 more`."""
    texts = [str(word) for word in words]
    return between.join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def similar_file(path: Path) -> str | None:
    """A hint naming the file that was perhaps meant by a path that is not there, or None."""
    try:
        names = [] if path.exists() else [one.name for one in path.parent.iterdir() if one.is_file()]
    except OSError:
        return None
    found = difflib.get_close_matches(path.name, names, n=1, cutoff=0.8)
    return f"Did you mean '{path.with_name(found[0])}'?" if found else None
