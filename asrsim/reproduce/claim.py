"""A claim of a figure and what came of it: data for the terminal, the page and JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from asrsim.metrics.expect import compares
from asrsim.plain import finite_or_none

Origin = Literal["paper", "theory", "simulation", "beyond"]
ORIGINS: dict[str, str] = {
    "paper": "the paper says so",
    "theory": "a closed form or a law of mechanics says so",
    "simulation": "an independent simulation of the same experiment gave this number",
    "beyond": "not in the paper: with link damping that grows with the stiffness",
}
"""Where a claim comes from, in words."""


@dataclass(frozen=True)
class Bound:
    """What a number is claimed to be."""

    comparison: str
    """One of `==`, `<`, `<=`, `>`, `>=`; `==` within `tolerance`."""
    value: float
    unit: str = ""
    tolerance: float = 0.0

    def __str__(self) -> str:
        sign = "" if self.comparison == "==" else f"{self.comparison} "
        spread = f" ± {self.tolerance:.3g}" if self.tolerance else ""
        return f"{sign}{self.value:.6g}{spread}{f' {self.unit}' if self.unit else ''}"


def near(value: float, tolerance: float, unit: str = "") -> Bound:
    """Within the tolerance of the value."""
    return Bound("==", value, unit, tolerance)


def below(value: float, unit: str = "") -> Bound:
    """Less than the value."""
    return Bound("<", value, unit)


def at_most(value: float, unit: str = "") -> Bound:
    """The value or less."""
    return Bound("<=", value, unit)


def above(value: float, unit: str = "") -> Bound:
    """More than the value."""
    return Bound(">", value, unit)


def at_least(value: float, unit: str = "") -> Bound:
    """The value or more."""
    return Bound(">=", value, unit)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One statement about one number."""

    text: str
    """The statement in our own words."""
    quantity: str
    """What was measured."""
    measured: float
    """NaN where it cannot be measured; such a claim does not hold."""
    bound: Bound
    origin: Origin = "paper"

    @property
    def holds(self) -> bool:
        """Whether the measured number is as claimed."""
        return compares(self.measured, self.bound.comparison, self.bound.value, self.bound.tolerance)

    @property
    def found(self) -> str:
        """The measured number as text, with unit."""
        unit = f" {self.bound.unit}" if self.bound.unit else ""
        return f"{self.measured:.6g}{unit}" if math.isfinite(self.measured) else "not measurable"

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "claim": self.text,
            "origin": self.origin,
            "quantity": self.quantity,
            "comparison": self.bound.comparison,
            "value": self.bound.value,
            "tolerance": self.bound.tolerance,
            "unit": self.bound.unit,
            "measured": finite_or_none(self.measured),
            "holds": self.holds,
        }
