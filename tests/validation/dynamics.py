"""Checks of the engines' rigid-body dynamics against Pinocchio, for the example robots and for rotated bases."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asrsim.robot import Robot, load_robot
from asrsim.scenario import Scenario
from asrsim.simulation.engine import make_engine
from support.pinocchio_model import PinocchioModel, differences, without_stops
from validation.check import Check
from validation.check import engine as current
from validation.models import Body, chain

EXAMPLES = Path(__file__).parents[2] / "examples" / "urdf"
TURN = (0.3, -0.5, 1.1)
"""Roll, pitch and yaw of the rotated base, rad."""
GRAVITY = (0.0, 0.0, -9.81)
SAMPLES = 20


def robots() -> Iterator[tuple[str, Robot]]:
    """Yield the example robots and a chain with axes in all directions, with their names."""
    for path in sorted(EXAMPLES.glob("*.urdf")):
        yield path.stem, load_robot(path)
    body = Body(mass=0.5, reach=0.06, inertia=4e-4, length=0.12)
    axes = ("1 0 0", "0 1 0", "0 0 1", "0.6 0.0 0.8")
    yield "chain of 4, axes x, y, z, oblique", chain(*(replace(body, axis=axis) for axis in axes))


def rigid_body() -> Iterator[Check]:
    """Errors of mass matrix, gravity torques and velocity torques at random states, from single steps."""
    for name, robot in robots():
        joints = [joint.name for joint in robot.moving_joints]
        for label, rpy in (("", (0.0, 0.0, 0.0)), (", base turned", TURN)):
            gravity = Rotation.from_euler("xyz", rpy).inv().apply(GRAVITY)
            truth = PinocchioModel(robot.text, joints, gravity)
            scenario = Scenario(name="check", robot=robot.path, gravity=GRAVITY, base_rpy=rpy, engine=current())
            engine, _ = make_engine(scenario, without_stops(robot))
            states = np.random.default_rng(1).uniform(-1.5, 1.5, (SAMPLES, 2, len(joints)))
            try:
                worst = np.max([differences(engine, truth, q, v) for q, v in states], axis=0)
            finally:
                engine.close()
            for what, error in zip(("mass matrix", "gravity torques", "gravity and velocity torques"), worst, strict=True):
                yield Check(
                    name=f"{what}, {name}{label}", figure=float(error), bound=1e-12, source="Pinocchio, fraction of the largest"
                )
