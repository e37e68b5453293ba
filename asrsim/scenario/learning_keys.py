"""Keys of `ilc:`, iterative learning control. The result is a plain mapping, consumed by :mod:`asrsim.learning`."""

from __future__ import annotations

from typing import Any

from asrsim.document.block import Block, Key
from asrsim.document.composite import MapOf
from asrsim.document.kinds import NOT_NEGATIVE, POSITIVE, SHARE, Choice, Integer, Kind, Optional, Schema
from asrsim.document.node import Node
from asrsim.document.reading import KeyPath, Reading
from asrsim.errors import ScenarioError
from asrsim.scenario.kinds import SIGNALS_BY_JOINT, Keys, names_a_folder


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


SPREAD: Block[Keys] = Block(
    keys=(
        Key(
            name="parameters", kind=MapOf(of=NOT_NEGATIVE, noun="parameter", star=False), default={}, unit="1",
            doc="relative spread of actuator parameters, by name (0.1: a tenth)",
        ),
        Key(name="mass", kind=NOT_NEGATIVE, default=0.0, unit="1", doc="relative spread of the links' masses and inertias"),
        Key(name="damping", kind=NOT_NEGATIVE, default=0.0, unit="1", doc="relative spread of the joints' damping"),
        Key(
            name="friction", kind=NOT_NEGATIVE, default=0.0, unit="1",
            doc="relative spread of the joints' and motors' friction",
        ),
        Key(
            name="added_friction", kind=NOT_NEGATIVE, default=0.0, unit="N m",
            doc="most that is added to the joints' friction, which a relative spread cannot give to one without",
        ),
        Key(
            name="added_damping", kind=NOT_NEGATIVE, default=0.0, unit="N m s/rad",
            doc="most that is added to the joints' damping",
        ),
        Key(name="delay", kind=NOT_NEGATIVE, default=0.0, unit="s", doc="largest delay of the commands"),
    ),
    build=dict,
    noun="spreads",
)  # fmt: skip

PLANTS: Block[Keys] = Block(
    keys=(
        Key(name="draws", kind=Integer(minimum=1, maximum=100_000), default=50, doc="number of plants"),
        Key(name="seed", kind=Integer(minimum=0), default=0, doc="of the draws"),
        Key(
            name="distribution", kind=Choice(("uniform", "normal")), default="uniform",
            doc="the spread is the half-width of a uniform, or the standard deviation of a normal distribution",
        ),
        Key(name="spread", kind=SPREAD, doc="what differs, by how much"),
    ),
    build=dict,
    noun="set of plants",
)  # fmt: skip

FILTER: Block[Keys] = Block(
    keys=(
        Key(name="cutoff", kind=POSITIVE, unit="Hz", doc="frequency above which nothing is learned"),
        Key(name="order", kind=Integer(minimum=1, maximum=8), default=2, doc="of the Butterworth filter"),
    ),
    build=dict,
    noun="zero-phase filter",
)


def _learning(**keys: Any) -> Keys:
    if bool(keys["trajectory"]) == bool(keys["trajectories"]):
        message = "needs desired link positions under trajectory, or several of them by name under trajectories"
        raise ScenarioError(message, key="", code="no-trajectory")
    if bad := [name for name in keys["trajectories"] if not names_a_folder(name)]:
        raise ScenarioError("is no name: it names a folder too", key=f"trajectories.{bad[0]}", code="name")
    return keys


LEARNING: Block[Keys] = Block(
    keys=(
        Key(
            name="trajectory", kind=SIGNALS_BY_JOINT, default={}, unit="rad", shown="none",
            doc="desired link positions; this or `trajectories`",
        ),
        Key(
            name="trajectories", kind=MapOf(of=SIGNALS_BY_JOINT, noun="trajectory", star=False), default={}, unit="rad",
            doc="several of them by name, each learned on its own", shown="none",
        ),
        Key(
            name="law", kind=Choice(("auto", "paper", "filtered")), default="auto",
            doc="auto: norm-optimal, needs no tuning; paper: equation 13; filtered: equation 13 within the band in which "
            "errors shrink",
        ),
        Key(
            name="gain", kind=Gain(), default=0.5, unit="1",
            doc="K of K exp(-n / gain_decay), the weight of the last error; `model`: from the linearised joint",
        ),
        Key(
            name="gain_decay", kind=Optional(POSITIVE, word="none"), default=10.0, unit="iterations",
            doc="how fast the gain falls; `none`: it stays",
        ),
        Key(name="joint_gains", kind=MapOf(of=Gain(), star=False), default={}, unit="1", doc="gains that replace `gain`"),
        Key(name="derivative", kind=NOT_NEGATIVE, default=0.0, unit="s", doc="weight of the error's rate, times the gain"),
        Key(
            name="filter", kind=Optional(FILTER), default=None, doc="zero-phase filter on what is learned",
            shown="law filtered, or gain model: safe by the model; else none",
        ),
        Key(name="forgetting", kind=SHARE, default=0.0, unit="1", doc="share of the learned input that each iteration forgets"),
        Key(
            name="first_guess", kind=Optional(Choice(("zero", "reference", "gravity", "inverse_dynamics"))), default=None,
            doc="first input: zero, the trajectory, the trajectory plus the springs' deflection under gravity, or inverse "
            "dynamics through the springs", shown="law auto: inverse_dynamics; else zero",
        ),
        Key(
            name="presets", kind=Choice(("given", "constant", "over_time")), default="given",
            doc="second references: those of `references`, or the lowest that hold limits and tolerance, chosen beforehand",
        ),
        Key(name="tolerance", kind=POSITIVE, unit="rad", doc="stop when the largest error of every joint is within it"),
        Key(name="max_iterations", kind=Integer(minimum=1, maximum=100_000), default=50, doc="stop after so many"),
        Key(
            name="patience", kind=Integer(minimum=1), default=3,
            doc="stop when the error has grown, or there was no progress, for so many iterations in a row",
        ),
        Key(
            name="keep_logs", kind=Choice(("none", "last", "all")), default="last",
            doc="whose iterations' logs are kept",
        ),
        Key(name="plants", kind=Optional(PLANTS), default=None, doc="learn over several plants at once", shown="one plant"),
        Key(
            name="transfer", kind=Optional(PLANTS), default=None,
            doc="plants on which `asrsim ilc --transfer` tries the learned input", shown="none",
        ),
    ),
    build=_learning,
    noun="learning",
)  # fmt: skip
