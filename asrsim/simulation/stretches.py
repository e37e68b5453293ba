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

FLUSH = 4_000
"""Numbers, at most, of inputs and record that plain Python holds as lists, before the record moves to a compact array: short
lists stay in the processor's cache."""
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
    states, advance, own, where = engine.states, engine.advance, joints[:count], joints[count]
    size = max(4, FLUSH // (count * len(RAW)))

    def run(start: int, end: int, rows: Array, block: Block) -> None:
        pushed = block.wrenches.shape[1] > 0
        for first in range(start, end, size):
            stop = min(first + size, end)
            inputs = block.stacked[first:stop].tolist()
            record: list[list[Any]] = [[None] * count for _ in inputs]
            try:
                for k in range(stop - first):
                    if pushed:
                        push_links(engine, block.wrenches[first + k])
                    laws(k, states(), joints, inputs, record)
                    if friction:
                        engine.set_friction([row[BOUND] for row in own])
                    advance([row[FORCE] for row in own])
            except UNDEFINED:
                where[0] += first - start
                raise
            numbers = [number for rows_of_joints in record for row in rows_of_joints for number in row]
            values = np.frombuffer(pack(f"{len(numbers)}d", *numbers))
            rows[first - start : stop - start] = values.reshape(stop - first, *rows.shape[1:])

    return run


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
    return run


def whole_stretch(kernel: EngineKernel, whole: Callable[..., Any], joints: Any) -> Stretch:
    """Joints and engine compiled together."""
    world = kernel.world

    def run(start: int, end: int, rows: Array, block: Block) -> None:
        whole(0, end - start, joints, block.stacked[start:end], rows, block.wrenches[start:end], world)

    return run
