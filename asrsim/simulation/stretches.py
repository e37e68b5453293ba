"""Three ways to run a stretch of substeps in which no input jumps: plain, compiled beside an engine in Python, all compiled."""

from __future__ import annotations

from collections.abc import Callable
from struct import pack
from typing import Any

import numpy as np

from asrsim.engines.base import Engine, EngineKernel
from asrsim.samples import Array
from asrsim.simulation.inputs import Block
from asrsim.simulation.stretch import Joints, leave
from asrsim.simulation.substep import BOUND, FORCE, RAW, Step

PORTION, PLAIN_PORTION = 20_000, 4_000
"""Numbers of the record, at most, that are written before they go to their columns: so many, and so many in the lists of plain
Python, stay in the processor's cache meanwhile."""
UNDEFINED = (ZeroDivisionError, OverflowError, ValueError)
"""What :mod:`math` raises where a law has no finite value."""

Stretch = Callable[[int, int, Array, Block], None]
"""stretch(start, end, rows, block): substeps of the block, into rows (n, joints, columns)."""


class NoValueError(ArithmeticError):
    """A law has no finite value where the run took it; becomes a DivergenceError."""

    def __init__(self, joint: str, substep: int, reason: str) -> None:
        super().__init__(f"its law has no finite value ({reason})")
        self.joint = joint
        self.substep = substep


def push_links(engine: Engine, wrenches: Array) -> None:
    """Forces and torques (w, 6) on links for the next step."""
    for index, values in enumerate(wrenches):
        engine.apply_wrench(index, values.tolist())


def plain_stretch(engine: Engine, laws: Step, joints: Any, *, friction: bool) -> Stretch:
    """In plain Python. friction: that of joints varies."""
    count = len(joints) - 1
    states, advance, own = engine.states, engine.advance, joints[:count]

    def run(start: int, end: int, rows: Array, block: Block) -> None:
        pushed = block.wrenches.shape[1] > 0
        inputs = block.stacked[start:end].tolist()
        record: list[list[Any]] = [[None] * count for _ in inputs]
        for k in range(end - start):
            if pushed:
                push_links(engine, block.wrenches[start + k])
            laws(k, states(), joints, inputs, record)
            if friction:
                engine.set_friction([row[BOUND] for row in own])
            advance([row[FORCE] for row in own])
        numbers = [number for rows_of_joints in record for row in rows_of_joints for number in row]
        rows[:] = np.frombuffer(pack(f"{len(numbers)}d", *numbers)).reshape(rows.shape)

    return _in_portions(run, joints, PLAIN_PORTION)


def no_kernel(engine: Engine) -> EngineKernel:
    """For an engine without a part in compiled loops."""
    empty = [np.zeros(len(engine.joints)) for _ in Joints._fields]
    return EngineKernel(move=leave, world=Joints(*empty), compiled={}, version="", advance=engine.advance)


def stepped_stretch(engine: Engine, kernel: EngineKernel, one: Callable[..., Any], joints: Any, *, friction: bool) -> Stretch:
    """The joints' substep compiled (`one`), the engine stepped from Python."""
    states, advance, world = engine.states, kernel.advance or engine.advance, kernel.world
    step = getattr(one, "entry", one)

    def run(start: int, end: int, rows: Array, block: Block) -> None:
        inputs, pushed = block.stacked[start:end], block.wrenches.shape[1] > 0
        for k in range(end - start):
            if pushed:
                push_links(engine, block.wrenches[start + k])
            forces = step(k, states(), joints, inputs, rows, world)
            if friction:
                engine.set_friction(world.friction.tolist())
            advance(forces)

    run.owner = one  # type: ignore[attr-defined]
    return _in_portions(run, joints, PORTION)


def whole_stretch(kernel: EngineKernel, whole: Callable[..., Any], joints: Any) -> Stretch:
    """Joints and engine compiled together."""
    world = kernel.world

    def run(start: int, end: int, rows: Array, block: Block) -> None:
        whole(0, end - start, joints, block.stacked[start:end], rows, block.wrenches[start:end], world)

    return _in_portions(run, joints, PORTION)


def _in_portions(stretch: Stretch, joints: Any, numbers: int) -> Stretch:
    """A stretch that writes C-contiguous rows, for rows in any order; `numbers`, at most, are written at a time."""
    where, shape = joints[len(joints) - 1], (len(joints) - 1, len(RAW))
    size = max(4, numbers // (shape[0] * shape[1]))
    record = np.empty((size, *shape))

    def run(start: int, end: int, rows: Array, block: Block) -> None:
        ordered = rows.flags.c_contiguous
        for first in range(start, end, size):
            stop = min(first + size, end)
            part = rows[first - start : stop - start]
            if not ordered:
                part = record[: stop - first]
            try:
                stretch(first, stop, part, block)
            except UNDEFINED:
                # The law counts from the portion's start.
                where[0] += first - start
                raise
            if not ordered:
                rows[first - start : stop - start] = part

    return run
