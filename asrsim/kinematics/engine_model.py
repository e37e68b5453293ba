"""Rigid-body model of a run: the engine's model of the robot on its base, without other objects."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from asrsim.samples import Array

if TYPE_CHECKING:
    from asrsim.engines.base import Model
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


@contextmanager
def model_of(scenario: Scenario, robot: Robot) -> Iterator[Model]:
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
        yield engine.model


def inverse_dynamics(model: Model, positions: Array, velocities: Array, accelerations: Array) -> Array:
    """Joint torques (k, n) of the rigid, undamped robot in a motion, N m. All arguments are (k, n), one posture per row."""
    rows = zip(positions, velocities, accelerations, strict=True)
    return np.array([model.inverse_dynamics(q, v, a) for q, v, a in rows]).reshape(positions.shape)
