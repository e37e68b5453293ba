"""Worlds that run side by side: one robot in one engine, N states. All that decides how a run goes on stands here, in arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.base import Engine
from asrsim.samples import Array
from asrsim.simulation import kernel
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Block
from asrsim.simulation.laws import FUNCTIONS, address_of, plain_laws
from asrsim.simulation.layout import HEALTHY, JOINT, JOINT_STEP, MOTOR, OWN, PER_MOTOR, SPRING_LAW, STATE_LAW
from asrsim.simulation.rows import Shape, positions_of, shape_of, start_of, tables
from asrsim.simulation.sensors import Sensor
from asrsim.simulation.steppings import Stepping


@dataclass(frozen=True)
class Snapshot:
    """The state of one world."""

    done: int
    state: Array
    constants: Array
    engine: Any


class Worlds:
    """N worlds of one robot, stepped in plain Python or compiled."""

    def __init__(
        self,
        engine: Engine,
        drives: Sequence[SteppedJoint],
        sensors: Sequence[Sensor | None],
        stepping: Stepping,
        *,
        substep: float,
        motor_substeps: int,
        link_implicitness: float,
        cutoff: bool,
        count: int = 1,
    ) -> None:
        self.engine, self.drives, self.sensors, self.stepping = engine, tuple(drives), tuple(sensors), stepping
        self.shape: Shape = shape_of(drives, sensors)
        self._options = {"motor_substeps": motor_substeps, "cutoff": cutoff}
        now, past = (1.5, -0.5) if stepping.staggered else (1.0, 0.0)
        numbers = (substep, now, past, stepping.first_drift, stepping.implicitness, link_implicitness, float(stepping.staggered))
        self.z = np.array(numbers)
        joints = len(drives)
        self.kinds, constants = tables(drives, sensors, self.shape, **self._options)
        self._bind()
        self.S = np.zeros((count, joints, self.shape.state))
        self.P = np.repeat(constants[None], count, axis=0)
        self.done = np.zeros(count, dtype=np.int64)
        self.fault = np.zeros((count, 2), dtype=np.int64)
        self.exchange = np.zeros((joints, 5))

    def _bind(self) -> None:
        """Addresses of laws and engine for plain Python."""
        for k, drive in zip(self.kinds, self.drives, strict=True):
            if drive.actuator is not None and drive.mode is not None and drive.mode.spring:
                k[SPRING_LAW], k[STATE_LAW] = plain_laws(drive.actuator, positions_of(drive))
            if self.stepping.joint_step is not None:
                k[JOINT_STEP] = address_of(self.stepping.joint_step)

        def step(x: Any, exchange: Any, wrenches: Any, fraction: float) -> None:
            self.engine.step(self.exchange, wrenches, fraction)

        self._engine_step = address_of(step)

    def start(self, world: int, drives: Sequence[SteppedJoint], positions: Sequence[float], velocities: Sequence[float]) -> None:
        """Put one world at the start of a run; the caller sets the engine's state."""
        rows = zip(drives, self.sensors, positions, velocities, strict=True)
        self.S[world] = [start_of(drive, sensor, self.shape, q, v) for drive, sensor, q, v in rows]
        self.done[world] = 0
        self.fault[world] = HEALTHY

    def run(self, block: Block, begin: int, end: int, *, every: int, last: int, columns: NDArray[np.int64]) -> Array:
        """Rows `begin` to `end` of a block in world 0; returns what was recorded, (rows, joints, columns)."""
        count = end - begin
        first = int(self.done[0])
        rows = len(range(first + (-first) % every, min(first + count, last + 1), every))
        out = np.empty((1, rows, len(self.drives), len(columns)))
        cuts = block.cuts
        own = cuts.places[(cuts.places[:, 0] >= begin) & (cuts.places[:, 0] < end)] - [begin, 0, 0]
        state, constants = self.S.tolist(), self.P.tolist()
        kernel.run(
            [0], count, every, last, self.done, self.fault, state, constants, self.kinds.tolist(), self.z.tolist(), [None],
            [block.inputs[begin:end].tolist()], [block.wrenches[begin:end]], [own.tolist()], cuts.fractions.tolist(),
            cuts.on_time.tolist(), cuts.inputs.tolist(), self.exchange.data, self._engine_step, 0, columns.tolist(), out.data,
        )  # fmt: skip
        self.S[:] = state
        return out[0]

    def close(self) -> None:
        """Forget the engine."""
        FUNCTIONS.pop(self._engine_step, None)


_ = Snapshot, JOINT, MOTOR, OWN, PER_MOTOR
