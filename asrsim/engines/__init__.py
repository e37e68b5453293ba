"""Engines: they know joints and torques, never springs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from asrsim.engines.base import ENGINES, Engine

if TYPE_CHECKING:
    from asrsim.errors import Problem
    from asrsim.robot.model import Robot
    from asrsim.scenario.data import Scenario


def _bullet(scenario: Scenario, robot: Robot, *, visuals: bool = False) -> tuple[Engine, tuple[Problem, ...]]:
    from asrsim.engines.bullet import BulletEngine
    from asrsim.robot import engine_urdf

    text, warnings = engine_urdf(robot, visuals=visuals, package_paths=scenario.package_paths)
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
        visuals=visuals,
    )
    return engine, tuple(warnings)


def _bench(scenario: Scenario, robot: Robot, *, visuals: bool = False) -> tuple[Engine, tuple[Problem, ...]]:
    from asrsim.engines.bench import BenchEngine

    return BenchEngine(scenario, robot), ()


ENGINES.add("bullet", _bullet)
ENGINES.add("bench", _bench)

__all__ = ["ENGINES", "Engine"]
