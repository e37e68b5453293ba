"""Arm with two links, stops and dry friction, and its independent solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asrsim.robot import Robot
from support.event_driven import EventDriven
from support.pinocchio_model import PinocchioModel
from validation.models import Body, chain

LINKS = Body(mass=0.5, reach=0.15, inertia=2e-3, length=0.3)


def limit(lower: float, upper: float) -> str:
    """Element with position limits in rad, and large limits otherwise."""
    return f'<limit lower="{lower!r}" upper="{upper!r}" effort="1000" velocity="1000"/>'


def stopped(
    link: Body, friction: Sequence[float], lower: Sequence[float], upper: Sequence[float], *, gravity: float
) -> tuple[Robot, EventDriven]:
    """Arm with two equal links, and its independent solution. friction: N m, lower, upper: rad, of both joints."""
    levels, low, high = (tuple(map(float, pair)) for pair in (friction, lower, upper))
    robot = chain(*(replace(link, friction=levels[j], limits=limit(low[j], high[j])) for j in (0, 1)))
    model = PinocchioModel(robot.text, ("joint_1", "joint_2"), (0.0, 0.0, -gravity))
    return robot, EventDriven(model, lambda _: np.array(levels), low, high)
