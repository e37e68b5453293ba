"""What motors and springs of every actuator do in every mode, forwards and backwards, without a simulation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from robots import drive_with

from over_ranges import Asked, T, found, shapes

MOTION = 0.3 * shapes(T)["creep"][::8]
TIME = T[::8]
SPEED = np.gradient(MOTION, TIME)
TORQUE = 0.2 * np.cos(9.0 * TIME)
PRESET = np.full(len(TIME), 0.1)


def of_drives() -> Asked:
    backwards, forwards = found("kinematics.drive_inverse.drive_backwards"), found("kinematics.drive_forward.motor_positions")
    torque_of, rest = found("kinematics.drive_forward.link_torque"), found("actuators.rest.resting_motors")
    for path in ("sea.Sea", "qbmove.QbMove", "bavs.Bavs", "awas_ii.AwasII"):
        actuator = found(f"actuators.{path}")
        spring = [parameter.default for parameter in actuator.parameters]
        yield f"{path} goals", found("actuators.vectorised.references_over_arrays")(actuator), [(MOTION, PRESET)]
        for mode in (1, 3, 5, 6):
            gains = {"proportional": (9.0, 7.0), "derivative": (0.2, 0.1), "integral": (0.0 if mode % 2 else 5.0,) * 2}
            drive = drive_with(actuator, spring, mode, **gains, inertia=(0.01, 0.02), max_torque=(0.5, 0.4))
            yield f"{path} {mode} presets", found("learning.presets._range"), [(drive,)]
            yield f"{path} {mode} backwards", lambda d: backwards(d, TIME, MOTION, SPEED, TORQUE, PRESET), [(drive,)]
            yield f"{path} {mode} forwards", lambda d: forwards(d, TIME, MOTION, MOTION + 0.05, PRESET), [(drive,)]
            yield (
                f"{path} {mode} torque",
                lambda d: torque_of(d, MOTION, SPEED, forwards(d, TIME, MOTION, MOTION + 0.05, PRESET), MOTION + 0.1),
                [(drive,)],
            )
            yield (
                f"{path} {mode} score",
                lambda d: found("learning.presets.scores")(d, TIME, MOTION, SPEED, TORQUE, 0.01, PRESET),
                [(drive,)],
            )
            yield f"{path} {mode} rest", lambda d, q: rest(d, q, (0.3, 0.1)), [(drive, q) for q in (-0.4, 0.0, 0.2)]
    yield "roots", found("actuators.rest.increasing_root"), [(law, s, 0.1) for law in LAWS for s in (-1.0, 0.0, 0.7)]


def _steep(x: float) -> float:
    return math.inf if x > 1.0 else -math.inf if x < -2.0 else x - 0.4


LAWS: tuple[Callable[[float], float], ...] = (lambda x: x - 0.3, lambda x: x**3 + x, _steep, math.atan, lambda x: 1.0 + 0.0 * x)
