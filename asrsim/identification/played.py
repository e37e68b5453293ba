"""Recorded commands as the simulation takes them: smooth in time and in a delay, but for a few large jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from asrsim.identification.data import Command
from asrsim.identification.noise import fine_noise
from asrsim.samples import Array
from asrsim.signals.base import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class Played(Signal):
    """A recorded command: its mean over each step, so that results are smooth in a delay, but for a few large jumps.

    These are cut out of the means, and the loop splits its steps at them: a motor at its torque limit does not see a mean.
    """

    kind: ClassVar[str] = "played"

    command: Command
    step: float
    """s over which means are taken."""
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0

    def values(self, time: Array) -> Array:
        """gain (recorded - offset), `delay` s later."""
        at = time - self.delay
        curve = self.command.curve
        ends = curve.integral(np.stack([at - 0.5 * self.step, at + 0.5 * self.step]))
        means = (ends[1] - ends[0]) / self.step
        for jump, size in zip(curve.jumps, curve.sizes, strict=True):
            # A mean over a jump takes the value on its own side.
            near = np.abs(at - jump) < 0.5 * self.step
            share = (at[near] - jump) / self.step + 0.5
            means[near] += size * np.where(at[near] >= jump - 1e-9, 1.0 - share, -share)
        return np.asarray(self.gain * (means - self.offset), dtype=np.float64)

    def jumps(self, start: float, end: float) -> Array:
        """Times of large jumps."""
        times = self.command.curve.jumps + self.delay
        return np.asarray(times[(times >= start) & (times <= end)])


def noise_of_command(command: Command) -> float:
    """Deviation of a recorded command's noise."""
    return fine_noise(command.values) if not command.hold and len(command.values) > 8 else 0.0


def drawn(commands: Sequence[Command], draw: int | None) -> Sequence[Command]:
    """Commands with a draw of their noise added; None: as they are."""
    if draw is None:
        return commands
    generator = np.random.default_rng(draw)
    return [
        replace(one, values=one.values + noise_of_command(one) * generator.normal(size=len(one.values))) for one in commands
    ]
