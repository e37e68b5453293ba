"""Measures of every joint from a run's samples, a chunk at a time, in memory that does not grow with the run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.metrics import JointSummary, measure, summarise
from asrsim.samples import Array, JointInfo, Samples

KEPT = 2_000_000
"""Samples of all joints together that are looked at; a longer run is thinned evenly, its peaks are not."""
SHAKEN = 10.0
"""Overshoot (a fraction of the step) above which there was no step to speak of: the joint was shaken, not moved."""
QUANTITIES = ("link_position", "motor_1_position", "motor_2_position", "reference_1", "reference_2")
"""What the measures need of a log."""


def joint_measures(chunks: Iterable[Samples], joints: Sequence[JointInfo], *, samples: int) -> tuple[JointSummary, ...]:
    """A summary of each joint of a run.

    Args:
        chunks: The run's samples in their order; at least the quantities of :data:`QUANTITIES`.
        joints: Those of the run's description.
        samples: How many samples the chunks have together, or more.

    Returns:
        Of each joint; overshoot and settling count from where its reference begins to move, see :func:`step_start`.
    """
    stride = max(1, -(-samples * len(joints) // KEPT))
    times: list[Array] = []
    positions: list[Array] = []
    errors: list[Array] = []
    peaks = np.full(len(joints), np.nan)
    seen = 0
    for chunk in chunks:
        order = [chunk.joints.index(joint.name) for joint in joints]
        kept = slice((-seen) % stride, None, stride)
        seen += len(chunk.time)
        times.append(chunk.time[kept])
        positions.append(chunk.values["link_position"][kept][:, order])
        errors.append(DERIVED_FUNCTIONS["position_error"](chunk, joints)[kept][:, order])
        deflections = np.abs(DERIVED_FUNCTIONS["deflection"](chunk, joints)[:, order])
        peaks = np.fmax(peaks, np.fmax.reduce(deflections, axis=0, initial=np.nan))
    if not seen:
        return tuple(summarise(np.empty(0), {}) for _ in joints)
    time, position, error = np.concatenate(times), np.concatenate(positions), np.concatenate(errors)
    return tuple(
        replace(_summary(time, position[:, j], error[:, j]), peak_deflection=float(peaks[j])) for j in range(len(joints))
    )


def _summary(time: Array, position: Array, error: Array) -> JointSummary:
    if not np.isfinite(error).all():
        return summarise(time, {"link_position": position})
    whole = summarise(time, {"link_position": position, "position_error": error})
    start = step_start(position + error, float(position[0]))
    if start is None:
        return replace(whole, overshoot=math.nan, settling=math.nan)
    if start:
        whole = replace(
            whole,
            overshoot=measure("overshoot", time[start:], position[start:]),
            settling=measure("settling", time[start:], position[start:]),
        )
    return whole if not whole.overshoot > SHAKEN else replace(whole, overshoot=math.nan)


def step_start(reference: Array, initial: float) -> int | None:
    """Sample at which a reference (n,) that goes one way and then rests begins to move; 0 if it stands off `initial` always.

    None where it goes to and fro, still moves in the last tenth, or never leaves the joint's initial position: such a motion
    has no overshoot and does not settle.
    """
    changes = np.diff(reference)
    floor = 1e-9 * max(1.0, float(np.max(np.abs(reference))))
    moves = np.flatnonzero(np.abs(changes) > floor)
    if not len(moves):
        return 0 if abs(float(reference[0]) - initial) > floor else None
    one_way = bool(np.all(changes[moves] > 0) or np.all(changes[moves] < 0))
    return int(moves[0]) + 1 if one_way and moves[-1] < 0.9 * len(changes) else None
