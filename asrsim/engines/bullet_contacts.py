"""PyBullet's own step, in a world with contacts."""

from __future__ import annotations

from asrsim.errors import SimulationError
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario


class BulletContacts:
    """Not there yet."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        raise SimulationError("PyBullet has no contacts on this branch yet")
