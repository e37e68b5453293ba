"""A substep in which inputs jump: its kick is cut in pieces, each with the inputs of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from asrsim.engines.base import Engine
from asrsim.samples import Array
from asrsim.simulation.damping import make_damping_law
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import Block, Piece
from asrsim.simulation.kernels import with_bristles
from asrsim.simulation.stretches import UNDEFINED, NoValueError, push_links
from asrsim.simulation.substep import (
    BOUND,
    BRAKE,
    DAMPING,
    DAMPING_TORQUE,
    EFFORT,
    FASTEST,
    FORCE,
    LAWS,
    LINK_TORQUE,
    PREVIOUS,
    PUSH_1,
    PUSH_2,
    RAW,
    READ_1,
    READ_2,
    REST,
    SPEED,
    SPRING,
    TORQUE,
    WEIGHT,
    Memory,
    Step,
    with_integrals,
)  # fmt: skip


class Splits:
    """Cuts substeps for a loop, whose engine, joints and memories it shares; in plain Python, since they are few."""

    def __init__(
        self,
        engine: Engine,
        drives: Sequence[SteppedJoint],
        joints: Any,
        memories: Sequence[Memory],
        *,
        substep: float,
        weights: tuple[float, float],
        measures: Sequence[Callable[..., None] | None],
        damping: Step | None,
        friction: Step | None,
        cut: bool,
    ) -> None:
        """weights: of the last two velocities in that of the whole step; measures: of joints with sensors; cut: see the
        loop."""
        self.engine, self.joints = engine, joints
        self.substep = substep
        self._memories, self._measures, self._damping, self._cut = memories, measures, damping, cut
        self._friction = friction
        self._now, self._before = weights
        self.take_drives(drives)

    def take_drives(self, drives: Sequence[SteppedJoint]) -> None:
        """Other numbers for the same kinds of joints."""
        self.drives = tuple(drives)
        self._cut_constants: dict[float, list[Any]] = {}

    def run(self, block: Block, index: int) -> Array:
        """One substep whose kick is cut in pieces, with the inputs of each; the first of a run has no piece before t = 0."""
        k = block.first + index
        pieces = block.events[k]
        joints, count = self.joints, len(self.drives)
        positions, lagging = self.engine.read()
        push_links(self.engine, block.wrenches[index])
        length = sum(piece.fraction for piece in pieces)
        velocities = floats(self._now * v + self._before * row[PREVIOUS] for v, row in zip(lagging, joints, strict=False))
        states = [floats(memory.load(joints[j])) for j, memory in enumerate(self._memories)]
        for j, measure in enumerate(self._measures):
            if measure is not None:
                measure(joints[j], states[j], block.stacked[index, j].tolist(), positions[j], velocities[j])
        means = np.zeros((count, 3))
        free = np.zeros((2, count))
        sides = np.zeros((2, count, len(RAW) + 1))
        rows: list[list[float]] = []
        side = 0
        for piece in pieces:
            if piece.on_time:
                rows = self._advance_all(piece, k, positions, lagging, velocities, states, 0.0)
                side = 1
            records = self._advance_all(piece, k, positions, lagging, velocities, states, piece.fraction)
            table = np.array([[*row, external] for row, external in zip(records, piece.rows[2], strict=True)])
            sides[side] += 2.0 * piece.fraction * table
            means += piece.fraction / length * table[:, [2, LINK_TORQUE, -1]]
            free[side] += 2.0 * piece.fraction * (table[:, LINK_TORQUE] == table[:, 2])
        for j, (torque, applied, external) in enumerate(means.tolist()):
            row = joints[j]
            self._memories[j].save(row, states[j])
            law = make_damping_law(self.drives[j])
            if law is not None:
                row[DAMPING] = law(row, self.drives[j].constants(self.substep), positions[j], tuple(rows[j][LAWS:]))
            row[SPEED] = lagging[j] + row[WEIGHT] * (lagging[j] - row[PREVIOUS])
            row[PREVIOUS] = lagging[j]
            row[TORQUE] = applied if row[BRAKE] != 0.0 else torque
            row[FORCE] = applied + external + row[SPRING] * (row[REST] - positions[j])
        if self._damping is not None:
            self._damp(rows, sides, free, length)
        if self._friction is not None:
            self._friction(0, None, joints, None, [rows])
            self.engine.set_friction([float(row[BOUND]) for row in joints[:count]])
        self.engine.advance([float(row[FORCE]) for row in joints[:count]], length if k == 0 else 1.0)
        if k == 0:
            # The velocity half a step before the start, as if the first kick had been a whole one.
            for j, (start, after) in enumerate(zip(lagging, self.engine.read()[1], strict=True)):
                joints[j][PREVIOUS] = 2.0 * start - after
        block.sides[k] = sides
        return np.array(rows)

    def _damp(self, rows: list[list[float]], sides: Array, free: Array, length: float) -> None:
        """Damping over a kick in pieces, which may be a part of a whole one.

        free (2, joints): the share of each half in which a controller is within its limit, so that its brake counts.
        """
        count = len(self.drives)
        joints = self.joints[:count]
        brakes = [float(row[BRAKE]) for row in joints]
        undamped = [row[LINK_TORQUE] for row in rows]
        for j, row in enumerate(joints):
            row[BRAKE] = brakes[j] * min(float(free[:, j].sum()) / (2.0 * length), 1.0)
            for column in range(len(row) - 2 * count, len(row) - count):
                row[column] = row[column] * length
        if self._damping is not None:
            self._damping(0, None, self.joints, None, [rows])
        for j, row in enumerate(joints):
            for column in range(len(row) - 2 * count, len(row) - count):
                row[column] = row[column] / length
            brake = float(row[BRAKE])
            # The brake's torque in the share of the kick in which it acts; the row is of the time after the jump.
            drag = (rows[j][LINK_TORQUE] - row[TORQUE]) * brakes[j] / brake if brake else 0.0
            limit = float(row[EFFORT])
            # A torque that was cut at its limit has its brake in it already.
            cut = undamped[j] != rows[j][2]
            rows[j][LINK_TORQUE] = undamped[j] if cut or not brakes[j] else min(max(undamped[j] + drag, -limit), limit)
            sides[:, j, LINK_TORQUE] += drag * free[:, j]
            sides[:, j, DAMPING_TORQUE] = rows[j][DAMPING_TORQUE]
            row[BRAKE] = brakes[j]

    def _advance_all(
        self,
        piece: Piece,
        k: int,
        positions: Sequence[float],
        lagging: Sequence[float],
        velocities: Sequence[float],
        states: list[Any],
        fraction: float,
    ) -> list[list[float]]:
        """Advance all joints by a fraction of a substep, in `states`; with fraction 0 nothing moves. Returns records."""
        step = self.substep * fraction
        if step not in self._cut_constants:
            self._cut_constants[step] = [drive.constants(step) for drive in self.drives]
        rows = []
        for j, (drive, constants) in enumerate(zip(self.drives, self._cut_constants[step], strict=True)):
            joint = self.joints[j]
            sensed = self._measures[j] is not None
            state = with_integrals(states[j], float(joint[PUSH_1]), float(joint[PUSH_2])) if sensed else states[j]
            goals = piece.rows[0][j] - float(joint[READ_1]), piece.rows[1][j] - float(joint[READ_2])
            try:
                torque, after, record = drive.advance(state, constants, positions[j], velocities[j], *goals)
            except UNDEFINED as fault:
                raise NoValueError(drive.name, k, str(fault)) from fault
            moved = with_integrals(after, -float(joint[PUSH_1]), -float(joint[PUSH_2])) if sensed else after
            if drive.hysteresis and drive.dynamic_motors:
                states[j] = with_bristles(moved, states[j]) if fraction else with_bristles(states[j], moved)
            elif fraction:
                states[j] = moved
            if self._cut and abs(lagging[j]) >= joint[FASTEST] and torque * lagging[j] > 0.0:
                torque = 0.0
            limit, braked = float(joint[EFFORT]), torque - float(joint[BRAKE]) * velocities[j]
            applied = torque
            if abs(braked) > limit:
                applied = limit if braked > 0.0 else -limit
            rows.append([positions[j], lagging[j], torque, applied, 0.0, *record])
        return rows


def floats(values: Any) -> tuple[float, ...]:
    """As Python's own floats: NumPy's are slow one by one, and divide by zero without an error."""
    return tuple(float(value) for value in values)
