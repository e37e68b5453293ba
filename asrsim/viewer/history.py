"""The samples that a page shows: the samples of a log, or the latest samples of a running simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asrsim.log.derived import DERIVED_FUNCTIONS
from asrsim.quantities import DERIVED
from asrsim.samples import Array, JointInfo, Samples, concatenate

RATE = 200.0
"""Largest rate at which the samples of a running simulation are kept, Hz."""
SPAN = 60.0
"""Time for which the samples of a running simulation are kept, s."""
MERGED = 32
"""Number of blocks of samples above which all blocks are joined to one, and old samples are discarded."""


class History:
    """Samples of a run, in the order of time. A running simulation adds samples, and old samples are discarded. Other threads
    may read the samples at any time.
    """

    def __init__(self, joints: Sequence[JointInfo], samples: Samples | None = None) -> None:
        self.joints = tuple(joints)
        self._blocks: list[Samples] = [] if samples is None else [samples]
        self._latest: Samples | None = None if samples is None else _rows(samples, slice(-1, None))

    def write(self, samples: Samples) -> None:
        """Add samples. Their times follow the times of all samples that were added before."""
        if not len(samples.time):
            return
        step = float(np.diff(samples.time[-2:])[0]) if len(samples.time) > 1 else np.inf
        every = max(1, round(1.0 / (RATE * step)))
        self._latest = _rows(samples, slice(-1, None))
        # Keep every n-th sample, counted from the end, so that the newest sample is kept.
        self._blocks.append(_rows(samples, slice((len(samples.time) - 1) % every, None, every)))
        if len(self._blocks) > MERGED:
            whole = concatenate(self._blocks)
            first = int(np.searchsorted(whole.time, whole.time[-1] - SPAN))
            self._blocks = [_rows(whole, slice(first, None))]

    @property
    def latest(self) -> Samples | None:
        """The newest sample; None before the first sample."""
        return self._latest

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last sample, s; both 0 without samples."""
        if self._latest is None:
            return 0.0, 0.0
        return float(self._blocks[0].time[0]), float(self._latest.time[-1])

    def at(self, time: float) -> Samples | None:
        """The sample nearest to a time in s; None without samples."""
        blocks = [block for block in tuple(self._blocks) if len(block.time)]
        if not blocks:
            return None
        ends = [float(block.time[-1]) for block in blocks]
        block = blocks[min(int(np.searchsorted(ends, time)), len(blocks) - 1)]
        row = int(np.abs(block.time - time).argmin())
        return _rows(block, slice(row, row + 1))

    def curve(self, joint: str, quantity: str, start: float, end: float) -> tuple[Array, Array]:
        """Times (n,) in s and values (n,) of a joint's logged or derived quantity, from `start` to `end` in s. Both are empty
        if the quantity is not recorded.
        """
        times, values = [np.empty(0)], [np.empty(0)]
        for block in tuple(self._blocks):
            inside = slice(*np.searchsorted(block.time, (start, end), side="left").tolist())
            if quantity in block.values:
                column = block.values[quantity][inside, block.joints.index(joint)]
            elif (found := values_of(_rows(block, inside, joint), quantity, self.joints)) is not None:
                column = found[:, 0]
            else:
                continue
            times.append(block.time[inside])
            values.append(column)
        return np.concatenate(times), np.concatenate(values)

    def path(self, body: str, start: float, end: float) -> Array:
        """Positions (n, 3) in m of a body from `start` to `end` in s; empty if the body is not recorded."""
        rows = self.rows(start, end)
        return np.empty((0, 3)) if rows is None or body not in rows.bodies else rows.bodies[body][:, :3]

    def rows(self, start: float, end: float) -> Samples | None:
        """Samples from `start` to `end` in s; None if this interval has no samples."""
        parts = [_rows(block, slice(*np.searchsorted(block.time, (start, end)).tolist())) for block in tuple(self._blocks)]
        parts = [part for part in parts if len(part.time)]
        return concatenate(parts) if parts else None


def values_of(samples: Samples, quantity: str, joints: Sequence[JointInfo]) -> Array | None:
    """Values (n, joints) of a logged or derived quantity; None if the samples do not contain it and it cannot be computed."""
    if quantity in samples.values:
        return samples.values[quantity]
    if quantity in DERIVED and "link_position" in samples.values:
        return DERIVED_FUNCTIONS[quantity](samples, joints)
    return None


def _rows(samples: Samples, rows: slice, joint: str | None = None) -> Samples:
    """Selected rows of samples, of all joints or of one joint."""
    j = slice(None) if joint is None else slice(samples.joints.index(joint), samples.joints.index(joint) + 1)
    return replace(
        samples,
        time=samples.time[rows],
        joints=samples.joints[j],
        values={name: values[rows, j] for name, values in samples.values.items()},
        bodies={name: poses[rows] for name, poses in samples.bodies.items()},
        contacts={name: forces[rows] for name, forces in samples.contacts.items()},
    )
