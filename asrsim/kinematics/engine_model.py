"""Rigid-body model of a run: the engine's model of the robot on its base with joint stops, without other objects.

Tests and users may replace `EngineModel` by any class with the same members.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.engines.base import Point
from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.engines.base import Model
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


class EngineModel:
    """Kinematics, mass matrix and torques of a robot from an engine's model; all arrays are in the order of `joints`."""

    def __init__(self, model: Model, robot: Robot) -> None:
        self._model = model
        self.joints: tuple[str, ...] = model.joints
        self.links: tuple[str, ...] = tuple(link.name for link in robot.links)
        self.lower, self.upper = np.array([robot.joint(name).stops for name in self.joints]).reshape(-1, 2).T
        """Lower and upper stops (n,), rad or m; infinite for joints without stops."""

    def pose(self, positions: Array, link: str, point: Point) -> tuple[Array, Array]:
        """Position (3,) in m of `point` (m, in the frame of `link`) and rotation (3, 3) of the link, in the world."""
        return self._model.link_point(link, point, positions)[:2]

    def jacobian(self, positions: Array, link: str, point: Point) -> Array:
        """Jacobian (6, n): velocity of the point and angular velocity of the link per joint velocity."""
        return self._model.link_point(link, point, positions)[2]

    def gravity_torques(self, positions: Array) -> Array:
        """Joint torques (n,) that hold the robot at rest against gravity, N m: G(q) of the paper's equation 1."""
        return self._model.bias(positions, np.zeros(len(self.joints)))

    def inverse_dynamics(self, positions: Array, velocities: Array, accelerations: Array) -> Array:
        """Joint torques (k, n) of the rigid, undamped robot in a motion, N m. All arguments are (k, n), one posture per row."""
        rows = zip(positions, velocities, accelerations, strict=True)
        return np.array([self._model.inverse_dynamics(q, v, a) for q, v, a in rows]).reshape(positions.shape)


@contextmanager
def model_of(scenario: Scenario, robot: Robot) -> Iterator[EngineModel]:
    """Context with the model of a scenario's robot on its base under gravity, without the objects of the world.

    If the scenario's engine computes no dynamics, the model of the default engine is used.
    """
    from asrsim.engines import ENGINES, default_engine
    from asrsim.scenario.data import World

    name = default_engine() if ENGINES.get(scenario.engine).prescribed else scenario.engine
    engine, _ = ENGINES.get(name).make(replace(scenario, world=World(), wrenches=(), engine=name), robot)
    with closing(engine):
        if engine.model is None:
            raise TypeError(f"engine '{name}' has no model")
        yield EngineModel(engine.model, robot)
