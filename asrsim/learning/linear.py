"""Equations of motion of soft joints, linearised along a motion. They give the response of the motion to changes of the inputs.

In the linearised equations, q are joint positions, theta_i motor positions, u inputs, k_i = d tau_i / d theta_i spring
stiffnesses, and rho_i factors from inputs to motor references. The matrices change with time:

    M q'' + C q' + diag(c) q' + G q = sum_i k_i (theta_i - q) M, C, G: derivatives of the rigid inverse dynamics
    J_i theta_i'' + (d_i + D_i) theta_i' + (P_i + k_i) theta_i = P_i rho_i u + k_i q + I_i int (rho_i u - theta_i)

The equations are integrated by the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.kinematics.drive_inverse import DesiredMotion, reference_map
from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array

POSTURES = 101
"""Number of postures of a motion at which the rigid robot is linearised. Between them the matrices are interpolated
linearly.
"""
NUDGE = 1e-6
"""Step of the central differences by which the rigid robot is linearised, rad for positions and rad/s for velocities."""
CLIP = 0.98
"""Springs beyond their deflection limit are linearised at this fraction of the limit, since at the limit the slope of their
torque is 0.
"""


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """Driven joints, linearised along a motion of n samples. m: number of joints."""

    time: Array
    """Equidistant times (n,), s."""
    drives: tuple[Drive, ...]
    mass: Array = field(repr=False)
    """Mass matrices (n, m, m), kg m^2."""
    rates: Array = field(repr=False)
    """Derivatives (n, m, m) of the rigid robot's torques with respect to the velocities, including the damping, N m s/rad."""
    slopes: Array = field(repr=False)
    """Derivatives (n, m, m) of the rigid robot's torques with respect to the positions, N m/rad."""
    springs: Array = field(repr=False)
    """Stiffnesses k_i (n, m, positions) of the springs, N m/rad."""

    def scaled(self, mass: float, stiffness: float) -> Linearised:
        """Linearised joints in which factors multiply all masses and all stiffnesses."""
        return replace(self, mass=mass * self.mass, slopes=mass * self.slopes, springs=stiffness * self.springs)

    def held(self, tail: float) -> Linearised:
        """Linearised joints whose motion is extended by `tail` s, during which the joints rest at the final position."""
        step = float(self.time[1] - self.time[0])
        more = max(round(tail / step), 1)

        def longer(values: Array) -> Array:
            return np.concatenate([values, np.repeat(values[-1:], more, axis=0)])

        time = np.concatenate([self.time, self.time[-1] + step * np.arange(1, more + 1)])
        return replace(
            self,
            time=time,
            mass=longer(self.mass),
            rates=longer(self.rates),
            slopes=longer(self.slopes),
            springs=longer(self.springs),
        )

    @cached_property
    def steps(self) -> tuple[Array, Array]:
        """Matrices of each time step: state matrices (n - 1, s, s) and input matrices (n - 1, s, m). The first states are the
        joint positions.
        """
        step = float(self.time[1] - self.time[0])
        change, inputs = self.continuous
        change, inputs = 0.5 * (change[1:] + change[:-1]), 0.5 * (inputs[1:] + inputs[:-1])
        identity = np.eye(change.shape[1])
        both = np.linalg.solve(
            identity - 0.5 * step * change, np.concatenate([identity + 0.5 * step * change, step * inputs], axis=2)
        )
        return both[:, :, : len(identity)], both[:, :, len(identity) :]

    @cached_property
    def continuous(self) -> tuple[Array, Array]:
        """System matrices A (n, s, s) and B (n, s, m) of x' = A x + B u. The state x contains positions of joints and motors,
        their velocities, and integrals of controllers.
        """
        n, m, motors = len(self.time), len(self.drives), self._moving
        size = m + len(motors)
        mass, rates, slopes = (np.zeros((n, size, size)) for _ in range(3))
        mass[:, :m, :m], rates[:, :m, :m], slopes[:, :m, :m] = self.mass, self.rates, self.slopes
        driven = np.zeros((n, size, m))
        for j, drive in enumerate(self.drives):
            if not drive.mode.spring:
                slopes[:, j, j] += drive.proportional[0]
                rates[:, j, j] += drive.derivative[0]
                driven[:, j, j] = drive.proportional[0]
                continue
            slopes[:, j, j] += self.springs[:, j].sum(axis=1)
            if not drive.proportional:
                rho = _rho(drive)
                driven[:, j, j] = self.springs[:, j, : len(rho)] @ rho
        integrals = []
        for row, (j, motor) in enumerate(motors, m):
            drive, k = self.drives[j], self.springs[:, j, motor]
            mass[:, row, row] = drive.motor_inertia[motor]
            rates[:, row, row] = drive.motor_damping[motor] + drive.derivative[motor]
            slopes[:, row, row] = drive.proportional[motor] + k
            slopes[:, row, j] = slopes[:, j, row] = -k
            driven[:, row, j] = drive.proportional[motor] * _rho(drive)[motor]
            if drive.integral[motor] > 0.0:
                integrals.append((row, j, motor))
        a = np.zeros((n, 2 * size + len(integrals), 2 * size + len(integrals)))
        b = np.zeros((*a.shape[:2], m))
        a[:, :size, size : 2 * size] = np.eye(size)
        found = np.linalg.solve(mass, np.concatenate([-slopes, -rates, driven], axis=2))
        a[:, size : 2 * size, : 2 * size], b[:, size : 2 * size] = found[:, :, : 2 * size], found[:, :, 2 * size :]
        for own, (row, j, motor) in enumerate(integrals, 2 * size):
            a[:, size + row, own] = self.drives[j].integral[motor] / self.drives[j].motor_inertia[motor]
            a[:, own, row] = -1.0
            b[:, own, j] = _rho(self.drives[j])[motor]
        return a, b

    @property
    def _moving(self) -> list[tuple[int, int]]:
        """Indices of the motors that have states, as pairs (joint, motor), in the order of the states."""
        return [
            (joint, motor)
            for joint, drive in enumerate(self.drives)
            if drive.mode.controller and drive.mode.spring
            for motor in range(len(drive.motor_inertia))
        ]


def _rho(drive: Drive) -> Array:
    return reference_map(drive, np.zeros(1))[0]


def linearise_along(
    model: RobotModel,
    drives: Sequence[Drive],
    motion: DesiredMotion,
    springs: Array,
    damping: Sequence[float],
) -> Linearised:
    """Joints of `drives`, linearised along `motion`, whose columns are in the order of the model's joints. Other joints follow
    the motion exactly.

    springs: stiffnesses (n, joints, positions) of the springs of each drive, N m/rad; damping: damping of each joint, N m
    s/rad.
    """
    index = [model.joints.index(drive.joint) for drive in drives]
    rows = np.unique(np.linspace(0, len(motion.time) - 1, POSTURES).round().astype(int))
    q, v, a = (values[rows] for values in (motion.positions, motion.velocities, motion.accelerations))
    small = np.array([np.eye(q.shape[1])[joint] * NUDGE for joint in index])

    def slope(of: int) -> Array:
        columns = []
        for nudge in small:
            ahead, behind = (
                model.inverse_dynamics(
                    *(values + sign * nudge if place == of else values for place, values in enumerate((q, v, a)))
                )
                for sign in (1.0, -1.0)
            )
            columns.append((ahead - behind)[:, index] / (2.0 * NUDGE))
        return np.stack(columns, axis=2)

    still = np.zeros_like(q)
    weight = model.inverse_dynamics(q, still, still)
    mass = np.stack([(model.inverse_dynamics(q, still, still + np.sign(nudge)) - weight)[:, index] for nudge in small], axis=2)
    rates = slope(1) + np.diag(damping)
    between = _interpolated(motion.time[rows], motion.time)
    return Linearised(
        time=motion.time,
        drives=tuple(drives),
        mass=between(mass),
        rates=between(rates),
        slopes=between(slope(0)),
        springs=springs,
    )


def _interpolated(knots: Array, time: Array) -> Callable[[Array], Array]:
    """Function that takes samples (k, m, m) at the times `knots`, and interpolates them linearly at the times `time`."""
    from scipy.interpolate import make_interp_spline

    return lambda values: np.asarray(make_interp_spline(knots, values, k=1)(time))


def spring_slopes(drive: Drive, position: Array, motors: Array) -> Array:
    """Stiffnesses d tau_i / d theta_i (n, positions) of a joint's springs, N m/rad. They are 0 for an adjuster and for motors
    on the housing. position: link positions (n,), rad; motors: motor positions (n, positions), rad.

    Springs beyond their deflection limit are evaluated just before the limit, since at the limit the slope of their torque is
    0.
    """
    law = over_arrays(drive.actuator.elastic_torques)
    most = CLIP * drive.max_deflection
    deflections = np.clip(motors - position[:, None], -most, most)
    found = np.zeros_like(motors)
    for motor in range(drive.actuator.motors - drive.actuator.housed):
        ends = []
        for nudge in (-NUDGE, NUDGE):
            at = motors.copy()
            at[:, motor] = position + deflections[:, motor] + nudge
            ends.append(drive.actuator.on_link(law(position, *at.T, drive.elastic)))
        found[:, motor] = (ends[1] - ends[0]) / (2.0 * NUDGE)
    return found
