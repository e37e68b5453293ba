"""Keys of a scenario that state the goal of the robot: a Cartesian task, or a motion to learn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from asrsim.document.block import block_of, declare
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    Boolean,
    Choice,
    Either,
    Integer,
    ListOf,
    MapOf,
    Null,
)
from asrsim.errors import ScenarioError
from asrsim.robot.model import Vector
from asrsim.scenario.kinds import JOINT, LINK, ORIGIN, POSITION, RPY, SIGNALS_BY_JOINT
from asrsim.signals.base import Signal


@dataclass(frozen=True, kw_only=True)
class CartesianPose:
    """Waypoint of a Cartesian task."""

    time: float = declare(NOT_NEGATIVE, unit="s", doc="time at which the pose is reached")
    position: Vector = declare(POSITION, unit="m", doc="position in the world's frame")
    rpy: Vector | None = declare(RPY, default=None, unit="rad", doc="orientation", shown="free")


@dataclass(frozen=True, kw_only=True)
class CartesianTask:
    """Path of a point on a link, from which closed-loop inverse kinematics computes equilibrium references."""

    link: str = declare(LINK, doc="the link that moves along the path")
    poses: tuple[CartesianPose, ...] = declare(
        ListOf(of=block_of(CartesianPose, "pose"), minimum=1), doc="the path, in ascending time"
    )
    point: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="the point on the path, in the link's frame")
    joints: tuple[str, ...] = declare(
        ListOf(of=JOINT), default=(), doc="joints that move", shown="all actuated joints between base and link"
    )
    gain: float = declare(POSITIVE, default=10.0, unit="1/s", doc="gain of the closed loop")
    damping: float = declare(POSITIVE, default=1e-3, unit="m", doc="damping of the least squares that invert the kinematics")
    interpolation: str = declare(
        Choice(("minimum_jerk", "linear")), default="minimum_jerk", doc="motion of the point between two poses"
    )
    gravity_compensation: bool = declare(
        Boolean(), default=False, doc="add the springs' deflection under gravity to the equilibrium"
    )
    motor_droop: bool = declare(Boolean(), default=False, doc="also compensate the motors' steady-state error under load")
    preset: Mapping[str, float] = declare(
        MapOf(of=NUMBER, bare=True), default={}, unit="rad", doc="stiffness preset of joints for which `references` states none"
    )
    tolerance: float = declare(
        POSITIVE,
        default=1e-3,
        unit="m",
        doc="largest distance from the path; at a larger distance the path counts as unreachable",
    )

    def __post_init__(self) -> None:
        for before, after in pairwise(pose.time for pose in self.poses):
            if after <= before:
                message = f"times must ascend, but {after:g} follows {before:g}"
                raise ScenarioError(message, key="poses", code="order")
        if len({pose.rpy is None for pose in self.poses}) > 1:
            message = "all poses must have an orientation (rpy), or no pose"
            raise ScenarioError(message, key="poses", code="mixed-orientation")


LawName = Literal["auto", "paper"]
FirstGuess = Literal["zero", "reference", "inverse_dynamics"]


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Zero-phase filter for the learned input."""

    cutoff: float = declare(POSITIVE, unit="Hz", doc="frequency above which nothing is learned")
    order: int = declare(Integer(minimum=1, maximum=8), default=2, doc="order of the Butterworth filter")


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Settings of iterative learning control: trajectory, law, stopping criteria."""

    trajectory: Mapping[str, Signal] = declare(SIGNALS_BY_JOINT, unit="rad", doc="desired link positions")
    law: LawName = declare(
        Choice(("auto", "paper")),
        default="auto",
        doc="auto: norm-optimal, needs no tuning; paper: equation 13 with fixed gains",
    )
    gain: float = declare(POSITIVE, default=0.5, unit="1", doc="K of K exp(-n / gain_decay), the weight of the last error")
    gain_decay: float | None = declare(
        Either((Null("none"), POSITIVE)), default=10.0, unit="iterations", doc="decay of the gain; `none`: it is constant"
    )
    joint_gains: Mapping[str, float] = declare(
        MapOf(of=POSITIVE, star=False), default={}, unit="1", doc="gains that replace `gain`"
    )
    filter: Filter | None = declare(
        block_of(Filter, "zero-phase filter"), default=None, doc="zero-phase filter of the learned input", shown="none"
    )
    first_guess: FirstGuess | None = declare(
        Choice(("zero", "reference", "inverse_dynamics")),
        default=None,
        doc="first input: zero, the trajectory, or inverse dynamics through the springs",
        shown="inverse_dynamics for the law auto, else zero",
    )
    tolerance: float = declare(POSITIVE, unit="rad", doc="stop when the largest error of every joint is at most this value")
    max_iterations: int = declare(Integer(minimum=1, maximum=100_000), default=50, doc="largest number of iterations")
    patience: int = declare(
        Integer(minimum=1),
        default=3,
        doc="stop after this number of iterations in a row with a larger error or without progress",
    )
