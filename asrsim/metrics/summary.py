"""Measures of each joint in a run's summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from asrsim.metrics.measures import measure, rest_of
from asrsim.plain import finite_or_none
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class JointSummary:
    """Measures of one joint; NaN if undefined (no step, not settled, not recorded)."""

    steady_state: float
    """Mean of the link position over the last tenth, rad (m)."""
    steady_state_error: float
    """Reference minus link position over the last tenth, rad (m); NaN if the reference is not a position."""
    overshoot: float
    """Overshoot of the link position, as a fraction of its step."""
    settling: float
    """Settling time to 2 % of the step, s."""
    frequency: float
    """Frequency of the link position's dominant oscillation, Hz."""
    peak_deflection: float
    """Largest magnitude of equilibrium minus link position, rad (m)."""
    motion_left: float = 0.0
    """Motion of the link that is left at the end, rad (m); 0 at rest. Steady state, error, overshoot and settling time are NaN
    if the link is not at rest."""

    def as_dict(self) -> dict[str, float | None]:
        """Measures as data for JSON: undefined numbers are null."""
        return {name: finite_or_none(value) for name, value in self.__dict__.items()}


def summarise(time: Array, columns: Mapping[str, Array], *, step: int | None = 0) -> JointSummary:
    """Measures of one joint for the summary.

    Args:
        time: Times (n,), s.
        columns: Values (n,) by quantity: `link_position`, and if available `position_error` and `deflection` (derived, see
          `asrsim.log.derived`); measures of missing quantities are NaN.
        step: Sample at which the step begins, for overshoot and settling; None: there is no step, and overshoot and settling
            time are NaN.
    """

    def of(name: str, quantity: str = "link_position", reference: Array | None = None, **options: float) -> float:
        return measure(name, time, columns[quantity], reference, **options) if quantity in columns else math.nan

    steady, left = rest_of(time, columns["link_position"]) if "link_position" in columns else (math.nan, math.nan)
    # All measures that require rest use this test of rest.
    rests = left == 0.0
    error, overshoot, settling = math.nan, math.nan, math.nan
    if rests and "position_error" in columns:
        error = of("steady_state_error", reference=columns["link_position"] + columns["position_error"])
    if rests and step is not None and step < len(time):
        overshoot, settling = (of(name, start=float(time[step]), target=steady) for name in ("overshoot", "settling"))
    return JointSummary(
        steady_state=steady,
        steady_state_error=error,
        overshoot=overshoot,
        settling=settling,
        frequency=of("frequency"),
        peak_deflection=of("peak", "deflection"),
        motion_left=left,
    )
