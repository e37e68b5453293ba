"""Result of a fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from asrsim.identification.combinations import Combination
from asrsim.identification.judge import ChannelFit
from asrsim.identification.layout import Layout
from asrsim.identification.task import Task
from asrsim.identification.verdicts import Estimate
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

ACCEPTABLE = 0.9
"""Explained fraction of every channel's variance above which a model that does not fit may be accepted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """Result of a fit."""

    task: Task
    estimates: tuple[Estimate, ...]
    combinations: tuple[Combination, ...]
    covariance: Array
    """Covariance of the parameter vector."""
    channels: tuple[ChannelFit, ...]
    misfit: tuple[str, ...]
    """Reasons why the model does not fit; empty if the model fits."""
    causes: tuple[str, ...]
    """Effects that the model may lack."""
    remarks: tuple[str, ...]
    evaluations: int
    seconds: float
    how: str
    attempts: int
    successes: int
    status: str
    """Status of the fit: complete, unfinished (time limit reached), interrupted or checked."""
    x: Array
    layout: Layout = field(repr=False)
    ends: tuple[float, ...]
    """End of each recording's training part, s."""
    scenario: Scenario = field(repr=False)
    robot: Robot = field(repr=False)
    whole: bool = False
    """Whether the estimates are from whole recordings, including the held-out parts."""
    accepted: bool = False
    """Whether a model that does not fit was accepted. Intervals then show the spread between estimates from tenths of the
    recording.
    """
    played: Mapping[str, str] = field(default_factory=dict)
    """Interpolation between samples, by column of a command; values are those of `interpolation:` of a playback."""

    @property
    def correlation(self) -> Array:
        """Correlation matrix (n, n) of the estimates; 0 for entries without variance."""
        deviation = np.sqrt(np.diag(self.covariance))
        deviation[deviation == 0.0] = np.inf
        return np.asarray(self.covariance / np.outer(deviation, deviation))

    @property
    def fits(self) -> bool:
        """Whether the model explains the recordings within the noise."""
        return not self.misfit

    @property
    def explained(self) -> float:
        """Smallest explained fraction of a channel's variance."""
        return min((one.explained for one in self.channels if not math.isnan(one.explained)), default=0.0)

    def find(self, key: str) -> Estimate:
        """Estimate of the parameter with a key; if each recording has a separate value, the estimate for the first recording.
        Raises KeyError.
        """
        for one in self.estimates:
            if key in (one.key, one.name):
                return one
        raise KeyError(key)

    def values(self) -> dict[str, float]:
        """Estimates by key: shared parameters, parameters of the first recording, and tied parameters."""
        return self.layout.table(self.x, 0)
