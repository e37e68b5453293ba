"""Keys of a claim about a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from asrsim.document.block import declare
from asrsim.document.kinds import (
    NOT_NEGATIVE,
    NUMBER,
    Choice,
    Entry,
    File,
    MapOf,
    Text,
)
from asrsim.errors import ScenarioError
from asrsim.quantities import DERIVED, QUANTITIES
from asrsim.registry.engines import ENGINES
from asrsim.scenario.kinds import JOINT, AnyData

COMPARISONS = ("==", "<", "<=", ">", ">=")


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Claim about a run: a comparison of a measure of a joint's quantity with a value."""

    joint: str | None = declare(JOINT, default=None, doc="the joint, unless the claim is about a `body`")
    body: str | None = declare(Text(text="name of an object"), default=None, doc="an object of the world")
    quantity: str = declare(Text(text="name of a quantity"), doc="the quantity, such as link_position")
    measure: str = declare(Text(text="name of a measure"), doc="the measure, such as steady_state, overshoot, maximum, rmse")
    comparison: str = declare(Choice(COMPARISONS), default="==", doc="the comparison; `==` within the tolerance")
    value: float = declare(NUMBER, unit="measure's", doc="the number to compare with")
    tolerance: float = declare(NOT_NEGATIVE, default=0.0, unit="measure's", doc="largest difference under `==`")
    variant: str | None = declare(Text(text="name of a variant"), default=None, doc="the variant of the claim", shown="all")
    engine: str | None = declare(
        Entry(ENGINES),
        default=None,
        doc="the engine of the claim, since engines differ in accuracy",
        shown="all",
    )
    reference: str | None = declare(
        Text(text="name of a quantity"),
        default=None,
        shown="the reference of the joint's position",
        doc="another quantity of the same joint to compare with, for measures of two series",
    )
    against: Path | None = declare(
        File(noun="recording", folder=True, beside=".yaml"),
        default=None,
        doc="a recording to compare with, for measures of a difference",
    )
    options: Mapping[str, Any] = declare(
        MapOf(of=AnyData(), noun="option", star=False), default={}, doc="options of the measure"
    )
    line: int | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if (self.joint is None) == (self.body is None):
            raise ScenarioError("needs the key joint or body", key="", code="expect")
        known = (*QUANTITIES, *DERIVED)
        for key, name in (("quantity", self.quantity), ("reference", self.reference)):
            if self.joint is not None and name is not None and name not in known:
                raise ScenarioError("no such quantity", key=key, choices=known, meant=name, code="unknown-quantity")
        if self.reference is not None and (self.body is not None or self.against is not None):
            raise ScenarioError(
                "requires the key `joint`, and is not allowed with the key `against`", key="reference", code="expect"
            )
