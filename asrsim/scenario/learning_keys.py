"""Keys of `ilc`, iterative learning control, and their data classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from asrsim.document.block import block_of, declare
from asrsim.document.composite import MapOf
from asrsim.document.kinds import POSITIVE, Choice, Integer, Optional
from asrsim.scenario.kinds import SIGNALS_BY_JOINT
from asrsim.signals.base import Signal

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
