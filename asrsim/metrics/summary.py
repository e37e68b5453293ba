"""What a run's summary says of each joint."""

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
        return {name: finite_or_none(value) for name, value in self.__dict__.items()}


def summarise(time: Array, columns: Mapping[str, Array], *, step: int | None = 0) -> JointSummary:
    """Summary of one joint.

    Args:
        time: (n,) s.
        columns: Quantity -> (n,): `link_position`, and where there are `position_error` and `deflection` (derived, see
            :mod:`asrsim.log.derived`), without which their numbers are NaN.
        step: Sample from which overshoot and settling count; None: there is no step, and they are NaN.
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
    """Summaries of m joints: positions, errors (m, n), steps as for :func:`summarise`, peaks of the deflection (m,)."""
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
    """Overshoot and settling of m series, each from its step on."""
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
