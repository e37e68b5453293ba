"""Keys of a Cartesian task and of claims about the run."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

from asrsim.document.block import Block, Key
from asrsim.document.composite import Either, ListOf, MapOf, is_mapping, is_scalar
from asrsim.document.kinds import Boolean, Choice, File, Kind, Number, Optional, Schema, Text, attempt
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading, Rejected
from asrsim.errors import Problem, ScenarioError
from asrsim.scenario.data import CartesianPose, CartesianTask, Expectation
from asrsim.scenario.kinds import NOT_NEGATIVE, NUMBER, ORIGIN, POSITION, POSITIVE, RPY
from asrsim.signals.parse import SIGNAL

POSE = Block(
    keys=(
        Key(name="time", kind=NOT_NEGATIVE, unit="s", doc="when it is reached"),
        Key(name="position", kind=POSITION, unit="m", doc="in the world's frame"),
        Key(name="rpy", kind=Optional(RPY), default=None, unit="rad", doc="orientation", shown="free"),
    ),
    build=CartesianPose,
    noun="pose",
)


def _task(preset: float | dict[str, float], **arguments: Any) -> CartesianTask:
    times = [pose.time for pose in arguments["poses"]]
    for before, after in pairwise(times):
        if after <= before:
            message = f"times must ascend, but {after:g} follows {before:g}"
            raise ScenarioError(Problem(message=message, key="poses", code="order"))
    presets = {"*": preset} if isinstance(preset, float) else preset
    return CartesianTask(preset=presets, **arguments)


TASK = Block(
    keys=(
        Key(name="link", kind=Text(noun="name of a link"), doc="the link that moves along the path"),
        Key(name="poses", kind=ListOf(of=POSE, minimum=1), doc="the path, in ascending time"),
        Key(name="point", kind=POSITION, default=ORIGIN, unit="m", doc="the point on the path, in the link's frame"),
        Key(
            name="joints", kind=ListOf(of=Text(noun="name of a joint")), default=(),
            doc="joints that move", shown="all actuated ones between base and link",
        ),
        Key(name="gain", kind=POSITIVE, default=10.0, unit="1/s", doc="of the closed loop"),
        Key(name="damping", kind=POSITIVE, default=1e-3, unit="m", doc="of the damped least squares"),
        Key(
            name="interpolation", kind=Choice(("minimum_jerk", "linear")), default="minimum_jerk", doc="between the poses",
        ),
        Key(
            name="gravity_compensation", kind=Boolean(), default=False,
            doc="add the springs' deflection under gravity to the equilibrium",
        ),
        Key(
            name="motor_droop", kind=Boolean(), default=False,
            doc="compensate the motors' steady-state error under load too",
        ),
        Key(
            name="preset", kind=Either(((is_mapping, MapOf(of=NUMBER)), (is_scalar, NUMBER))), default={}, unit="rad",
            doc="stiffness preset of the joints, where `references` give none",
        ),
        Key(
            name="tolerance", kind=POSITIVE, default=1e-3, unit="m",
            doc="by which the path may be missed before it counts as unreachable",
        ),
    ),
    build=_task,
    noun="Cartesian task",
)  # fmt: skip

INVERSE_DYNAMICS = "inverse_dynamics"
"""Word under a joint's references that makes its first one a desired motion of the link."""


class JointReferences(Kind[dict[str, Any]]):
    """Signals by name, and whether the first is a desired motion: a :class:`bool` under :data:`INVERSE_DYNAMICS`."""

    _signals = MapOf(of=SIGNAL, noun="reference", star=False)

    def read(self, node: Node, path: KeyPath, reading: Reading) -> dict[str, Any]:
        if not isinstance(node.value, dict) or INVERSE_DYNAMICS not in node.value:
            return dict(self._signals.read(node, path, reading))
        rest = {name: item for name, item in node.value.items() if name != INVERSE_DYNAMICS}
        wanted = attempt(Boolean(), node.value[INVERSE_DYNAMICS], (*path, INVERSE_DYNAMICS), reading)
        signals = self._signals.read(Node(rest, node.line, node.key_lines, node.file), path, reading)
        if wanted is None:
            raise Rejected
        return {**signals, INVERSE_DYNAMICS: wanted[0]}

    def schema(self) -> Schema:
        return {**self._signals.schema(), "properties": {INVERSE_DYNAMICS: Boolean().schema()}}

    @property
    def text(self) -> str:
        return self._signals.text

    def merge(self, base: Node, over: Node) -> Node:
        return self._signals.merge(base, over)


COMPARISONS = ("==", "<", "<=", ">", ">=")


class AnyData(Kind[Any]):
    """Plain data that another module validates."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> Any:
        return node.plain()

    def schema(self) -> Schema:
        return {}

    @property
    def text(self) -> str:
        return "anything"


class ComparedFile(File):
    """A recording to compare with; what its columns mean may stand in a file beside it, which is needed too."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> Path:
        from asrsim.recordings.mapping import find_mapping

        place = super().read(node, path, reading)
        if (mapping := find_mapping(place)) is not None:
            reading.attachments[f"{reading.renamed[id(node)]}.yaml"] = mapping
        return place


def _expectation(**arguments: Any) -> Expectation:
    if (arguments["joint"] is None) == (arguments["body"] is None):
        raise ScenarioError(Problem(message="needs the key joint, or body", key="", code="expect"))
    if arguments["joint"] is not None:
        from asrsim.errors import did_you_mean
        from asrsim.quantities import DERIVED, QUANTITIES

        known = (*QUANTITIES, *DERIVED)
        if arguments["quantity"] not in known:
            hint = did_you_mean(arguments["quantity"], known)
            raise ScenarioError(
                Problem(message="no such quantity", key="quantity", choices=known, hint=hint, code="unknown-quantity")
            )
    return Expectation(**arguments)


EXPECTATION = Block(
    keys=(
        Key(name="joint", kind=Optional(Text(noun="name of a joint")), default=None, doc="the joint; this or `body`"),
        Key(name="body", kind=Optional(Text(noun="name of an object")), default=None, doc="an object of the world"),
        Key(name="quantity", kind=Text(noun="name of a quantity"), doc="what is measured, such as link_position"),
        Key(name="measure", kind=Text(noun="name of a measure"), doc="how, such as steady_state, overshoot, maximum, rmse"),
        Key(name="comparison", kind=Choice(COMPARISONS), default="==", doc="how it compares; `==` within the tolerance"),
        Key(name="value", kind=NUMBER, unit="measure's", doc="the number to compare with"),
        Key(name="tolerance", kind=Number(minimum=0.0), default=0.0, unit="measure's", doc="how far it may be off"),
        Key(
            name="variant", kind=Optional(Text(noun="name of a variant")), default=None,
            doc="the variant of which it is claimed", shown="all",
        ),
        Key(
            name="against", kind=Optional(ComparedFile(noun="recording", folder=True)), default=None,
            doc="a recording to compare with, for measures of a difference",
        ),
        Key(name="options", kind=MapOf(of=AnyData(), noun="option", star=False), default={}, doc="of the measure"),
    ),
    build=_expectation,
    noun="claim",
    line_argument="line",
)  # fmt: skip
