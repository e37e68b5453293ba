"""Sensors of the controllers: positions with delay, hold, noise and quantisation; velocities with delay and hold.

The PID controllers of the motors (modes 5, 6) or of the link (mode 1) use the measurements instead of the true values. The laws
of the actuators are unchanged: a position error acts like the opposite error of the reference, a velocity error like a torque.
Sensors are off by default.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array
from asrsim.scenario.data import Effects
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.effects import Noise


@dataclass(frozen=True)
class Sensor:
    """The encoders of a joint's controllers."""

    effects: Effects
    delay: int
    """Delay in substeps."""
    on_link: bool
    """Whether the encoders measure the position of the link (mode 1) instead of the motors."""
    noises: tuple[Noise | None, ...]
    """Noise of each encoder."""

    @property
    def count(self) -> int:
        """Number of encoders."""
        return len(self.noises)

    def fill(self, table: Array, first: int, substep: float) -> None:
        """Fill `table` (n, 2 count): whether each encoder takes a sample, and its noise, at the substeps from `first` on."""
        every = 1.0 / (self.effects.rate * substep) if self.effects.rate else 1.0
        # A tick at the time of a substep belongs to this substep, even if rounding makes the tick slightly later.
        ticks = np.floor(np.arange(first - 1, first + len(table)) / every + 1e-6)
        samples_now = np.diff(ticks) > 0.0
        if first == 0:
            samples_now[0] = True
        for index, noise in enumerate(self.noises):
            table[:, 2 * index] = samples_now
            if noise is not None:
                table[:, 2 * index + 1] = noise.draw(ticks[1:])


def sensor_of(drive: SteppedJoint, effects: Effects | None, *, substep: float, index: int, seed: int) -> Sensor | None:
    """Sensors of joint number `index`; None if the joint has no controllers or they use the true values."""
    if effects is None or not effects.active or drive.mode is None or not drive.mode.controller:
        return None
    count = max(drive.dynamic_motors, 1)
    noises = tuple(Noise((seed, index, 2 + i), effects.noise) if effects.noise else None for i in range(count))
    return Sensor(effects, round(effects.delay / substep), not drive.mode.motor, noises)
