"""Numbers as they stand in tags: plain, infinite, or constant arithmetic such as `1.21*pow(10,-6)`.

The arithmetic is a small grammar of its own (nothing is handed to Python): numbers, + - * /, parentheses, signs and
`pow(x, y)`, with limits on length and depth.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from asrsim.robot.xmlfile import BLANKS

MAX_LENGTH = 200
"""Characters of a number or an expression in a tag."""
MAX_DEPTH = 20
"""Levels of brackets of an expression in a tag."""

_DIGITS = r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_BLANK = f"[{BLANKS}]*"
_TOKEN = re.compile(rf"{_BLANK}(?:(?P<number>{_DIGITS})|(?P<name>[A-Za-z_][A-Za-z_0-9]*)|(?P<sign>[-+*/(),]))")
_LEADING = re.compile(rf"{_BLANK}([+-]?{_DIGITS})")
_PLAIN = re.compile(rf"[+-]?(?:{_DIGITS}|inf|infinity|nan)", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Number:
    """A number read from text."""

    value: float
    arithmetic: bool = False
    """The text was an expression, of which the toolbox reads the leading number only."""
    comment: str = ""
    """Text after a `#` behind the number, left out."""


def plain_number(text: str) -> float:
    """The number that `text` is, ASCII digits only, with no blanks but XML's around it. Raises ValueError if it is none.

    Python's own `float` also takes underscores, other scripts' digits and their blanks, which engines read as another
    number or cut off; so nothing of a robot file goes through it without this.
    """
    body = text.strip(BLANKS)
    if not _PLAIN.fullmatch(body):
        raise ValueError("is not a number")
    return float(body)


def read_number(text: str) -> Number:
    """The number that `text` stands for. Raises ValueError with the reason, a phrase to stand behind the key."""
    body, _, comment = text.partition("#")
    body = body.strip(BLANKS)
    if not body:
        raise ValueError("is empty where a number is needed")
    if len(body) > MAX_LENGTH:
        raise ValueError(f"is longer than {MAX_LENGTH} characters")
    if _PLAIN.fullmatch(body):
        return Number(value=plain_number(body), comment=comment.strip(BLANKS))
    return Number(value=_Parser(body).parse(), arithmetic=True, comment=comment.strip(BLANKS))


def leading_number(text: str) -> float:
    """What the toolbox's Gazebo makes of the text: its leading number, 0 if there is none."""
    match = _LEADING.match(text)
    return float(match.group(1)) if match else 0.0


class _Parser:
    """Recursive descent over one expression."""

    def __init__(self, text: str) -> None:
        self._tokens: list[tuple[str, str]] = []
        position = 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None or match.lastgroup is None:
                raise ValueError("is not a number")
            self._tokens.append((match.lastgroup, match.group(match.lastgroup)))
            position = match.end()
        self._next = 0
        self._depth = 0

    def parse(self) -> float:
        try:
            value = self._sum()
        except ZeroDivisionError:
            raise ValueError("divides by zero") from None
        except OverflowError:
            raise ValueError("is too large for a number") from None
        if self._next != len(self._tokens):
            raise ValueError("is not a number")
        if not math.isfinite(value):
            raise ValueError("is not finite")
        return value

    def _peek(self) -> str:
        return self._tokens[self._next][1] if self._next < len(self._tokens) else ""

    def _take(self, expected: str | None = None) -> tuple[str, str]:
        if self._next >= len(self._tokens) or (expected is not None and self._peek() != expected):
            raise ValueError("is not a number")
        self._next += 1
        return self._tokens[self._next - 1]

    def _sum(self) -> float:
        value = self._product()
        while self._peek() in ("+", "-"):
            value = value + self._product() if self._take()[1] == "+" else value - self._product()
        return value

    def _product(self) -> float:
        value = self._signed()
        while self._peek() in ("*", "/"):
            value = value * self._signed() if self._take()[1] == "*" else value / self._signed()
        return value

    def _signed(self) -> float:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ValueError(f"is nested deeper than {MAX_DEPTH} levels")
        try:
            if self._peek() in ("+", "-"):
                return -self._signed() if self._take()[1] == "-" else self._signed()
            return self._atom()
        finally:
            self._depth -= 1

    def _atom(self) -> float:
        kind, token = self._take()
        if kind == "number":
            return float(token)
        if token == "(":
            value = self._sum()
            self._take(")")
            return value
        if token == "pow":
            self._take("(")
            base = self._sum()
            self._take(",")
            exponent = self._sum()
            self._take(")")
            try:
                return math.pow(base, exponent)
            except ValueError:
                raise ValueError("has no real value") from None
        raise ValueError("is not a number")
