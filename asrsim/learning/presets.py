"""Stiffness presets chosen before learning: the lowest that hold the joints' limits and the tolerance.

A preset p holds the tolerance if the link sags by no more where the masses are heavier than the model says by a share of 15 %:
0.15 |tau| / K(p) <= tolerance, and the limits if nothing is asked of motors and springs beyond 95 % of what they can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.actuators.vectorised import over_arrays
from asrsim.kinematics.drive_inverse import drive_backwards
from asrsim.kinematics.inverse import InverseDynamics, demands_of
from asrsim.learning.arm import ArmModel
from asrsim.samples import Array

HEAVIER = 0.15
"""Share by which masses may be off."""
WITHIN = 0.95
"""Share of a limit that may be used."""
CANDIDATES = 24
"""Presets that are compared, evenly in their logarithm."""
REFINED = 5
"""Halvings of the distance to the lowest preset."""


@dataclass(frozen=True, kw_only=True)
class ChosenPreset:
    """A joint's preset."""

    joint: str
    value: float
    score: float
    """Of its limits and the tolerance, at most 1 where it holds them."""


def choose_presets(model: ArmModel, inverse: InverseDynamics, tolerance: float) -> tuple[ChosenPreset, ...]:
    """The lowest preset of each learned joint that has one; of those that hold nothing, the best."""
    found = []
    for column, drive in enumerate(model.plant.drives):
        if len(drive.mode.references) < 2 or not (drive.actuator.adjuster or drive.actuator.motors > 1):
            continue
        q = inverse.motion.positions[:, model.arm.model.joints.index(drive.joint)]
        v = inverse.motion.velocities[:, model.arm.model.joints.index(drive.joint)]
        torque, time = inverse.torques[:, column], inverse.motion.time

        score = partial(scores, drive, time, q, v, torque, tolerance)
        value, reached = _lowest(score, _range(drive), len(time))
        found.append(ChosenPreset(joint=drive.joint, value=value, score=reached))
    return tuple(found)


def scores(drive: Drive, time: Array, q: Array, v: Array, torque: Array, tolerance: float, preset: Array) -> Array:
    """(n,) how far a preset (n,) uses limits and tolerance, 1: wholly. Demands count where they are highest."""
    item = drive_backwards(drive, time, q, v, torque, preset)
    stiffness = over_arrays(drive.actuator.stiffness)(q, item.motors[:, 0], item.motors[:, 1], drive.elastic)
    with np.errstate(all="ignore"):
        sag = np.nan_to_num(HEAVIER * np.abs(torque) / np.maximum(stiffness, 0.0), nan=0.0, posinf=np.inf) / tolerance
    for demand in demands_of(drive, time, q, torque, item):
        at = int(np.searchsorted(time, demand.time))
        sag[at] = max(sag[at], demand.score / WITHIN)
    return np.asarray(sag)


def _range(drive: Drive) -> Array:
    """(k,) presets that are tried, ascending."""
    names = [parameter.name for parameter in drive.actuator.parameters]
    if drive.actuator.adjuster and "lever_length" in names:
        most = 0.8 * drive.elastic[names.index("lever_length")]
    elif drive.actuator.adjuster or not np.isfinite(drive.max_deflection):
        most = 4.0 * (drive.actuator.typical_preset or 0.25)
    else:
        most = 0.9 * drive.max_deflection
    return np.asarray(np.geomspace(0.02 * most, most, CANDIDATES))


def _lowest(score: Callable[[Array], Array], tried: Array, count: int) -> tuple[float, float]:
    """The lowest preset whose score is at most 1, else that with the least, and its score."""
    worst: list[float] = []
    for preset in tried:
        worst.append(float(score(np.full(count, preset)).max()))
        if worst[-1] <= 1.0:
            break
    if worst[-1] > 1.0:
        best = int(np.argmin(worst))
        return float(tried[best]), worst[best]
    high, reached = float(tried[len(worst) - 1]), worst[-1]
    low = float(tried[max(len(worst) - 2, 0)])
    for _ in range(REFINED if len(worst) > 1 else 0):
        middle = 0.5 * (low + high)
        at = float(score(np.full(count, middle)).max())
        if at <= 1.0:
            high, reached = middle, at
        else:
            low = middle
    return high, reached
