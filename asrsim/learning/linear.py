"""Soft joints linearised along a motion: what a change of their inputs does to it.

About a motion, with k_i = d tau_i / d theta_i, rho of the reference map, and matrices that change with time:

    M q'' + C q' + diag(c) q' + G q = sum_i k_i (theta_i - q)            M, C, G: slopes of the rigid robot's inverse dynamics
    J_i theta_i'' + (d_i + D_i) theta_i' + (P_i + k_i) theta_i = P_i rho_i u + k_i q + I_i int (rho_i u - theta_i)

integrated by the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.kinematics.desired import DesiredMotion
from asrsim.kinematics.drive_inverse import reference_map
from asrsim.kinematics.model import DynamicModel
from asrsim.learning.friction import Friction
from asrsim.samples import Array

POSTURES = 101
"""Postures of a motion at which the rigid robot is linearised; between, straight lines."""
NUDGE = 1e-6
"""rad and rad/s, for slopes by central differences."""
CLIP = 0.98
"""Share of the deflection limit at which springs beyond it are linearised: at the limit they have no slope."""


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """The driven joints linearised along a motion; n samples, m joints."""

    time: Array
    """(n,) s, equidistant."""
    drives: tuple[Drive, ...]
    mass: Array = field(repr=False)
    """(n, m, m) kg m^2."""
    rates: Array = field(repr=False)
    """(n, m, m) N m s/rad, damping included."""
    slopes: Array = field(repr=False)
    """(n, m, m) N m/rad, of the rigid robot."""
    springs: Array = field(repr=False)
    """(n, m, 2) N m/rad, k_i."""

    def scaled(self, mass: float, stiffness: float) -> Linearised:
        """The same joints with all masses and springs other by factors."""
        return Linearised(
            time=self.time, drives=self.drives, mass=mass * self.mass, rates=self.rates, slopes=mass * self.slopes,
            springs=stiffness * self.springs,
        )  # fmt: skip

    def held(self, tail: float) -> Linearised:
        """The same joints, standing for `tail` s more where the motion ends."""
        step = float(self.time[1] - self.time[0])
        more = max(round(tail / step), 1)

        def longer(values: Array) -> Array:
            return np.concatenate([values, np.repeat(values[-1:], more, axis=0)])

        return Linearised(
            time=np.concatenate([self.time, self.time[-1] + step * np.arange(1, more + 1)]), drives=self.drives,
            mass=longer(self.mass), rates=longer(self.rates), slopes=longer(self.slopes), springs=longer(self.springs),
        )  # fmt: skip

    @cached_property
    def steps(self) -> tuple[Array, Array]:
        """State matrices (n - 1, s, s) and inputs' (n - 1, s, m) of one step each; the joints' positions come first."""
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
        """A (n, s, s) and B (n, s, m) of x' = A x + B u; x: positions, velocities, then each motor's."""
        n, m = len(self.time), len(self.drives)
        motors = self._moving
        integrals = [
            (index, joint, motor) for index, (joint, motor) in enumerate(motors) if self.drives[joint].integral[motor] > 0.0
        ]
        size = 2 * m + 2 * len(motors) + len(integrals)
        a, b = np.zeros((n, size, size)), np.zeros((n, size, m))
        inverse = np.linalg.inv(self.mass)
        load, drag = self.slopes.copy(), self.rates.copy()
        diagonal = np.arange(m)
        for joint, drive in enumerate(self.drives):
            mode = drive.mode
            load[:, joint, joint] += self.springs[:, joint].sum(axis=1) if mode.spring else drive.proportional[0]
            drag[:, joint, joint] += 0.0 if mode.spring else drive.derivative[0]
        a[:, diagonal, m + diagonal] = 1.0
        a[:, m : 2 * m, :m] = -inverse @ load
        a[:, m : 2 * m, m : 2 * m] = -inverse @ drag
        for joint, drive in enumerate(self.drives):
            if not drive.mode.spring:
                b[:, m : 2 * m, joint] = inverse[:, :, joint] * drive.proportional[0]
            elif not drive.proportional:
                driven = self.springs[:, joint] @ _rho(drive)
                b[:, m : 2 * m, joint] = inverse[:, :, joint] * driven[:, None]
        for index, (joint, motor) in enumerate(motors):
            drive, row = self.drives[joint], 2 * m + 2 * index
            k, inertia = self.springs[:, joint, motor], drive.motor_inertia[motor]
            a[:, m : 2 * m, row] += inverse[:, :, joint] * k[:, None]
            a[:, row, row + 1] = 1.0
            a[:, row + 1, row] = -(drive.proportional[motor] + k) / inertia
            a[:, row + 1, row + 1] = -(drive.motor_damping[motor] + drive.derivative[motor]) / inertia
            a[:, row + 1, joint] = k / inertia
            b[:, row + 1, joint] = drive.proportional[motor] * _rho(drive)[motor] / inertia
        for index, (which, joint, motor) in enumerate(integrals):
            drive, row, own = self.drives[joint], 2 * m + 2 * which, 2 * m + 2 * len(motors) + index
            a[:, row + 1, own] = drive.integral[motor] / drive.motor_inertia[motor]
            a[:, own, row] = -1.0
            b[:, own, joint] = _rho(drive)[motor]
        return a, b

    @property
    def _moving(self) -> list[tuple[int, int]]:
        """(joint, motor) of the motors that have states, in their order."""
        return [(joint, motor) for joint, drive in enumerate(self.drives) for motor in range(_moving_motors(drive))]

    @cached_property
    def pushed(self) -> Array:
        """(n - 1, s, m): the states for torques on the links during each step."""
        step, m = float(self.time[1] - self.time[0]), len(self.drives)
        change = 0.5 * (self.continuous[0][1:] + self.continuous[0][:-1])
        torques = np.zeros((*change.shape[:2], m))
        torques[:, m : 2 * m] = np.linalg.inv(0.5 * (self.mass[1:] + self.mass[:-1]))
        return np.asarray(np.linalg.solve(np.eye(change.shape[1]) - 0.5 * step * change, step * torques))

    def released(self, positions: Array, velocities: Array, motors: Array, rates: Array) -> Array:
        """(n, m) positions after a start that is off by so much: (m,) of the links, (m, 2) of the motors."""
        states, _ = self.steps
        m = len(self.drives)
        start = np.zeros(states.shape[1])
        start[:m], start[m : 2 * m] = positions, velocities
        for index, (joint, motor) in enumerate(self._moving):
            start[2 * m + 2 * index], start[2 * m + 2 * index + 1] = motors[joint, motor], rates[joint, motor]
        return self._positions(start, lambda index, state: states[index] @ state)

    def response(self, change: Array, friction: Friction | None = None) -> Array:
        """(n, m) change of the positions for a change (n, m) of the inputs; with what friction makes of it."""
        states, inputs = self.steps
        pushes = np.einsum("nij,nj->ni", inputs, 0.5 * (change[1:] + change[:-1]))
        rest = np.zeros(states.shape[1])
        if friction is None or not friction.level.any():
            return self._positions(rest, lambda index, state: states[index] @ state + pushes[index])
        moving = slice(len(self.drives), 2 * len(self.drives))
        effect = self.pushed
        slips = 0.5 * effect[:, moving]
        alone = (1.0 / np.diagonal(slips, axis1=1, axis2=2)).tolist()
        rows, before = slips.tolist(), friction.torques.tolist()
        force = before[0]

        def held(index: int, state: Array) -> Array:
            nonlocal force
            free = states[index] @ state + pushes[index]
            sliding = friction.velocities[index] + 0.5 * (state[moving] + free[moving])
            force = friction.hold(sliding.tolist(), rows[index], alone[index], before[index], force)
            return np.asarray(free - effect[index] @ (force - friction.torques[index]))

        return self._positions(rest, held)

    def _positions(self, state: Array, following: Callable[[int, Array], Array]) -> Array:
        """(n, m) positions from a state (s,) on; `following` gives the state after each step."""
        found = np.empty((len(self.time), len(self.drives)))
        found[0] = state[: len(self.drives)]
        for index in range(len(self.time) - 1):
            state = following(index, state)
            found[index + 1] = state[: len(self.drives)]
        return found


def _moving_motors(drive: Drive) -> int:
    return len(drive.motor_inertia) if drive.mode.controller and drive.mode.spring else 0


def _rho(drive: Drive) -> Array:
    return reference_map(drive, np.zeros(1))[0]


def linearise_along(
    model: DynamicModel,
    drives: Sequence[Drive],
    motion: DesiredMotion,
    springs: Array,
    damping: Sequence[float],
) -> Linearised:
    """The joints of `drives` along `motion` (columns in the model's order); the model's other joints are held to it.

    springs: (n, joints, 2) N m/rad, slopes of each drive's springs; damping: N m s/rad of each link.
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
    """Straight lines between samples (k, m, m) at `knots`, at `time`."""
    from scipy.interpolate import make_interp_spline

    return lambda values: np.asarray(make_interp_spline(knots, values, k=1)(time))


def spring_slopes(drive: Drive, position: Array, motors: Array, limit: float = CLIP) -> Array:
    """(n, 2) N m/rad: d tau_i / d theta_i at motors (n, 2); 0 for an adjuster.

    limit: share of the deflection limit at which springs beyond it are taken, since at the limit they have no slope.
    """
    most = limit * drive.max_deflection
    deflections = np.clip(motors - position[:, None], -most, most)
    return chords(drive, position, motors, deflections - NUDGE, deflections + NUDGE)


def chords(drive: Drive, position: Array, motors: Array, one: Array, other: Array) -> Array:
    """(n, 2) N m/rad: mean slope of each spring between deflections `one` and `other` (n, 2), its other motor where it is."""
    law = over_arrays(drive.actuator.elastic_torques)
    found = np.zeros_like(motors)
    for motor in range(drive.actuator.motors):
        ends = []
        for deflection in (one, other):
            at = motors.copy()
            at[:, motor] = position + deflection[:, motor]
            ends.append(law(position, at[:, 0], at[:, 1], drive.elastic).sum(axis=0))
        found[:, motor] = (ends[1] - ends[0]) / (other - one)[:, motor]
    return found
