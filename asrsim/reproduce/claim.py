"""A claim of a figure and what came of it: data for the terminal, the page and JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from asrsim.metrics.expect import compares

Origin = Literal["paper", "theory", "simulation", "beyond"]
ORIGINS: dict[str, str] = {
    "paper": "the paper says so",
    "theory": "a closed form or a law of mechanics says so",
    "simulation": "an independent simulation of the same experiment gave this number",
    "beyond": "not in the paper: with link damping that grows with the stiffness",
}
"""Where a claim comes from, in words."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One statement about one number."""

    figure: int
    text: str
    """The statement in our own words."""
    quantity: str
    """What was measured."""
    measured: float
    """NaN where it cannot be measured; such a claim does not hold."""
    comparison: str
    """One of `==`, `<`, `<=`, `>`, `>=`; `==` within `tolerance`."""
    value: float
    tolerance: float = 0.0
    unit: str = ""
    origin: Origin = "paper"

    @property
    def holds(self) -> bool:
        """Whether the measured number is as claimed."""
        return compares(self.measured, self.comparison, self.value, self.tolerance)

    @property
    def expected(self) -> str:
        """The comparison as text, with unit."""
        sign = "" if self.comparison == "==" else f"{self.comparison} "
        spread = f" ± {self.tolerance:.3g}" if self.tolerance else ""
        return f"{sign}{self.value:.6g}{spread}{f' {self.unit}' if self.unit else ''}"

    @property
    def found(self) -> str:
        """The measured number as text, with unit."""
        return (
            f"{self.measured:.6g}{f' {self.unit}' if self.unit else ''}" if math.isfinite(self.measured) else "not measurable"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "figure": self.figure,
            "claim": self.text,
            "origin": self.origin,
            "quantity": self.quantity,
            "comparison": self.comparison,
            "value": self.value,
            "tolerance": self.tolerance,
            "unit": self.unit,
            "measured": self.measured if math.isfinite(self.measured) else None,
            "holds": self.holds,
        }
