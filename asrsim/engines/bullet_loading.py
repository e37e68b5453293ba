"""Load a robot into PyBullet, which reads only files, may crash on a mesh, and prints to the terminal. No other module imports
PyBullet."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any
from weakref import finalize

from asrsim.engines.foreign import crashes, quiet
from asrsim.errors import RobotError
from asrsim.robot.inertia import principal_axes
from asrsim.robot.model import Robot
from asrsim.scenario.data import Scenario

NO_CLAMP = 1e9
"""Limit in rad/s at which Bullet clips joint velocities (Bullet's default is 100); so large that the limit never acts."""


def connect(owner: object) -> tuple[Any, int, finalize[..., Any]]:
    """The module `pybullet`, the number of a new physics client (28 MB), and a function that ends the client. The client
    ends at the latest when `owner` is garbage-collected."""
    with quiet():
        import pybullet

        client = pybullet.connect(pybullet.DIRECT)
    return pybullet, client, finalize(owner, _disconnect, pybullet, client)


def _disconnect(p: Any, client: int) -> None:
    with suppress(p.error), quiet():
        p.disconnect(client)


def load_body(p: Any, client: int, urdf: str, scenario: Scenario, robot: Robot) -> int:
    """Bullet's body number of a robot that is loaded from the URDF text, on the scenario's base. Raises RobotError."""
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(urdf, encoding="utf-8")
        load = partial(
            p.loadURDF,
            str(path),
            basePosition=scenario.base_position,
            baseOrientation=p.getQuaternionFromEuler(scenario.base_rpy),
            useFixedBase=scenario.fixed_base,
            flags=p.URDF_USE_INERTIA_FROM_FILE | p.URDF_IGNORE_VISUAL_SHAPES,
            physicsClientId=client,
        )
        try:
            with quiet():
                if "<mesh" in urdf and crashes(load):
                    message = "PyBullet crashes when it loads this robot; most likely a mesh is at fault"
                    raise RobotError(message, file=robot.path, code="engine-crash")
                return int(load())
        except p.error as error:
            message = f"PyBullet cannot load this robot ({error})"
            raise RobotError(message, file=robot.path, code="engine-load") from error


def set_inertias(p: Any, client: int, body: int, links: Mapping[str, int], robot: Robot, lift: float = 0.0) -> None:
    """Set the principal moments of inertia of the links (name -> Bullet's number) to the robot's data plus `lift` kg m^2.

    Bullet itself loads zeros where the largest moment exceeds the sum of the others, as in many published robots.
    """
    for link in robot.links:
        moments = tuple(moment + lift for moment in principal_axes(link)[0])
        if p.getDynamicsInfo(body, links[link.name], client)[2] != moments:
            p.changeDynamics(body, links[link.name], localInertiaDiagonal=moments, physicsClientId=client)


def free_of_losses(p: Any, client: int, body: int) -> None:
    """Switch off Bullet's damping of links and joints, and its limit on joint velocities."""
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, lateralFriction=1.0, physicsClientId=client)
    for index in range(p.getNumJoints(body, client)):
        p.changeDynamics(
            body, index, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=NO_CLAMP, lateralFriction=1.0,
            physicsClientId=client,
        )  # fmt: skip
