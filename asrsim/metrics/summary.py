"""Measures of each joint in a run's summary."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.metrics.measures import measure
from asrsim.metrics.oscillation import frequencies
from asrsim.metrics.step import normalised, overshoots, settlings
from asrsim.metrics.values import SHARE, last_part, means
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

    def as_dict(self) -> dict[str, float | None]:
        """Measures as data for JSON: undefined numbers are null."""
        return {name: finite_or_none(value) for name, value in self.__dict__.items()}


def summarise(time: Array, columns: Mapping[str, Array], *, step: int | None = 0) -> JointSummary:
    """Measures of one joint for the summary.

    Args:
        time: Times (n,), s.
        columns: Quantity -> values (n,): `link_position`, and if available `position_error` and `deflection` (derived, see
          `asrsim.log.derived`); measures of missing quantities are NaN.
        step: Sample at which the step begins, for overshoot and settling; None: there is no step, and they are NaN.
    """
    q, error, deflection = (columns.get(name) for name in ("link_position", "position_error", "deflection"))
    peak = math.nan if deflection is None else measure("peak", time, deflection)
    if q is None:
        return _nothing(peak)
    nothing = np.full((1, len(time)), math.nan)
    return summaries(time, q[None], nothing if error is None else error[None], [step], np.array([peak]))[0]


def summaries(
    time: Array, positions: Array, errors: Array, steps: Sequence[int | None], peaks: Array
) -> tuple[JointSummary, ...]:
    """Measures of m joints. positions, errors: (m, n); steps: as in `summarise`; peaks: largest deflections (m,)."""
    found: list[JointSummary | None] = [None] * len(positions)
    finite: Any = np.isfinite(positions)
    whole: Any = finite.all(axis=1)
    for j in np.flatnonzero(~whole).tolist():
        keep, step = finite[j], steps[j]
        if keep.any():
            later = None if step is None else int(keep[:step].sum())
            one = summaries(time[keep], positions[j : j + 1, keep], errors[j : j + 1, keep], [later], peaks[j : j + 1])[0]
            found[j] = replace(one, steady_state_error=_error(time, errors[j]))
        else:
            found[j] = _nothing(float(peaks[j]))
    rows: Any = np.flatnonzero(whole)
    if not len(rows):
        return tuple(one for one in found if one is not None)
    positions = positions if len(rows) == len(found) else positions[rows]
    steady = means(*last_part(time, positions, SHARE))
    beyond, settled = _steps(time, positions, steady, [steps[j] for j in rows])
    shaken = frequencies(time, positions, steady)
    off = means(*last_part(time, errors, SHARE))
    known: Any = np.isfinite(errors).all(axis=1)
    for i, j in enumerate(rows.tolist()):
        found[j] = JointSummary(
            steady_state=float(steady[i]), steady_state_error=float(off[j]) if known[j] else _error(time, errors[j]),
            overshoot=beyond[i], settling=settled[i], frequency=shaken[i], peak_deflection=float(peaks[j]),
        )  # fmt: skip
    return tuple(one for one in found if one is not None)


def _steps(time: Array, positions: Array, steady: Array, steps: Sequence[int | None]) -> tuple[list[float], list[float]]:
    """Overshoots and settling times of m series, each from its step on."""
    beyond, settled = [math.nan] * len(steps), [math.nan] * len(steps)
    for step in {step for step in steps if step is not None and step < len(time)}:
        rows = [i for i, other in enumerate(steps) if other == step]
        moments, later = time[step:], positions[rows, step:]
        target = means(*last_part(moments, later, SHARE)) if step else steady[rows]
        x = normalised(later, later[:, 0], target)
        for i, over, seconds in zip(rows, overshoots(x).tolist(), settlings(moments, x), strict=True):
            beyond[i], settled[i] = over, seconds
    return beyond, settled


def _error(time: Array, errors: Array) -> float:
    return measure("steady_state", time, errors)


def _nothing(peak: float) -> JointSummary:
    nan = math.nan
    return JointSummary(
        steady_state=nan, steady_state_error=nan, overshoot=nan, settling=nan, frequency=nan, peak_deflection=peak
    )
