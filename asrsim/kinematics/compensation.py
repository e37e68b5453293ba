"""Gravity compensation: the equilibrium position at which a spring holds a given load at a given link position.

The elastic law is inverted numerically, so that this works for every registered actuator. At a fixed preset the torque on
the link increases with the equilibrium position, up to the largest torque of the spring.
"""

from __future__ import annotations

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.rest import increasing_roots, resting_motors
from asrsim.actuators.vectorised import over_arrays
from asrsim.errors import ScenarioError
from asrsim.samples import Array

SEARCH = 16.0
"""Largest distance of the equilibrium from the link position in the search, rad or m: a few turns of a motor."""
EXACT = 1e-9
"""Largest relative error of the torque at which the spring counts as holding the load."""


def equilibrium_for_load(drive: Drive, position: float, load: float, preset: float, *, droop: bool = False) -> float:
    """Equilibrium position in rad at which the springs put `load` (N m) on a link at `position` (rad).

    preset: the second reference (stiffness preset, or adjuster in m). droop: whether to include the steady-state error of the
    motors under their load. Raises ScenarioError if the springs or the motors cannot hold the load.
    """
    values = (np.array([value], dtype=float) for value in (position, load, preset))
    return float(equilibria_for_loads(drive, *values, droop=droop)[0])


def equilibria_for_loads(
    drive: Drive, positions: Array, loads: Array, presets: Array, *, droop: bool, time: Array | None = None
) -> Array:
    """Equilibrium positions (n,) at the instants of a motion, rad; see `equilibrium_for_load`. All arrays are (n,).

    time: times for error messages, s.
    """
    law, references = over_arrays(drive.actuator.elastic_torques), over_arrays(drive.actuator.motor_references)

    def torques(equilibria: Array) -> Array:
        motors = references(equilibria, presets)
        motors = resting_motors(drive, positions, motors, limited=False) if droop else motors
        return law(positions, *motors, drive.elastic)

    found = increasing_roots(lambda equilibria: torques(equilibria).sum(axis=0) - loads, positions, farthest=SEARCH)
    springs = torques(found)
    missing = np.abs(springs.sum(axis=0) - loads) > EXACT * np.maximum(1.0, np.abs(loads))
    limits = np.array([*drive.max_torque, *[np.inf] * len(springs)][: len(springs)])
    overloaded = np.abs(springs) > limits[:, None]
    if not (missing.any() or overloaded.any()):
        return found
    row = int(np.argmax(missing | overloaded.any(axis=0)))
    when = "" if time is None else f"at {time[row]:.4g} s: "
    where = f"at position {positions[row]:.4g} rad"
    if missing[row]:
        largest = springs[:, row].sum()
        message = f"the spring cannot hold {loads[row]:.4g} N m {where}: the most it can hold that way is {largest:.4g} N m"
        hint, code = "choose a stiffer preset or spring, or another posture", "spring-too-weak"
    else:
        motor = int(np.argmax(overloaded[:, row]))
        message = (
            f"motor {motor + 1} would have to hold {abs(springs[motor, row]):.4g} N m {where} under a load of "
            f"{loads[row]:.4g} N m and preset {presets[row]:.4g}, but its limit is {limits[motor]:.4g} N m"
        )
        hint, code = "raise the motor's maximum torque or lower the stiffness preset", "motor-too-weak"
    raise ScenarioError(f"gravity cannot be compensated {when}{message}", key=f"task.{drive.joint}", hint=hint, code=code)
