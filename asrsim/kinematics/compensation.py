"""Gravity compensation: the equilibrium position at which a spring holds a given load at a given link position.

The elastic law is inverted numerically, so that this works for every registered actuator. At a fixed preset the torque on
the link increases with the equilibrium position, up to the largest torque of the spring.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import increasing_root, resting_motors
from asrsim.actuators.vectorised import over_arrays, references_over_arrays
from asrsim.errors import InputError, Problem
from asrsim.kinematics.roots import increasing_roots
from asrsim.samples import Array

SEARCH = 16.0
"""rad (or m) from the link's position within which the equilibrium is searched for: a few turns of a motor."""
NEWTON_STEPS = 40
"""Largest number of Newton iterations; five are usual."""
CONVERGED = 1e-11
"""rad: Newton's method has converged when its step is smaller than this."""
LARGEST_CHANGE = 0.2
"""rad, largest step of Newton's method: the torque of a spring may grow exponentially."""
NUDGE = 1e-6
"""rad, step of the central differences that give slopes."""


class LoadError(InputError):
    """A spring or motor cannot hold a load; `largest` is the largest load that it can hold, in N m."""

    def __init__(self, problem: Problem, largest: float) -> None:
        super().__init__(problem)
        self.largest = largest


def equilibrium_for_load(
    drive: Drive, position: float, load: float, preset: float, *, droop: bool = False, guess: float | None = None
) -> float:
    """Equilibrium position in rad at which the springs put `load` (N m) on a link at `position` (rad).

    preset: the second reference (stiffness preset, or adjuster in m). droop: include the steady-state error of the motors
    under their load. guess: an equilibrium nearby, which saves time. Raises LoadError if the springs or the motors cannot
    hold the load.
    """
    law: Any = drive.actuator.elastic_torques
    spring = drive.elastic

    def motors(equilibrium: float) -> tuple[float, ...]:
        references = drive.actuator.motor_references(equilibrium, preset)
        return resting_motors(drive, position, references, limited=False) if droop else references

    def surplus(equilibrium: float) -> float:
        try:
            return float(sum(law(position, *motors(equilibrium), spring)) - load)
        except OverflowError:
            return math.copysign(math.inf, equilibrium - position)

    found, short = increasing_root(surplus, position if guess is None else guess, 1e-3, SEARCH)
    if short:
        raise LoadError(
            Problem(
                f"the spring cannot hold {load:.4g} N m at position {position:.4g} rad: "
                f"the most it can hold that way is {short + load:.4g} N m",
                key=drive.joint,
                hint="choose a stiffer preset or spring, or another posture",
                code="spring-too-weak",
            ),
            largest=short + load,
        )
    torques = law(position, *motors(found), spring)
    for motor, (torque, limit) in enumerate(zip(torques, drive.max_torque, strict=False), start=1):
        if abs(torque) > limit:
            raise LoadError(
                Problem(
                    f"motor {motor} would have to hold {abs(torque):.4g} N m at position {position:.4g} rad under a "
                    f"load of {load:.4g} N m and preset {preset:.4g}, but its limit is {limit:.4g} N m",
                    key=drive.joint,
                    hint="raise the motor's maximum torque or lower the stiffness preset",
                    code="motor-too-weak",
                ),
                largest=limit,
            )
    return found


def equilibria_for_loads(drive: Drive, time: Array, positions: Array, loads: Array, presets: Array, *, droop: bool) -> Array:
    """(n,) :func:`equilibrium_for_load` at each instant of a motion; all arrays (n,). Raises LoadError with the time in s.

    All instants are solved together. An instant that does not converge, or that overloads a motor, is solved again alone.
    """
    found, torques = _newton(drive, positions, loads, presets, droop=droop)
    limits = np.array([*drive.max_torque, math.inf, math.inf][:2])[:, None]
    overloaded: Any = (np.abs(torques) > limits).any(axis=0)
    for row in np.flatnonzero(np.isnan(found) | overloaded).tolist():
        position, load, preset = (float(values[row]) for values in (positions, loads, presets))
        guess = float(found[row - 1]) if row else None
        try:
            found[row] = equilibrium_for_load(drive, position, load, preset, droop=droop, guess=guess)
        except LoadError as error:
            problem = error.problems[0]
            raise LoadError(replace(problem, message=f"at {time[row]:.4g} s: {problem.message}"), error.largest) from error
    return found


def _newton(drive: Drive, positions: Array, loads: Array, presets: Array, *, droop: bool) -> tuple[Array, Array]:
    """Equilibria (n,) in rad, NaN where Newton's method does not converge, and the springs' torques (motors, n) in N m.

    The unknowns are the equilibrium e and the motors' positions theta, the equations

        sum tau_i(q, theta) = load,    theta_i + tau_i(q, theta) / P_i = reference_i(e, preset).

    The iteration starts from motors without steady-state error.
    """
    law, references = over_arrays(drive.actuator.elastic_torques), references_over_arrays(drive.actuator)
    yielding = drive.proportional if droop and drive.mode.motor and drive.mode.controller else ()
    gains = [0.0 if integral > 0.0 or not p else 1.0 / p for p, integral in zip(yielding, drive.integral, strict=False)]
    count = drive.actuator.positions()
    compliance = np.array([*gains, *[0.0] * count][:count])[:, None]
    nudges = NUDGE * np.eye(count)[:, :, None]

    def torques(motors: Array) -> Array:
        values = np.asarray(law(positions, *motors, drive.elastic))
        return np.concatenate([values, np.zeros((count - len(values), len(positions)))])

    def goals(equilibrium: Array) -> Array:
        return np.stack(references(equilibrium, presets))

    def surplus(equilibrium: Array) -> Array:
        return np.asarray(torques(goals(equilibrium)).sum(axis=0) - loads)

    with np.errstate(all="ignore"):
        equilibrium = increasing_roots(surplus, positions - SEARCH, positions + SEARCH)
        motors = goals(equilibrium)
        converged = np.zeros(len(positions), dtype=bool)
        for _ in range(NEWTON_STEPS):
            tau, wanted = torques(motors), goals(equilibrium)
            missing = np.concatenate([(loads - tau.sum(axis=0))[None], wanted - motors - compliance * tau])
            slopes = np.stack([(torques(motors + off) - torques(motors - off)) / (2.0 * NUDGE) for off in nudges], axis=1)
            matrix = np.zeros((len(positions), count + 1, count + 1))
            matrix[:, 0, 1:] = slopes.sum(axis=0).T
            matrix[:, 1:, 1:] = np.eye(count) + (compliance[:, None] * slopes).transpose(2, 0, 1)
            matrix[:, 1:, 0] = ((goals(equilibrium - NUDGE) - goals(equilibrium + NUDGE)) / (2.0 * NUDGE)).T
            singular = ~(np.abs(np.linalg.det(matrix)) > 0.0)
            matrix[singular] = np.eye(count + 1)
            change = np.clip(np.linalg.solve(matrix, missing.T[:, :, None])[:, :, 0].T, -LARGEST_CHANGE, LARGEST_CHANGE)
            equilibrium, motors = equilibrium + change[0], motors + change[1:]
            converged = ~singular & (np.abs(change).max(axis=0) < CONVERGED)
            if converged.all():
                break
        return np.where(converged, equilibrium, math.nan), torques(motors)
