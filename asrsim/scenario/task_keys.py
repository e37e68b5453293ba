"""Keys of a Cartesian task, and their data classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from asrsim.document.block import block_of, declare
from asrsim.document.composite import ListOf, MapOf
from asrsim.document.kinds import NOT_NEGATIVE, NUMBER, POSITIVE, Boolean, Choice, Optional, Text
from asrsim.errors import ScenarioError
from asrsim.scenario.kinds import ORIGIN, POSITION, RPY, Vector


@dataclass(frozen=True, kw_only=True)
class CartesianPose:
    """Waypoint of a Cartesian task."""

    time: float = declare(NOT_NEGATIVE, unit="s", doc="time at which the pose is reached")
    position: Vector = declare(POSITION, unit="m", doc="position in the world's frame")
    rpy: Vector | None = declare(Optional(RPY), default=None, unit="rad", doc="orientation", shown="free")


@dataclass(frozen=True, kw_only=True)
class CartesianTask:
    """Path of a point on a link, from which closed-loop inverse kinematics computes equilibrium references."""

    link: str = declare(Text(noun="name of a link"), doc="the link that moves along the path")
    poses: tuple[CartesianPose, ...] = declare(
        ListOf(of=block_of(CartesianPose, "pose"), minimum=1), doc="the path, in ascending time"
    )
    point: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="the point on the path, in the link's frame")
    joints: tuple[str, ...] = declare(
        ListOf(of=Text(noun="name of a joint")), default=(), doc="joints that move",
        shown="all actuated ones between base and link",
    )  # fmt: skip
    gain: float = declare(POSITIVE, default=10.0, unit="1/s", doc="gain of the closed loop")
    damping: float = declare(POSITIVE, default=1e-3, unit="m", doc="damping of the least squares")
    interpolation: str = declare(Choice(("minimum_jerk", "linear")), default="minimum_jerk", doc="between the poses")
    gravity_compensation: bool = declare(
        Boolean(), default=False, doc="add the springs' deflection under gravity to the equilibrium"
    )
    motor_droop: bool = declare(Boolean(), default=False, doc="compensate the motors' steady-state error under load too")
    preset: Mapping[str, float] = declare(
        MapOf(of=NUMBER, bare=True), default={}, unit="rad",
        doc="stiffness preset of the joints, where `references` give none",
    )  # fmt: skip
    tolerance: float = declare(
        POSITIVE, default=1e-3, unit="m", doc="largest distance from the path; beyond, the path is unreachable"
    )

    def __post_init__(self) -> None:
        for before, after in pairwise(pose.time for pose in self.poses):
            if after <= before:
                message = f"times must ascend, but {after:g} follows {before:g}"
                raise ScenarioError(message, key="poses", code="order")
        if len({pose.rpy is None for pose in self.poses}) > 1:
            message = "either all poses have an orientation (rpy) or none"
            raise ScenarioError(message, key="poses", code="mixed-orientation")


TASK = block_of(CartesianTask, "Cartesian task")
