"""What the controllers read: positions through delay, hold, noise and quantisation, velocities through delay and hold.

The PID of a motor (modes 5, 6) or of the link (mode 1) sees the measurements in place of the truth; the actuators' laws stay as
they are, since an error of the position is the opposite error of the reference, and one of the velocity a torque. Off by
default.
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
    """Substeps."""
    on_link: bool
    """They read the link (mode 1), not the motors."""
    noises: tuple[Noise | None, ...]
    """One an encoder."""

    @property
    def count(self) -> int:
        """Encoders."""
        return len(self.noises)

    def fill(self, table: Array, first: int, substep: float) -> None:
        """Whether each encoder samples, and its noise, at substeps from `first` on, into `table` (n, 2 count)."""
        every = 1.0 / (self.effects.rate * substep) if self.effects.rate else 1.0
        # A tick that falls on a substep belongs to it, whatever the rounding.
        ticks = np.floor(np.arange(first - 1, first + len(table)) / every + 1e-6)
        samples_now = np.diff(ticks) > 0.0
        if first == 0:
            samples_now[0] = True
        for index, noise in enumerate(self.noises):
            table[:, 2 * index] = samples_now
            if noise is not None:
                table[:, 2 * index + 1] = noise.draw(ticks[1:])


def sensor_of(drive: SteppedJoint, effects: Effects | None, *, substep: float, index: int, seed: int) -> Sensor | None:
    """The sensors of joint number `index`; None where its controllers see the truth, or there are none."""
    if effects is None or not effects.active or drive.mode is None or not drive.mode.controller:
        return None
    count = max(drive.dynamic_motors, 1)
    noises = tuple(Noise((seed, index, 2 + i), effects.noise) if effects.noise else None for i in range(count))
    return Sensor(effects, round(effects.delay / substep), not drive.mode.motor, noises)
