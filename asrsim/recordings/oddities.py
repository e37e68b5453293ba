"""What is odd about the numbers of columns: none at all, stretches without, glitches, and those that never change."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import Problem
from asrsim.recordings.checks import lone
from asrsim.recordings.data import Column, RawSeries
from asrsim.samples import Array


def oddities(columns: Sequence[Column], series: Sequence[RawSeries]) -> list[Problem]:
    """Constant columns, stretches without numbers, glitches and wraps, of the columns that are used. series: theirs."""
    found: list[Problem] = []
    for column, raw in zip(columns, series, strict=True):
        missing = np.isnan(column.values)
        if column.quantity is None:
            continue
        if missing.all():
            found.append(Problem("has no number at all", key=column.source, code="empty-column"))
            continue
        if missing.any():
            found.append(
                Problem(_stretches(column.time, missing), key=column.source, code="missing-stretch",
                        hint="They are left out of every comparison, not bridged")
            )  # fmt: skip
        values = column.values[~missing]
        glitches = column.time[~missing][lone(values)] if not column.quantity.startswith("reference") else ()
        if len(glitches):
            places = ", ".join(f"{t:.6g}" for t in glitches[:4]) + (", ..." if len(glitches) > 4 else "")
            found.append(
                Problem(f"{len(glitches)} single samples stand far from both neighbours (glitches?), at t = {places} s",
                        key=column.source, code="glitch", hint="They are kept, and count in every comparison")
            )  # fmt: skip
        if column.unit == "rad" and len(turns := wraps(values)):
            times = ", ".join(f"{t:.6g}" for t in column.time[~missing][turns[:4]]) + (", ..." if len(turns) > 4 else "")
            found.append(
                Problem(f"jumps by a whole turn {len(turns)} times, at t = {times} s: does its encoder begin anew there?",
                        key=column.source, code="wrapped",
                        hint=f"Let it go on: --map '{column.source}={column.joint}.{column.quantity} unwrapped'")
            )  # fmt: skip
        if (bits := unsigned(raw.values[~missing])) is not None:
            found.append(
                Problem(f"jumps between 0 and 2^{bits}: are these negative numbers of {bits} bits, read without their sign?",
                        key=column.source, code="unsigned", hint=f"If so, take {2**bits} from all above {2 ** (bits - 1)}")
            )  # fmt: skip
        if len(values) > 2 and np.ptp(values) == 0.0:
            hint = None if "reference" in column.quantity else "Was the sensor connected?"
            found.append(
                Problem(f"is constant at {values[0]:g} {column.unit}".rstrip(), key=column.source,
                        code="constant-column", hint=hint)
            )  # fmt: skip
    return found


def wraps(values: Array) -> NDArray[np.intp]:
    """Indices of samples (rad) behind a jump by a whole turn, of an angle whose other steps are below a tenth of one."""
    steps = np.abs(np.diff(values))
    jumps = np.abs(steps - math.tau) <= 0.1 * math.tau
    usual = np.max(steps[~jumps], initial=0.0)
    return np.flatnonzero(jumps) + 1 if usual < 0.1 * math.tau else np.empty(0, dtype=np.intp)


def unsigned(values: Array) -> int | None:
    """Bits of a counter whose whole numbers jump from its least to its largest, as negative ones do without their sign."""
    if len(values) < 10 or values.min() < 0.0 or not np.array_equal(values, np.round(values)):
        return None
    steps = np.abs(np.diff(values))
    for bits in (8, 16, 32):
        jumps = steps > 0.9 * 2.0**bits
        if values.max() < 2.0**bits and jumps.any() and np.max(steps[~jumps], initial=0.0) < 0.1 * 2.0**bits:
            return bits
    return None


def _stretches(time: Array, missing: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> str:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], missing.astype(np.int8), [0]))))
    starts, ends = edges[::2], edges[1::2] - 1
    longest = int(np.argmax(ends - starts))
    return (
        f"{int(missing.sum())} of {len(missing)} samples have no number, in {len(starts)} stretches; the longest from "
        f"{time[starts[longest]]:.6g} s to {time[ends[longest]]:.6g} s"
    )
