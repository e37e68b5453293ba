"""What the controllers read: positions through delay, hold, noise and quantisation (off by default).

The PID of a motor (modes 5, 6) or of the link (mode 1) sees the measured position in place of the true one; the actuators'
laws stay as they are, since an offset of the measurement is the opposite offset of the reference.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from asrsim.scenario.data import Effects
from asrsim.simulation.drives import Drive
from asrsim.simulation.effects import Noise


class Sensor:
    """One encoder, asked once a substep."""

    def __init__(self, effects: Effects, *, substep: float, seed: tuple[int, ...]) -> None:
        self.effects = effects
        lag = round(effects.delay / substep)
        self._past: deque[float] = deque(maxlen=lag + 1)
        self._every = 1.0 / (effects.rate * substep) if effects.rate else 1.0
        self._noise = Noise(seed, effects.noise) if effects.noise else None
        self._tick = -1
        self._held = 0.0

    def measure(self, k: int, position: float) -> float:
        """The reading at substep `k` of a true `position`."""
        self._past.append(position)
        tick = int(np.floor(k / self._every + 1e-6))
        if tick == self._tick:
            return self._held
        self._tick = tick
        value = self._past[0]
        if self._noise:
            value += float(self._noise.draw(np.array([tick], dtype=float))[0])
        if self.effects.quantum:
            value = self.effects.quantum * round(value / self.effects.quantum)
        self._held = value
        return value


def sensed(drive: Drive, effects: Effects, *, substep: float, index: int, seed: int) -> tuple[Drive, Callable[..., None]]:
    """`drive` with a controller that reads through sensors, and the hook that updates them before each substep."""
    offsets = [0.0, 0.0]
    motors = max(drive.dynamic_motors, 1)
    sensors = [Sensor(effects, substep=substep, seed=(seed, index, 2 + i)) for i in range(motors)]
    mode, actuator = drive.mode, drive.actuator
    if mode is None or actuator is None or not mode.controller:
        return drive, lambda k, joints, states: None
    on_link = not mode.motor
    # Motors' states may be half a step behind the whole steps at which controllers read.
    lag = drive.stepping.first_drift * substep

    def hook(k: int, joints: Sequence[Any], states: Sequence[Any]) -> None:
        for i, sensor in enumerate(sensors):
            true = joints[index][0] if on_link else states[index][4 * i] + lag * states[index][4 * i + 1]
            offsets[i] = sensor.measure(k, true) - true

    changed = replace(drive)
    advance = drive.advance

    def advance_sensed(state: Any, constants: Any, q: float, v: float, r_1: float, r_2: float) -> Any:
        return advance(state, constants, q, v, r_1 - offsets[0], r_2 - offsets[1])

    object.__setattr__(changed, "advance", advance_sensed)
    return changed, hook
