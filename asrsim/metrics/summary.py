"""What a run's summary says of each joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.metrics.measures import measure
from asrsim.metrics.oscillation import frequency
from asrsim.metrics.step import overshoot, settling
from asrsim.metrics.values import steady_state
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class JointSummary:
    """Numbers of one joint; NaN where one is undefined (no step, not settled, not recorded)."""

    steady_state: float
    """rad (m), mean of the link position over the last tenth."""
    steady_state_error: float
    """rad (m), reference minus link position there; NaN where the reference is no position."""
    overshoot: float
    """Of the link position, fraction of its step."""
    settling: float
    """s, to 2 % of the step."""
    frequency: float
    """Hz, dominant oscillation of the link position."""
    peak_deflection: float
    """rad (m), largest magnitude of equilibrium minus link position."""

    def as_dict(self) -> dict[str, float | None]:
        """For JSON: undefined numbers are null."""
        return {name: value if math.isfinite(value) else None for name, value in self.__dict__.items()}


def summarise(time: Array, columns: Mapping[str, Array], *, step: int | None = 0) -> JointSummary:
    """Summary of one joint.

    Args:
        time: (n,) s.
        columns: Quantity -> (n,): `link_position`, and where there are `position_error` and `deflection` (derived, see
            :mod:`asrsim.log.derived`), without which their numbers are NaN.
        step: Sample from which overshoot and settling count; None: there is no step, and they are NaN.
    """
    q = columns.get("link_position")
    if q is None or not np.isfinite(q).any():
        nan = math.nan
        return JointSummary(steady_state=nan, steady_state_error=nan, overshoot=nan, settling=nan, frequency=nan,
                            peak_deflection=_of(columns, "peak", "deflection", time))  # fmt: skip
    whole = _finite(time, q)
    steady = steady_state(*whole)
    beyond = settled = math.nan
    moments, places = _finite(time[step:], q[step:]) if step else whole
    if step is not None and len(moments):
        target = steady_state(moments, places) if step else steady
        beyond, settled = overshoot(moments, places, target=target), settling(moments, places, target=target)
    return JointSummary(
        steady_state=steady,
        steady_state_error=_of(columns, "steady_state", "position_error", time),
        overshoot=beyond,
        settling=settled,
        frequency=frequency(*whole),
        peak_deflection=_of(columns, "peak", "deflection", time),
    )


def _finite(time: Array, values: Array) -> tuple[Array, Array]:
    keep = np.isfinite(values)
    return (time, values) if keep.all() else (time[keep], values[keep])


def _of(columns: Mapping[str, Array], name: str, quantity: str, time: Array) -> float:
    values = columns.get(quantity)
    return math.nan if values is None else measure(name, time, values)
