"""Keys of a scenario about joints: actuators, imperfections, damping, initial state."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from asrsim.actuators import ACTUATORS, MODES
from asrsim.document.block import Block, block_of, declare
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    Choice,
    Either,
    Entry,
    Integer,
    Key,
    ListOf,
    MapOf,
    Number,
    Schema,
)
from asrsim.document.node import Node
from asrsim.document.reading import DocumentReading, KeyPath
from asrsim.scenario.kinds import Keys

MODE = Integer(minimum=0, maximum=max(MODES))
_INFINITE = ("inf", "+inf", "-inf", math.inf, -math.inf)


class ParameterNumber(Number):
    """Kind of value: a number, which may be infinite, such as the limit of a torque without limit."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> float:
        return float(str(node.value)) if node.value in _INFINITE else super().read(node, path, reading)

    def schema(self) -> Schema:
        return {"anyOf": [super().schema(), {"enum": list(_INFINITE[:3])}]}


PARAMETERS = MapOf(of=ParameterNumber(), noun="parameter", star=False)


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """Imperfections between a controller and the joint; all off by default."""

    delay: float = declare(NOT_NEGATIVE, default=0.0, unit="s", doc="dead time")
    rate: float | None = declare(
        Number(above=0.0, maximum=1e6),
        default=None,
        unit="Hz",
        doc="values are held between ticks of this rate",
        shown="continuous",
    )
    quantum: float = declare(NOT_NEGATIVE, default=0.0, unit="signal's", doc="step of quantisation")
    noise: float = declare(
        NOT_NEGATIVE,
        default=0.0,
        unit="signal's",
        doc="standard deviation of Gaussian noise; a new value is drawn at each tick (or step), from the scenario's seed",
    )

    @property
    def active(self) -> bool:
        """Whether any imperfection is set."""
        return bool(self.delay or self.rate or self.quantum or self.noise)


@dataclass(frozen=True, kw_only=True)
class LinkDamping:
    """Link damping as a function of the stiffness: c(k) = constant + ratio * 2 sqrt(inertia * k), off by default."""

    constant: float = declare(NOT_NEGATIVE, default=0.0, unit="N m s/rad", doc="damping in addition to the damping in the URDF")
    ratio: float = declare(NOT_NEGATIVE, default=0.0, unit="1", doc="damping ratio at `inertia` and the present stiffness")
    inertia: float = declare(NOT_NEGATIVE, default=0.0, unit="kg m^2", doc="inertia for which `ratio` is defined")


@dataclass(frozen=True, kw_only=True)
class GivenActuator:
    """Actuator that the scenario puts on a joint, in place of the actuator in the robot file, if any."""

    type: str = declare(
        Entry(ACTUATORS, "name of an actuator"),
        doc="the actuator's type; `asrsim actuators` lists all types",
    )
    mode: int = declare(MODE, default=6, doc="operation mode")
    parameters: Mapping[str, float] = declare(
        PARAMETERS, default={}, doc="by name, or by tag of the toolbox; other parameters keep their defaults"
    )


IMPERFECTIONS_BY_JOINT = MapOf(of=block_of(Imperfections, "imperfections"))


class RangeOf(ListOf[float]):
    """Kind of value: two numbers, the smaller one first."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> tuple[float, ...]:
        found = super().read(node, path, reading)
        if found[0] > found[1]:
            raise reading.fault(node, path, "the first value must not exceed the second", code="range")
        return found


_MOTORS = ListOf(of=NUMBER, minimum=1)
START: Block[Keys] = Block(
    keys=(
        Key(name="position", kind=NUMBER, default=None, unit="rad", doc="position of the link", shown="0"),
        Key(name="velocity", kind=NUMBER, default=None, unit="rad/s", doc="velocity of the link", shown="0"),
        Key(
            name="motor_positions",
            kind=_MOTORS,
            default=None,
            unit="rad",
            doc="positions of the motors, on the link side of their gears",
            shown="position of the link, so that springs are undeflected",
        ),
        Key(
            name="motor_velocities",
            kind=_MOTORS,
            default=None,
            unit="rad/s",
            doc="velocities of the motors, on the link side of their gears",
            shown="at rest",
        ),
    ),
    build=dict,
    noun="state",
    main="position",
)
EQUILIBRIUM = "equilibrium"


class StartTables(Either):
    """Kind of value: the initial state of the joints, which is read into four mappings and a flag of the scenario."""

    def read(self, node: Node, path: KeyPath, reading: DocumentReading) -> Mapping[str, Any]:
        states = super().read(node, path, reading)
        if states == EQUILIBRIUM:
            return {"initial_equilibrium": True}
        names = {"position": "positions", "velocity": "velocities"}
        tables: dict[str, dict[str, Any]] = {f"initial_{names.get(name, name)}": {} for name in START.names}
        for joint, state in states.items():
            for value, table in zip(state.values(), tables.values(), strict=True):
                if value is not None:
                    table[joint] = value
        return tables


_AT_REST = Choice((EQUILIBRIUM,), missing="A mapping from joint to state is also valid")
INITIAL = StartTables((_AT_REST, MapOf(of=START)))
