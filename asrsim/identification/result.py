"""What a fit gives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from asrsim.identification.combinations import Combination
from asrsim.identification.judge import ChannelFit
from asrsim.identification.layout import Layout
from asrsim.identification.task import Task
from asrsim.identification.verdicts import Estimate
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

ACCEPTABLE = 0.9
"""Share of the variance of every channel that a model explains which may be accepted though it does not fit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """What a fit gives."""

    task: Task
    estimates: tuple[Estimate, ...]
    combinations: tuple[Combination, ...]
    correlation: Array
    covariance: Array
    """Of the vector."""
    channels: tuple[ChannelFit, ...]
    misfit: tuple[str, ...]
    """Why the model does not fit; empty where it does."""
    causes: tuple[str, ...]
    """What may be missing."""
    remarks: tuple[str, ...]
    evaluations: int
    seconds: float
    how: str
    attempts: int
    successes: int
    status: str
    """complete, unfinished (its time was over), interrupted or checked."""
    x: Array
    layout: Layout = field(repr=False)
    ends: tuple[float, ...]
    """s, end of each recording's training part."""
    series: tuple[tuple[Mapping[str, Any], ...], ...] = field(repr=False)
    """By recording and channel: time, recorded, before, after."""
    scenario: Scenario = field(repr=False)
    robot: Robot = field(repr=False)
    whole: bool = False
    """Whether the estimates are from whole recordings, the part too that had been held out."""
    accepted: bool = False
    """Whether intervals are as wide as estimates from a tenth of the recording differ, since the model does not fit."""
    played: Mapping[str, str] = field(default_factory=dict)
    """Column of a command -> what it was between its samples, as `interpolation:` of a playback says it."""

    @property
    def fits(self) -> bool:
        """Whether the model explains what was recorded, as far as the noise lets see."""
        return not self.misfit

    @property
    def explained(self) -> float:
        """Share of the variance of every channel that the model explains, at least."""
        return min((one.explained for one in self.channels if not math.isnan(one.explained)), default=0.0)

    def find(self, key: str) -> Estimate:
        """The estimate of a key (its first, where each recording has its own); KeyError."""
        for one in self.estimates:
            if key in (one.key, one.name):
                return one
        raise KeyError(key)

    def values(self) -> dict[str, float]:
        """Key -> estimate of what all recordings share, ties followed."""
        return self.layout.table(self.x, 0)
