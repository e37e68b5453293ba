"""Trajectories of poses, and joint paths along them by first-order closed-loop inverse kinematics with damped least squares
(Siciliano et al. 2010, section 3.7).

The loop is closed on the model, not on the measured tip. With the measured tip, the loop would integrate the deflection of the
springs, and the references would drift without end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from asrsim.robot.dynamics import RobotModel
from asrsim.robot.model import Vector
from asrsim.robot.poses import rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import CartesianPose


def minimum_jerk(fraction: Array) -> Array:
    """Minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5 from 0 to 1, at rest at both ends (Flash and Hogan 1985)."""
    # Keep this form of the polynomial. `signals.common.minimum_jerk` may differ in the last bit, and logs of tasks must stay
    # equal to logs of earlier versions bit for bit.
    return fraction**3 * (10.0 + fraction * (-15.0 + 6.0 * fraction))


INTERPOLATIONS: dict[str, Callable[[Array], Array]] = {"minimum_jerk": minimum_jerk, "linear": np.positive}
"""Profiles by name: fraction of the segment's length that is covered after a fraction of its time. With the linear profile, the
velocity jumps at the poses."""


@dataclass(frozen=True, kw_only=True)
class PoseTrajectory:
    """Straight segments between poses, in each of which the orientation turns about one axis. The pose is constant before the
    first and after the last pose."""

    times: Array
    """Ascending times (m,) at which the poses are reached, s."""
    positions: Array
    """Positions (m, 3) in the world frame, m."""
    rotations: Array | None
    """Rotations (m, 3, 3); None: the orientation is free."""
    interpolation: str = "minimum_jerk"

    @classmethod
    def through(
        cls, poses: tuple[CartesianPose, ...], interpolation: str, start: tuple[Array, Array] | None = None
    ) -> PoseTrajectory:
        """Trajectory through the poses of a task.

        start: position (3,) and rotation (3, 3) at time 0, at which the trajectory begins if the first pose is later than time
        0.
        """
        times = [pose.time for pose in poses]
        positions = [np.asarray(pose.position, dtype=float) for pose in poses]
        turned = [rotation_matrix(pose.rpy) for pose in poses if pose.rpy is not None]
        if start is not None and times[0] > 0.0:
            times.insert(0, 0.0)
            positions.insert(0, start[0])
            if turned:
                turned.insert(0, start[1])
        return cls(
            times=np.array(times),
            positions=np.array(positions),
            rotations=np.array(turned) if turned else None,
            interpolation=interpolation,
        )

    def at(self, time: Array) -> tuple[Array, Array | None]:
        """Positions (n, 3) and rotations (n, 3, 3) (or None) at `time` (n,)."""
        from scipy.spatial.transform import Rotation, Slerp

        knots = np.arange(len(self.times) + 1)
        place = np.interp(time, self.times, knots[:-1])
        begin = np.floor(place)
        place = begin + INTERPOLATIONS[self.interpolation](place - begin)
        positions = np.column_stack([np.interp(place, knots[:-1], column) for column in self.positions.T])
        if self.rotations is None:
            return positions, None
        # Repeat the last rotation, since the interpolation needs at least two rotations.
        rotations = Rotation.from_matrix(self.rotations[np.minimum(knots, len(self.times) - 1)])
        return positions, Slerp(knots, rotations)(place).as_matrix()


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """Joint positions over time, with the errors that remain between the point and its trajectory."""

    time: Array
    """Times (n,), s."""
    positions: Array
    """Joint positions (n, joints) in the model's order, rad or m."""
    position_error: Array
    """Distance (n,) of the model's point from the trajectory, m."""
    orientation_error: Array
    """Orientation error (n,), rad; zeros if the orientation is free."""


def follow(
    model: RobotModel,
    link: str,
    point: Vector,
    trajectory: PoseTrajectory,
    start: Array,
    time: Array,
    *,
    moving: Sequence[bool] = (True,),
    gain: float = 10.0,
    damping: float = 1e-3,
) -> JointPath:
    """Joint positions that move the point along the trajectory, beginning at `start` (joints,).

    time: ascending times (n,), s; the loop takes one step per entry. moving: whether each joint may move.
    gain: gain on position and orientation errors, 1/s. damping: damping factor of the least squares, in m for position rows
    and in rad for orientation rows.
    A joint that would pass its stop is placed at the stop; the other joints take over as much of the motion as they can.
    """
    from scipy.spatial.transform import Rotation

    wanted, turned = trajectory.at(time)
    # A joint with equal bounds does not move.
    stops = np.where(moving, [model.lower, model.upper], start)

    def missing(index: int, position: Array, rotation: Array | None) -> Array:
        """Displacement and rotation vector from a pose to the trajectory's pose at an index; 3 numbers if only the position is
        given."""
        away = wanted[index] - position
        if turned is None or rotation is None:
            return np.asarray(away)
        return np.concatenate([away, Rotation.from_matrix(turned[index] @ rotation.T).as_rotvec()])

    q = model.couplings.expand(np.array(start, dtype=float))
    positions, errors = np.empty((len(time), len(q))), np.zeros((len(time), 2))
    for index in range(len(time)):
        error = missing(index, *model.pose(q, link, point))
        positions[index] = q
        errors[index] = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
        if index + 1 == len(time):
            break
        step = time[index + 1] - time[index]
        # Add the displacement of the trajectory in this step. Otherwise the loop would lag by velocity / gain at any step size.
        displacement = missing(index + 1, wanted[index], None if turned is None else turned[index])
        displacement += min(gain * step, 1.0) * error
        jacobian = model.jacobian(q, link, point)[: len(error)]
        q = model.couplings.expand(q + bounded_step(jacobian, displacement, stops - q, damping))
    return JointPath(time=time, positions=positions, position_error=errors[:, 0], orientation_error=errors[:, 1])


def bounded_step(jacobian: Array, displacement: Array, bounds: Array, damping: float) -> Array:
    """Damped least-squares joint step (n,) towards `displacement` (rows,), within the lower and upper bounds (2, n).

    A joint whose step would pass its bound is placed at the bound. The motion of this joint is subtracted from the task, and
    the steps of the other joints are computed again for the rest of the task.
    """
    step = np.zeros(jacobian.shape[1])
    active = bounds[0] < bounds[1]
    remaining = displacement
    while active.any():
        columns = jacobian[:, active]
        normal = columns @ columns.T
        normal[np.diag_indices_from(normal)] += damping * damping
        step[active] = columns.T @ np.linalg.solve(normal, remaining)
        bounded = np.clip(step, *bounds)
        passed = active & (bounded != step)
        if not passed.any():
            break
        step[passed] = bounded[passed]
        active &= ~passed
        remaining = displacement - jacobian[:, ~active] @ step[~active]
    return step
