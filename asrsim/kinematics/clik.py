"""First-order closed-loop inverse kinematics with damped least squares (Siciliano et al. 2010, section 3.7).

The loop is closed on the model, not on the measured tip. With the measured tip, the loop would integrate the deflection of the
springs, and the references would drift without end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.engines.base import Point
from asrsim.kinematics.engine_model import EngineModel
from asrsim.kinematics.trajectory import PoseTrajectory, rotation_between
from asrsim.samples import Array


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """Joint positions over time, with the errors that remain at the point."""

    time: Array
    """Times (n,), s."""
    positions: Array
    """Joint positions (n, joints) in the model's order, rad or m."""
    position_error: Array
    """Distance (n,) of the model's point from the trajectory, m."""
    orientation_error: Array
    """Orientation error (n,), rad; zeros if the orientation is free."""


def follow(
    model: EngineModel,
    link: str,
    point: Point,
    trajectory: PoseTrajectory,
    start: Array,
    time: Array,
    *,
    moving: NDArrayBool | None = None,
    gain: float = 10.0,
    damping: float = 1e-3,
) -> JointPath:
    """Joint positions that move the point along the trajectory, beginning at `start` (joints,).

    time: ascending times (n,), s; the loop takes one step per entry. moving: mask of the joints that may move (None: all).
    gain: gain on position and orientation errors, 1/s. damping: damping factor of the least squares, in m for position rows
    and in rad for orientation rows.
    No joint passes its stop: it is placed at the stop, and the other joints take over as much of the motion as they can.
    """
    wanted, turned = trajectory.at(time)
    rows = 3 if turned is None else 6
    free = np.ones(len(start), dtype=bool) if moving is None else moving
    q = np.array(start, dtype=float)
    positions = np.empty((len(time), len(q)))
    position_error, orientation_error = np.zeros(len(time)), np.zeros(len(time))
    for index in range(len(time)):
        position, rotation = model.pose(q, link, point)
        error = np.zeros(rows)
        error[:3] = wanted[index] - position
        if turned is not None:
            error[3:] = rotation_between(rotation, turned[index])
            orientation_error[index] = float(np.linalg.norm(error[3:]))
        positions[index] = q
        position_error[index] = float(np.linalg.norm(error[:3]))
        if index + 1 == len(time):
            break
        step = time[index + 1] - time[index]
        # Feedforward of the trajectory's own displacement: without it, the loop would lag by velocity / gain at any step.
        displacement = np.zeros(rows)
        displacement[:3] = wanted[index + 1] - wanted[index]
        if turned is not None:
            displacement[3:] = rotation_between(turned[index], turned[index + 1])
        displacement += min(gain * step, 1.0) * error
        jacobian = model.jacobian(q, link, point)[:rows]
        q = q + bounded_step(jacobian, displacement, model.lower - q, model.upper - q, free, damping)
    return JointPath(time=time, positions=positions, position_error=position_error, orientation_error=orientation_error)


def bounded_step(
    jacobian: Array, displacement: Array, lowest: Array, highest: Array, free: NDArrayBool, damping: float
) -> Array:
    """Damped least-squares joint step (n,) towards `displacement` (rows,), within [lowest, highest] (n,) each.

    A joint whose step would pass its bound is placed at the bound. The motion of this joint is subtracted from the task, and
    the steps of the other joints are computed again for the rest of the task.
    """
    step = np.zeros(jacobian.shape[1])
    active = free.copy()
    remaining = displacement
    while active.any():
        columns = jacobian[:, active]
        normal = columns @ columns.T
        normal[np.diag_indices_from(normal)] += damping * damping
        step[active] = columns.T @ np.linalg.solve(normal, remaining)
        bounded = np.clip(step, lowest, highest)
        passed = active & (bounded != step)
        if not passed.any():
            break
        step[passed] = bounded[passed]
        active &= ~passed
        remaining = displacement - jacobian[:, ~active] @ step[~active]
    return step


NDArrayBool = np.ndarray[tuple[int], np.dtype[np.bool_]]
