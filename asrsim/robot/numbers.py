"""Reads numbers in tags: plain, infinite, or constant arithmetic such as `1.21*pow(10,-6)`.

Python does not evaluate the text. The arithmetic is parsed, and may contain only numbers, + - * /, parentheses, signs and
`pow(x, y)`.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from typing import Any

from asrsim.robot.xmlfile import BLANKS

MAX_LENGTH = 200
"""Largest length of a number or an expression in a tag, characters."""

_DIGITS = r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_LEADING = re.compile(f"[{BLANKS}]*([+-]?{_DIGITS})")
_PLAIN = re.compile(rf"[+-]?(?:{_DIGITS}|inf|infinity|nan)", re.IGNORECASE | re.ASCII)
_ARITHMETIC = re.compile(f"[-0-9.eE+*/(),pow{BLANKS}]+")
_OPERATORS: dict[type, Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


def plain_number(text: str) -> float:
    """Number in the text, with ASCII digits only and no surrounding blanks except the blanks of XML. Raises ValueError for
    other text.

    Python's `float` also accepts underscores, digits of other scripts and other blanks, which engines read as another number.
    """
    body = text.strip(BLANKS)
    if not _PLAIN.fullmatch(body):
        raise ValueError("is not a number")
    return float(body)


def read_number(text: str) -> tuple[float, bool]:
    """Value of the text, and whether the text is arithmetic; the toolbox reads only the leading number of an arithmetic
    expression.

    A comment after `#` is ignored. Raises ValueError with the reason, a phrase that follows the key.
    """
    body = text.partition("#")[0].strip(BLANKS)
    if not body:
        raise ValueError("is empty where a number is needed")
    if len(body) > MAX_LENGTH:
        raise ValueError(f"is longer than {MAX_LENGTH} characters")
    if _PLAIN.fullmatch(body):
        return float(body), False
    if not _ARITHMETIC.fullmatch(body):
        raise ValueError("is not a number")
    try:
        value = _calculated(ast.parse(" ".join(body.split()), mode="eval").body)
    except SyntaxError:
        raise ValueError("is not a number") from None
    except ZeroDivisionError:
        raise ValueError("divides by zero") from None
    except OverflowError:
        raise ValueError("is too large for a number") from None
    if not math.isfinite(value):
        raise ValueError("is not finite")
    return value, True


def leading_number(text: str) -> float:
    """Number that Gazebo with the toolbox reads from the text: the leading number, or 0 without a leading number."""
    match = _LEADING.match(text)
    return float(match.group(1)) if match else 0.0


def _calculated(node: ast.expr) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.UnaryOp(op=op, operand=part) if type(op) in _OPERATORS:
            return float(_OPERATORS[type(op)](_calculated(part)))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return float(_OPERATORS[type(op)](_calculated(left), _calculated(right)))
        case ast.Call(func=ast.Name(id="pow"), args=[base, exponent]):
            x, y = _calculated(base), _calculated(exponent)
            try:
                return math.pow(x, y)
            except ValueError:
                raise ValueError("has no real value") from None
    raise ValueError("is not a number")
