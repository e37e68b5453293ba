"""All error classes, and `Problem`: a fault of an input with its position in the file and a remedy.

Errors are raised where input is read (a file, a command line) and list *all* problems of a file.
The library raises errors and prints nothing; the command line prints them and exits with code 1.
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

CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters that a terminal executes, or that change the order of text (without tab and newline); lone surrogates."""


def printable(text: str) -> str:
    """Text with its control characters as JSON escapes, so that a JSON document stays valid."""
    return CONTROL.sub(lambda found: f"\\u{ord(found.group()):04x}", text)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Fault of an input (in an error), or notice about an input (in a warning)."""

    message: str = field(kw_only=False)
    """Description of the fault, a sentence without a full stop."""
    file: Path | None = None
    line: int | None = None
    """Line in the file, counted from 1."""
    key: str | None = None
    """Dotted path of the key, tag or column, as the user wrote it."""
    value: object | None = None
    choices: tuple[str, ...] = ()
    """All valid choices for the invalid value, if they are few."""
    hint: str | None = None
    """Remedy for the problem, in a sentence to the user."""
    meant: str | None = None
    """Unknown name in the input. If it is given, the hint suggests the choice that is most similar to this name."""
    code: str = ""
    """Short name of the problem's kind, such as `unknown-tag`, which programs can rely on."""

    def __post_init__(self) -> None:
        if self.meant is not None and self.hint is None:
            object.__setattr__(self, "hint", did_you_mean(self.meant, self.choices))

    def __str__(self) -> str:
        place = ""
        if self.file is not None:
            place = f"{self.file}:{self.line}: " if self.line is not None else f"{self.file}: "
        text = place + (f"{self.key}: " if self.key else "") + self.message
        if self.value is not None:
            value = str(self.value) if isinstance(self.value, Path) else self.value
            text += f" (got {shortened(repr(value))})"
        if self.choices:
            text += f"; choose from {', '.join(folded(self.choices))}"
        if self.hint:
            text += f"{'' if text.endswith('?') else '.'} {self.hint}"
        return printable(text).replace("\n", "\\n")

    def as_dict(self) -> dict[str, object]:
        """The problem as data for `--json`, without entries that are empty."""
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


def shortened(text: str) -> str:
    """Text of a value for a message. It is shortened, since one line of a file may be a megabyte long."""
    return text if len(text) <= 120 else f"{text[:100]} ... {len(text)} characters"


class AsrsimError(Exception):
    """Base class of all errors that asrsim raises on purpose."""


class Details(TypedDict, total=False):
    """Fields of a `Problem` that describe an invalid value."""

    value: object | None
    choices: tuple[str, ...]
    hint: str | None
    meant: str | None


class Place(Details, total=False):
    """Fields of a `Problem` that describe an invalid value and its position in the file."""

    line: int | None
    key: str | None


class InputError(AsrsimError):
    """An input (file, option) is invalid; the error lists all its problems.

    problems: list of problems, or the message of a single problem. In the second case, the other arguments are further fields
    of this problem. warnings: further findings about the input, which are not part of the error's text.
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
    """An actuator of asrsim or of a user is unknown or violates the required interface."""


class ScenarioError(InputError):
    """A scenario file is invalid."""


class RecordingError(InputError):
    """A recording of an experiment cannot be read, or cannot be compared with a simulation."""


class LogError(InputError):
    """A log file cannot be read."""


class OutputError(AsrsimError):
    """A result cannot be written (folder, permissions, full disk)."""


class SimulationError(AsrsimError):
    """A run cannot be started or continued."""


class UnresolvedSpringError(SimulationError):
    """A spring or damper is too stiff for the step, even with the largest permitted number of substeps."""


class DivergenceError(SimulationError):
    """The simulated motion became physically impossible. `joint` is the name of the joint at fault, empty if no single joint is
    at fault; `time` is the simulated time in s.
    """

    def __init__(self, message: str, *, joint: str, time: float) -> None:
        super().__init__(message)
        self.joint = joint
        self.time = time
        self.run: object | None = None
        """Run up to the divergence, if its samples were kept in memory; else None."""


def nearest(name: str, choices: Sequence[str]) -> str | None:
    """Choice that is most similar to `name`, for "did you mean"; None if no choice is similar."""
    found = difflib.get_close_matches(name, choices, n=1, cutoff=0.6)
    return found[0] if found else None


def did_you_mean(name: str, choices: Sequence[str]) -> str | None:
    """Hint that suggests the choice most similar to `name`; None if no choice is similar."""
    found = nearest(name, choices)
    return f"Did you mean '{found}'?" if found else None


def hint_of_own(name: str, choices: Sequence[str], own: str) -> str:
    """Hint for an unknown name: the choice most similar to it, and that `own` parts of a user need a plugin file."""
    return f"{did_you_mean(name, choices) or ''} Your own {own} need --plugin FILE".strip()


def folded(names: Sequence[str], most: int = 20) -> list[str]:
    """The names. If there are more than `most`, names that differ only in a number become one: `motor_{1..8}_torque`."""
    if len(names) <= most:
        return list(names)
    families: dict[str, list[str]] = {}
    for name in names:
        before, number, after = re.fullmatch(r"(\D*)(\d*)(.*)", name, re.DOTALL).groups()  # type: ignore[union-attr]
        families.setdefault(f"{before}{{}}{after}" if number else name, []).append(number)
    return [
        family if numbers == [""] else family.replace("{}", numbers[0] if len(numbers) == 1 else _span(numbers), 1)
        for family, numbers in families.items()
    ]


def _span(numbers: Sequence[str]) -> str:
    """Numbers in braces: `{1..8}` for consecutive numbers, `{1,2}` for others."""
    whole = len(numbers) > 2 and [str(int(numbers[0]) + i) for i in range(len(numbers))] == list(numbers)
    return f"{{{numbers[0]}..{numbers[-1]}}}" if whole else f"{{{','.join(numbers)}}}"


def listed(words: Iterable[object], most: int, between: str = ", ") -> str:
    """Words as a list in a sentence, of which at most `most` are written out: `a, b and 3 more`."""
    texts = [str(word) for word in words]
    return between.join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def counted(number: int, noun: str) -> str:
    """Number followed by the noun, which gets a plural s unless the number is 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def similar_file(path: Path) -> str | None:
    """Hint with the name of a similar file in the same folder, for a path that does not exist; None if no file is similar."""
    try:
        names = [] if path.exists() else [one.name for one in path.parent.iterdir() if one.is_file()]
    except OSError:
        return None
    found = difflib.get_close_matches(path.name, names, n=1, cutoff=0.8)
    return f"Did you mean '{path.with_name(found[0])}'?" if found else None
