"""Values of a varied key: a list of values, or a distribution with its inverse cumulative distribution function."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.errors import InputError
from asrsim.samples import Array

DISTRIBUTIONS = {
    "uniform": ("low", "high"),
    "loguniform": ("low", "high"),
    "normal": ("mean", "deviation"),
    "lognormal": ("median", "sigma"),
}
"""Distributions with the names of their arguments. The sigma of `lognormal` is the standard deviation of the logarithm."""
FORMS = (
    "[A, B, ...]",
    "LOW:HIGH:COUNT",
    "log:LOW:HIGH:COUNT",
    *(f"{name}({', '.join(arguments)})" for name, arguments in DISTRIBUTIONS.items()),
)
_CALL = re.compile(r"\s*(\w+)\s*\(([^()]*)\)\s*")
MOST_VALUES = 10_000_000
"""Largest number of values that a range may have."""


@dataclass(frozen=True)
class Values:
    """Values of a key, from a list or a range."""

    values: tuple[Any, ...]

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class Distribution:
    """Distribution with its two arguments in the order that `DISTRIBUTIONS` lists."""

    name: str
    first: float
    second: float

    def quantile(self, share: Array) -> Array:
        """Values (n,) at cumulative probabilities (n,) between 0 and 1."""
        from scipy.special import ndtri

        if self.name == "uniform":
            return self.first + (self.second - self.first) * share
        if self.name == "loguniform":
            return np.asarray(self.first * (self.second / self.first) ** share)
        if self.name == "normal":
            return np.asarray(self.first + self.second * ndtri(share))
        return np.asarray(self.first * np.exp(self.second * ndtri(share)))


def law_of(value: Any, key: str) -> Values | Distribution:
    """Values or distribution described by a text (`--over`) or by a value in a study file. Raises InputError."""
    if isinstance(value, Values | Distribution):
        return value
    if isinstance(value, list | tuple):
        if not value:
            raise _wrong(key, "the list is empty", value)
        return Values(tuple(value))
    if isinstance(value, dict):
        raise _wrong(key, "a single mapping must be an element of a list", value)
    if isinstance(value, str):
        return _from_text(value, key)
    return Values((value,))


def _from_text(text: str, key: str) -> Values | Distribution:
    call = _CALL.fullmatch(text)
    if call:
        if call[1] not in DISTRIBUTIONS:
            raise _wrong(key, f"there is no distribution '{call[1]}'", text, tuple(DISTRIBUTIONS))
        return _distribution(key, call[1], [part.strip() for part in call[2].split(",")])
    logarithmic = text.startswith("log:")
    parts = text.removeprefix("log:").split(":")
    if len(parts) == 3:
        return _range(key, text, parts, logarithmic=logarithmic)
    from asrsim.document.yaml_reader import parse_yaml

    try:
        read = parse_yaml(text).plain()
    except InputError as error:
        raise _wrong(key, f"cannot be read: {error.problems[0].message}", text) from None
    if isinstance(read, list | dict):
        return law_of(read, key)
    raise _wrong(key, "is neither a list of values nor a distribution", text)


def _range(key: str, text: str, parts: Sequence[str], *, logarithmic: bool) -> Values:
    low, high = _number(key, parts[0]), _number(key, parts[1])
    count = int(parts[2]) if parts[2].strip().isdecimal() else 0
    if not 1 <= count <= MOST_VALUES:
        raise _wrong(key, "the count of a range must be a whole number of at least 1", text)
    if logarithmic and not (low > 0.0 and high > 0.0):
        raise _wrong(key, "both ends of a logarithmic range must be above 0", text)
    spaced = np.geomspace(low, high, count) if logarithmic else np.linspace(low, high, count)
    return Values(tuple(spaced.tolist()))


def _distribution(key: str, name: str, arguments: Sequence[Any]) -> Distribution:
    wanted = DISTRIBUTIONS[name]
    if len(arguments) != len(wanted):
        raise _wrong(key, f"{name} has the arguments ({', '.join(wanted)})", list(arguments))
    first, second = (_number(key, argument) for argument in arguments)
    if name.endswith("uniform") and not second > first:
        raise _wrong(key, f"the high end of a {name} distribution must be above the low end", [first, second])
    if name == "loguniform" and not first > 0.0:
        raise _wrong(key, "the low end of a loguniform distribution must be above 0", first)
    if name.endswith("normal") and not second > 0.0:
        raise _wrong(key, f"{wanted[1]} must be above 0", second)
    if name == "lognormal" and not first > 0.0:
        raise _wrong(key, "median must be above 0", first)
    return Distribution(name, first, second)


def _number(key: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number) or isinstance(value, bool):
        raise _wrong(key, "must be a finite number", value)
    return number


def _wrong(key: str, message: str, value: Any, choices: tuple[str, ...] = ()) -> InputError:
    hint = None if choices else f"Valid forms: {', '.join(FORMS)}"
    return InputError(message, key=key, value=value, choices=choices, hint=hint, code="sweep-values")
