"""Mass matrix at the initial positions. Every motion of the joints must move some inertia."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.errors import Problem, RobotError
from asrsim.robot.dynamics import RobotModel
from asrsim.robot.massless import SINGULAR
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint


def masses_at_start(drives: Sequence[SteppedJoint], model: RobotModel) -> Array:
    """Mass matrix (n, n) in kg m^2 (kg) at the initial positions.

    Raises RobotError if a motion moves no inertia there. Examples are a joint with a point mass on its axis, and two joints on
    one axis without mass between the joints.
    """
    mass = model.mass_matrix([drive.initial_position for drive in drives])
    problems = [
        Problem(
            f"the links that joint '{drive.name}' moves have no inertia about its axis, so its motion is not defined",
            line=drive.joint.line,
            key=drive.name,
            hint=f"Give link '{drive.joint.child}' an inertia, or fix the joint: `locked: [{drive.name}]`",
            code="massless-joint",
        )
        for j, drive in enumerate(drives)
        if not mass[j, j] > 0.0
    ]
    if problems:
        raise RobotError(problems)
    scale = 1.0 / np.sqrt(np.diag(mass))
    values, vectors = np.linalg.eigh(mass * np.outer(scale, scale))
    if values[0] < SINGULAR:
        share = np.linalg.norm(vectors[:, values < SINGULAR], axis=1)
        names = ", ".join(f"'{drive.name}'" for drive, part in zip(drives, share, strict=True) if part > 0.1 * share.max())
        raise RobotError(
            f"joints {names} can move against each other without moving any mass: their motion is not defined",
            hint="Give inertias to the links between these joints, or fix one of the joints: `locked: [NAME]`",
            code="massless-motion",
        )
    return mass
