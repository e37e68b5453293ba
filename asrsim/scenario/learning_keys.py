"""Keys of `ilc:`, iterative learning control, and the data that they become."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from asrsim.document.block import block_of, declare
from asrsim.document.composite import MapOf
from asrsim.document.kinds import NOT_NEGATIVE, POSITIVE, Choice, Integer, Kind, Optional, Schema
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading
from asrsim.errors import ScenarioError
from asrsim.scenario.kinds import SIGNALS_BY_JOINT, names_a_folder
from asrsim.signals.base import Signal

LawName = Literal["auto", "paper", "filtered"]
FirstGuess = Literal["zero", "reference", "inverse_dynamics"]
PresetChoice = Literal["given", "constant"]
KeepLogs = Literal["none", "last", "all"]
Distribution = Literal["uniform", "normal"]


class Gain(Kind["float | str"]):
    """A number, or `model`: chosen from the joint's linearised dynamics."""

    def read(self, node: Node, path: KeyPath, reading: Reading) -> float | str:
        if node.value == "model":
            return "model"
        if isinstance(node.value, str):
            raise reading.fault(node, path, "must be a number or model", choices=("model",), code="choice")
        return POSITIVE.read(node, path, reading)

    def schema(self) -> Schema:
        return {"anyOf": [POSITIVE.schema(), {"enum": ["model"]}]}

    @property
    def text(self) -> str:
        return "number > 0 or `model`"


@dataclass(frozen=True, kw_only=True)
class PlantSpread:
    """How far plants differ from the learned one."""

    parameters: Mapping[str, float] = declare(
        MapOf(of=NOT_NEGATIVE, noun="parameter", star=False), default={}, unit="1",
        doc="relative spread of actuator parameters, by name (0.1: a tenth)",
    )  # fmt: skip
    mass: float = declare(NOT_NEGATIVE, default=0.0, unit="1", doc="relative spread of the links' masses and inertias")
    damping: float = declare(NOT_NEGATIVE, default=0.0, unit="1", doc="relative spread of the joints' damping")
    friction: float = declare(NOT_NEGATIVE, default=0.0, unit="1", doc="relative spread of the joints' and motors' friction")
    added_friction: float = declare(
        NOT_NEGATIVE, default=0.0, unit="N m",
        doc="most that is added to the joints' friction, which a relative spread cannot give to one without",
    )  # fmt: skip
    added_damping: float = declare(NOT_NEGATIVE, default=0.0, unit="N m s/rad", doc="most that is added to the joints' damping")
    delay: float = declare(NOT_NEGATIVE, default=0.0, unit="s", doc="largest delay of the commands")


@dataclass(frozen=True, kw_only=True)
class PlantSet:
    """Plants that differ from the learned one, drawn at random."""

    draws: int = declare(Integer(minimum=1, maximum=100_000), default=50, doc="number of plants")
    seed: int = declare(Integer(minimum=0), default=0, doc="of the draws")
    distribution: Distribution = declare(
        Choice(("uniform", "normal")), default="uniform",
        doc="the spread is the half-width of a uniform, or the standard deviation of a normal distribution",
    )  # fmt: skip
    spread: PlantSpread = declare(block_of(PlantSpread, "spreads"), doc="what differs, by how much")


@dataclass(frozen=True, kw_only=True)
class Filter:
    """A zero-phase filter on what is learned."""

    cutoff: float = declare(POSITIVE, unit="Hz", doc="frequency above which nothing is learned")
    order: int = declare(Integer(minimum=1, maximum=8), default=2, doc="of the Butterworth filter")


@dataclass(frozen=True, kw_only=True)
class Learning:
    """What is to be learned, and how."""

    trajectory: Mapping[str, Signal] = declare(
        SIGNALS_BY_JOINT, default={}, unit="rad", shown="none", doc="desired link positions; this or `trajectories`"
    )
    trajectories: Mapping[str, Mapping[str, Signal]] = declare(
        MapOf(of=SIGNALS_BY_JOINT, noun="trajectory", star=False), default={}, unit="rad", shown="none",
        doc="several of them by name, each learned on its own",
    )  # fmt: skip
    law: LawName = declare(
        Choice(("auto", "paper", "filtered")), default="auto",
        doc="auto: norm-optimal, needs no tuning; paper: equation 13; filtered: equation 13 within the band in which "
        "errors shrink",
    )  # fmt: skip
    gain: float | str = declare(
        Gain(), default=0.5, unit="1",
        doc="K of K exp(-n / gain_decay), the weight of the last error; `model`: from the linearised joint",
    )  # fmt: skip
    gain_decay: float | None = declare(
        Optional(POSITIVE, word="none"), default=10.0, unit="iterations", doc="how fast the gain falls; `none`: it stays"
    )
    joint_gains: Mapping[str, float | str] = declare(
        MapOf(of=Gain(), star=False), default={}, unit="1", doc="gains that replace `gain`"
    )
    filter: Filter | None = declare(
        Optional(block_of(Filter, "zero-phase filter")), default=None, doc="zero-phase filter on what is learned",
        shown="law filtered, or gain model: safe by the model; else none",
    )  # fmt: skip
    first_guess: FirstGuess | None = declare(
        Optional(Choice(("zero", "reference", "inverse_dynamics"))), default=None,
        doc="first input: zero, the trajectory, or inverse dynamics through the springs",
        shown="law auto: inverse_dynamics; else zero",
    )  # fmt: skip
    presets: PresetChoice = declare(
        Choice(("given", "constant")), default="given",
        doc="second references: those of `references`, or the lowest that hold limits and tolerance, chosen beforehand",
    )  # fmt: skip
    tolerance: float = declare(POSITIVE, unit="rad", doc="stop when the largest error of every joint is within it")
    max_iterations: int = declare(Integer(minimum=1, maximum=100_000), default=50, doc="stop after so many")
    patience: int = declare(
        Integer(minimum=1), default=3,
        doc="stop when the error has grown, or there was no progress, for so many iterations in a row",
    )  # fmt: skip
    keep_logs: KeepLogs = declare(Choice(("none", "last", "all")), default="last", doc="whose iterations' logs are kept")
    transfer: PlantSet | None = declare(
        Optional(block_of(PlantSet, "set of plants")),
        default=None,
        doc="plants on which `asrsim ilc --transfer` tries the learned input",
        shown="none",
    )

    def __post_init__(self) -> None:
        if bool(self.trajectory) == bool(self.trajectories):
            message = "needs desired link positions under trajectory, or several of them by name under trajectories"
            raise ScenarioError(message, key="", code="no-trajectory")
        if bad := [name for name in self.trajectories if not names_a_folder(name)]:
            raise ScenarioError("is no name: it names a folder too", key=f"trajectories.{bad[0]}", code="name")


LEARNING = block_of(Learning, "learning")
