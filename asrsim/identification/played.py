"""Recorded commands as inputs of the simulation: averaged so that simulated motions depend smoothly on time and delay, except
at a few large jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from asrsim.identification.data import PlayedCommand
from asrsim.identification.noise import fine_noise
from asrsim.samples import Array
from asrsim.signals.base import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class Played(Signal):
    """A recorded command, averaged over each step, so that results depend smoothly on its delay.

    Large jumps are not averaged; the simulation splits its steps there, since a motor at its torque limit responds nonlinearly.
    """

    kind: ClassVar[str] = "played"

    command: PlayedCommand
    step: float
    """Duration of the averaging window, s."""
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    _known: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)

    def values(self, time: Array) -> Array:
        """Values gain * (recorded - offset), delayed by `delay` s; cached, since simulations ask for the same times."""
        key = time.tobytes()
        if key not in self._known:
            self._known[key] = self._means(time - self.delay)
        return self._known[key].copy()

    def _means(self, at: Array) -> Array:
        curve = self.command.curve
        ends = curve.integral(np.stack([at - 0.5 * self.step, at + 0.5 * self.step]))
        means = (ends[1] - ends[0]) / self.step
        for jump, size in zip(curve.jumps, curve.sizes, strict=True):
            # Near a jump, average only the samples on the same side of the jump.
            near = np.abs(at - jump) < 0.5 * self.step
            share = (at[near] - jump) / self.step + 0.5
            means[near] += size * np.where(at[near] >= jump - 1e-9, 1.0 - share, -share)
        values = self.command.scale * self.gain * (means - self.offset)
        guide = self.command.guide
        return np.asarray(values if guide is None else values + guide.values(at + self.delay), dtype=np.float64)

    def jumps(self, start: float, end: float) -> Array:
        """Times of large jumps."""
        times = self.command.curve.jumps + self.delay
        return np.asarray(times[(times >= start) & (times <= end)])


def noise_of_command(command: PlayedCommand) -> float:
    """Standard deviation of a recorded command's noise; 0 if it is negligible."""
    noise = fine_noise(command.values) if not command.hold and len(command.values) > 8 else 0.0
    return noise if noise > 2e-6 * np.ptp(command.values) else 0.0


def drawn(commands: Sequence[PlayedCommand], draw: int | None) -> Sequence[PlayedCommand]:
    """Commands plus a random draw of their noise; draw: seed of the random numbers, None for unchanged commands."""
    if draw is None:
        return commands
    generator = np.random.default_rng(draw)
    return [
        replace(one, values=one.values + noise_of_command(one) * generator.normal(size=len(one.values))) for one in commands
    ]
