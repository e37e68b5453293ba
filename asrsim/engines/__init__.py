"""Engines: they know joints and torques, never springs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from asrsim.engines.base import ENGINES, Engine

if TYPE_CHECKING:
    from asrsim.engines.bullet import BulletEngine
    from asrsim.errors import Problem
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


def make_bullet(scenario: Scenario, robot: Robot) -> tuple[BulletEngine, tuple[Problem, ...]]:
    """The scenario's world in PyBullet, and warnings of what the engine does not take. Raises RobotError, SimulationError."""
    from asrsim.engines.bullet import BulletEngine
    from asrsim.robot import engine_urdf

    text, warnings = engine_urdf(robot, visuals=False, package_paths=scenario.package_paths)
    engine = BulletEngine(
        robot,
        text,
        step=scenario.step,
        gravity=scenario.gravity,
        base_position=scenario.base_position,
        base_rpy=scenario.base_rpy,
        fixed_base=scenario.fixed_base,
        initial_positions=scenario.initial_positions,
        world=scenario.world,
    )
    return engine, tuple(warnings)


def _bench(scenario: Scenario, robot: Robot) -> tuple[Engine, tuple[Problem, ...]]:
    from asrsim.engines.bench import BenchEngine

    return BenchEngine(scenario, robot), ()


ENGINES.add("bullet", make_bullet)
ENGINES.add("bench", _bench)

__all__ = ["ENGINES", "Engine", "make_bullet"]
