"""Motors' friction whose bristles are of another stiffness than the law's own 1000 N m/rad, where recordings ask for it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.identification.fit import fits_noise, is_explained, is_far, left_of
from asrsim.identification.keys import Parameter, parameters_of
from asrsim.identification.layout import Layout
from asrsim.identification.residuals import Residuals
from asrsim.identification.steps import followed
from asrsim.identification.task import Tie
from asrsim.robot.model import Robot
from asrsim.samples import Array

ASKED = 20.0
"""Chi squared of one number from which on recordings ask for it: of noise alone, one time in a hundred thousand."""
FAINT = 0.2
"""The same, as a share, beside what others do likewise."""
MUCH = 0.5
"""Share of the squares that may be left of a model that is far off without."""
STEP = 1e-4
"""Of a difference, in the logarithm of a stiffness."""
FACTORS = (0.03, 0.1, 0.3, 3.0, 10.0, 30.0, 100.0)
"""Of the law's own stiffness: from friction that gives way to one that hardly does."""


def with_bristles(residuals: Residuals, x: Array, robot: Robot) -> tuple[Layout, Array]:
    """Layout and vector with such a stiffness free beside the rest, as near as a look along it comes; the same where no
    recording asks for it. robot: with the scenario's numbers.
    """
    layout, found = residuals.layout, left_of(residuals, x)
    if is_explained(found):
        return layout, x
    fits = fits_noise(found)
    wrong = not fits and is_far(found)
    for parameter, ties in _stiffnesses(layout, robot):
        wider = residuals.under(layout.extended(parameter, ties))
        base = wider(np.append(x, 0.0))
        slope = (wider(np.append(x, STEP)) - base) / STEP
        least = ASKED * float(np.mean(base**2))
        # Where a motor sticks, slopes tell little of bristles that are far stiffer; what a fit leaves then does.
        if not np.any(slope) or (fits and float(slope @ base) ** 2 < FAINT * least * float(slope @ slope)):
            continue
        # What others explain is no part of what is left.
        others = np.linalg.qr(residuals.under(layout).jacobian(x, base=base))[0]
        base -= others @ (others.T @ base)
        places = [np.append(x, move) for move in np.log(FACTORS)]
        sizes = [(track, track.prepared.resolution) for track in residuals.tracks]
        left = [_left(wider, place, others) for place in places]
        for track, resolution in sizes:
            track.resolve(resolution.substeps, resolution.motor_substeps)
        # Of a model that is wrong otherwise, any number more explains a part.
        if min(left) < (float(base @ base) - least) * (MUCH if wrong else 1.0):
            layout, x = wider.layout, places[int(np.argmin(left))]
    return layout, x


def _left(residuals: Residuals, x: Array, others: Array) -> float:
    """Sum of squares that other entries, whose slopes (m, n) are orthonormal, cannot make good."""
    followed(residuals, x, residuals.tracks)
    left = residuals(x)
    return float(np.sum((left - others @ (others.T @ left)) ** 2))


def _stiffnesses(layout: Layout, robot: Robot) -> Iterator[tuple[Parameter, list[Tie]]]:
    """Those that nobody gave; of motors whose friction is one number, it is one, too."""
    known, tied = parameters_of(robot, (), {}), {tie.key: tie.to for tie in layout.ties}
    taken = {*tied, *(entry.parameter.key for entry in layout.entries)}
    groups: dict[str, list[str]] = {}
    for block in robot.actuators:
        for i in range(1, ACTUATORS.get(block.actuator).motors + 1):
            name = f"motor_{i}_friction_stiffness"
            root = f"{block.joint}.motor_{i}_friction_torque"
            while root in tied:
                root = tied[root]
            if block.parameters[name].origin == "default" and f"{block.joint}.{name}" not in taken:
                groups.setdefault(root, []).append(f"{block.joint}.{name}")
    for first, *others in groups.values():
        yield known[first], [Tie(key=key, to=first) for key in others]
