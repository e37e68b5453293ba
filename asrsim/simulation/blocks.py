"""Advances many worlds: samples their inputs in blocks, and distributes the worlds among threads."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.samples import Array
from asrsim.simulation.core import Core
from asrsim.simulation.inputs import Given, Inputs, chunk_at, joined
from asrsim.simulation.layout import HEALTH

NOTHING = np.empty(0)


@dataclass
class InputBlock:
    """Inputs of some worlds for some substeps."""

    numbers: NDArray[np.int64]
    which: NDArray[np.int64]
    """Indices (m, 4) of each world, of the world's set of inputs, of its row in the output, and of its set of wrenches, lengths
    and cuts.
    """
    given: Given
    end: int
    """Number of rows in the block."""
    row: int = 0
    """Number of rows of the block that have been simulated."""
    steady: Inputs | None = None
    """Inputs of all worlds of the block, if all rows are equal; else None."""
    until: int = 0
    """Substep up to which equal rows stay valid and can be used again."""


class Blocks:
    """Advances worlds through blocks of inputs. A call reuses the block of the previous call if the two blocks have equal
    length, and if their inputs differ only in the values that callers set.
    """

    def __init__(self, core: Core, inputs: Sequence[Inputs], *, chunk: int, threads: int) -> None:
        """inputs: input signals of each world; chunk: largest number of substeps whose inputs are sampled in one call; threads:
        number of threads, which is used if the whole loop is machine code.
        """
        self._core, self._inputs, self._chunk = core, list(inputs), chunk
        self._substeps = core.prepared.resolution.substeps
        self._places = np.arange(len(self._inputs))
        self._equal_inputs: bool | None = None
        """Whether all worlds have the same inputs; None: unknown after a change."""
        self._block: InputBlock | None = None
        """Inputs of the next substeps; None after a change of times, signals or states."""
        self._renewed = True
        """Whether `_block` contains the values that callers have set."""
        self._threads = threads if core.native else 1
        self._pool = ThreadPoolExecutor(threads) if self._threads > 1 else None

    def put(self, world: int, inputs: Inputs) -> None:
        """Give a world other input signals; `discard` must follow."""
        self._inputs[world], self._equal_inputs = inputs, None

    def discard(self) -> None:
        """Discard the sampled inputs, since times, signals or states have changed."""
        self._block = None

    def renew(self) -> None:
        """Before the next step, copy the values that callers have set into the block."""
        self._renewed = False

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def run(self, numbers: NDArray[np.int64], count: int, *, keep: bool) -> Array:
        """Advance by `count` substeps. With `keep`, returns rows (m, rows, joints, columns) at whole steps."""
        kept = np.full((len(numbers), -(-count // self._substeps), *self._core.rows.shape[1:]), np.nan) if keep else NOTHING
        ran, start = 0, -(-self._core.done // self._substeps) if keep else NOTHING
        places = self._places[: len(numbers)]
        while ran < count and len(numbers):
            if np.count_nonzero(self._core.fault) and not (moving := (self._core.fault[numbers, 0] == HEALTH.healthy)).all():
                numbers, places = numbers[moving], places[moving]
                continue
            before = self._core.done[numbers].tolist()
            length = min(count - ran, *(chunk_at(k, self._chunk)[1] - k for k in set(before)))
            out = self.go_on(numbers, length)
            for part, place, world, done in zip(out, places, numbers, before, strict=True) if keep else ():
                first, found = whole_steps(done, int(self._core.done[world]), self._substeps)
                kept[place, first - start[world] :][:found] = part[:found]
            ran += length
        return kept

    def go_on(self, numbers: NDArray[np.int64], length: int) -> Array:
        """Advance by `length` substeps of one chunk. Returns rows (m, rows, joints, columns) at whole steps."""
        block = self._block
        if block is None or block.numbers is not numbers or not self._is_ready(block, length):
            block = self._make_block(numbers, length)
            self._renewed = True
        # Discard the block in advance. After an error, the worlds may have advanced by different numbers of substeps.
        self._block = None
        first, block.row = block.row, block.row + length
        out = np.empty((len(numbers), -(-length // self._substeps), *self._core.rows.shape[1:]))
        parts = 1 if self._pool is None else min(self._threads, len(numbers))
        if self._pool is None or parts == 1:
            self._core.run(block.which, block.given, first, length, out)
        else:
            edges = np.linspace(0, len(numbers), parts + 1).astype(int).tolist()
            shares = [block.which[begin:end] for begin, end in pairwise(edges)]
            list(self._pool.map(lambda which: self._core.run(which, block.given, first, length, out), shares))
        self._block = block
        return out

    def _is_ready(self, block: InputBlock, length: int) -> bool:
        """Whether a block contains the inputs of the next substeps. A controller calls the simulation again and again with the
        same number of substeps, and changes only the values that it sets. The rows are then reused.
        """
        if block.steady is not None and length <= block.end and int(self._core.done[block.numbers[0]]) + length <= block.until:
            if not self._renewed:
                block.steady.renew(block.given, self._core.held, block.numbers)
                self._renewed = True
            block.row = 0
        return self._renewed and block.row + length <= block.end

    def _make_block(self, numbers: NDArray[np.int64], length: int) -> InputBlock:
        """Inputs of the next substeps. Each block has more substeps than the block before, until the caller sets a
        reference.
        """
        if self._renewed and self._block is not None and self._block.numbers is numbers:
            ends = (chunk_at(substep, self._chunk)[1] - substep for substep in set(self._core.done[numbers].tolist()))
            length = max(length, min(2 * self._block.end, *ends))
        parts: list[Given] = []
        count = 0
        which = np.empty((len(numbers), 4), dtype=np.int64)
        which[:, 0], which[:, 2] = numbers, self._places[: len(numbers)]
        groups, until = self._alike(numbers), 0
        for inputs, substep, places in groups:
            held = self._core.held[numbers[places]]
            free = bool(np.isnan(held).all())
            which[places, 1] = count if free else count + self._places[: len(held)]
            which[places, 3] = len(parts)
            parts.append(inputs.given(substep, length, None if free else held))
            count += len(parts[-1].inputs)
            if len(groups) == 1 and self._core.native and not free:
                until = inputs.steady_until(substep, held)
        block = InputBlock(numbers, which, self._core.taken(joined(parts)), length)
        if until >= substep + length:
            block.steady, block.until = inputs, until
        return block

    def _alike(self, numbers: NDArray[np.int64]) -> list[tuple[Inputs, int, Any]]:
        """Groups of worlds with equal inputs and times. A group consists of the inputs, the number of the next substep, and the
        indices of the worlds in `numbers`.
        """
        done, first = self._core.done[numbers], self._inputs[numbers[0]]
        substep = int(done[0])
        if self._equal_inputs is None:
            self._equal_inputs = len(set(map(id, self._inputs))) == 1
        if self._equal_inputs and (len(done) == 1 or bool((done == substep).all())):
            return [(first, substep, slice(None))]
        found: dict[tuple[int, int], tuple[Inputs, int, list[int]]] = {}
        for place, (world, substep) in enumerate(zip(numbers.tolist(), done.tolist(), strict=True)):
            inputs = self._inputs[world]
            found.setdefault((id(inputs), substep), (inputs, substep, []))[2].append(place)
        return list(found.values())


def whole_steps(before: int, after: int, every: int) -> tuple[int, int]:
    """Index of the first whole step between two substeps, and number of whole steps between these substeps."""
    first = -(-before // every)
    return first, -(-after // every) - first
