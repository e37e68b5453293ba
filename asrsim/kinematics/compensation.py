"""Gravity compensation: the equilibrium at which a spring holds a given load at a given link position.

The elastic law is inverted numerically, so it works for every registered actuator: at a fixed preset the torque on the
link grows with the equilibrium, up to what the spring can hold.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import increasing_root, resting_motors
from asrsim.errors import InputError, Problem
from asrsim.samples import Array

SEARCH = 16.0
"""rad (or m) from the link's position within which an equilibrium is looked for: some turns of a motor."""


class LoadError(InputError):
    """A spring or motor cannot hold a load; `largest` is what it can hold in N m."""

    def __init__(self, problem: Problem, largest: float) -> None:
        super().__init__(problem)
        self.largest = largest


def equilibrium_for_load(
    drive: Drive, position: float, load: float, preset: float, *, droop: bool = False, guess: float | None = None
) -> float:
    """Equilibrium position in rad at which the springs put `load` (N m) on a link at `position` (rad).

    preset: the second reference (stiffness preset, or adjuster in m). droop: with the motors' steady-state error
    under their load. guess: an equilibrium nearby, which saves time. Raises LoadError where the springs or the motors
    cannot hold the load.
    """
    law, spring = drive.actuator.elastic_torques, drive.elastic

    def motors(equilibrium: float) -> tuple[float, float]:
        references = drive.actuator.motor_references(equilibrium, preset)
        return resting_motors(drive, position, references, limited=False) if droop else references

    def surplus(equilibrium: float) -> float:
        try:
            return sum(law(position, *motors(equilibrium), spring)) - load
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
    """(n,) :func:`equilibrium_for_load` over a motion, all arrays (n,). Raises LoadError, which names the time in s."""
    found = np.empty(len(time))
    guess: float | None = None
    rows = zip(time.tolist(), positions.tolist(), loads.tolist(), presets.tolist(), strict=True)
    for row, (moment, position, load, preset) in enumerate(rows):
        try:
            found[row] = guess = equilibrium_for_load(drive, position, load, preset, droop=droop, guess=guess)
        except LoadError as error:
            problem = error.problems[0]
            raise LoadError(replace(problem, message=f"at {moment:.4g} s: {problem.message}"), error.largest) from error
    return found
