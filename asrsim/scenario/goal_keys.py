"""Keys of goals: Cartesian task, iterative learning control, and claims about a run; with their data classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

from asrsim.document.block import block_of, declare
from asrsim.document.composite import ListOf, MapOf
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    Boolean,
    Choice,
    File,
    Integer,
    Kind,
    Optional,
    Schema,
    Text,
)
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath
from asrsim.errors import ScenarioError
from asrsim.scenario.kinds import ORIGIN, POSITION, RPY, SIGNALS_BY_JOINT, Vector, engines
from asrsim.signals.base import Signal

JOINT = Text(noun="name of a joint")
LINK = Text(noun="name of a link")


@dataclass(frozen=True, kw_only=True)
class CartesianPose:
    """Waypoint of a Cartesian task."""

    time: float = declare(NOT_NEGATIVE, unit="s", doc="time at which the pose is reached")
    position: Vector = declare(POSITION, unit="m", doc="position in the world's frame")
    rpy: Vector | None = declare(Optional(RPY), default=None, unit="rad", doc="orientation", shown="free")


@dataclass(frozen=True, kw_only=True)
class CartesianTask:
    """Path of a point on a link, from which closed-loop inverse kinematics computes equilibrium references."""

    link: str = declare(LINK, doc="the link that moves along the path")
    poses: tuple[CartesianPose, ...] = declare(
        ListOf(of=block_of(CartesianPose, "pose"), minimum=1), doc="the path, in ascending time"
    )
    point: Vector = declare(POSITION, default=ORIGIN, unit="m", doc="the point on the path, in the link's frame")
    joints: tuple[str, ...] = declare(
        ListOf(of=JOINT), default=(), doc="joints that move",
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
        Choice(("auto", "paper")), default="auto",
        doc="auto: norm-optimal, needs no tuning; paper: equation 13 with fixed gains",
    )  # fmt: skip
    gain: float = declare(POSITIVE, default=0.5, unit="1", doc="K of K exp(-n / gain_decay), the weight of the last error")
    gain_decay: float | None = declare(
        Optional(POSITIVE, word="none"), default=10.0, unit="iterations", doc="decay of the gain; `none`: it is constant"
    )
    joint_gains: Mapping[str, float] = declare(
        MapOf(of=POSITIVE, star=False), default={}, unit="1", doc="gains that replace `gain`"
    )
    filter: Filter | None = declare(
        Optional(block_of(Filter, "zero-phase filter")), default=None, doc="zero-phase filter on what is learned", shown="none"
    )
    first_guess: FirstGuess | None = declare(
        Optional(Choice(("zero", "reference", "inverse_dynamics"))), default=None,
        doc="first input: zero, the trajectory, or inverse dynamics through the springs",
        shown="law auto: inverse_dynamics; else zero",
    )  # fmt: skip
    tolerance: float = declare(POSITIVE, unit="rad", doc="stop when the largest error of every joint is within it")
    max_iterations: int = declare(Integer(minimum=1, maximum=100_000), default=50, doc="stop after so many")
    patience: int = declare(
        Integer(minimum=1), default=3,
        doc="stop when the error has grown, or there was no progress, for so many iterations in a row",
    )  # fmt: skip


LEARNING = block_of(Learning, "learning")

COMPARISONS = ("==", "<", "<=", ">", ">=")


class AnyData(Kind[Any]):
    """Kind of value: plain data that another module validates."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Any:
        return node.plain()

    def schema(self) -> Schema:
        return {}

    @property
    def text(self) -> str:
        return "anything"


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Claim about a run: a comparison of a measure of a joint's quantity with a value."""

    joint: str | None = declare(Optional(JOINT), default=None, doc="the joint (or give `body`)")
    body: str | None = declare(Optional(Text(noun="name of an object")), default=None, doc="an object of the world")
    quantity: str = declare(Text(noun="name of a quantity"), doc="the quantity, such as link_position")
    measure: str = declare(Text(noun="name of a measure"), doc="the measure, such as steady_state, overshoot, maximum, rmse")
    comparison: str = declare(Choice(COMPARISONS), default="==", doc="the comparison; `==` within the tolerance")
    value: float = declare(NUMBER, unit="measure's", doc="the number to compare with")
    tolerance: float = declare(NOT_NEGATIVE, default=0.0, unit="measure's", doc="largest difference under `==`")
    variant: str | None = declare(
        Optional(Text(noun="name of a variant")), default=None, doc="the variant of the claim", shown="all"
    )
    engine: str | None = declare(
        Optional(Choice(engines)),
        default=None,
        doc="the engine of the claim, as engines differ in accuracy",
        shown="all",
    )
    reference: str | None = declare(
        Optional(Text(noun="name of a quantity")), default=None, shown="the joint's own",
        doc="another quantity of the same joint to compare with, for measures of two series",
    )  # fmt: skip
    against: Path | None = declare(
        Optional(File(noun="recording", folder=True, beside=".yaml")), default=None,
        doc="a recording to compare with, for measures of a difference",
    )  # fmt: skip
    options: Mapping[str, Any] = declare(MapOf(of=AnyData(), noun="option", star=False), default={}, doc="of the measure")
    line: int | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        from asrsim.quantities import DERIVED, QUANTITIES

        if (self.joint is None) == (self.body is None):
            raise ScenarioError("needs the key joint or body", key="", code="expect")
        known = (*QUANTITIES, *DERIVED)
        for key, name in (("quantity", self.quantity), ("reference", self.reference)):
            if self.joint is not None and name is not None and name not in known:
                raise ScenarioError("no such quantity", key=key, choices=known, meant=name, code="unknown-quantity")
        if self.reference is not None and (self.body is not None or self.against is not None):
            raise ScenarioError("needs the key joint, and excludes the key `against`", key="reference", code="expect")


CLAIMS = ListOf(of=block_of(Expectation, "claim", line_argument="line"))
