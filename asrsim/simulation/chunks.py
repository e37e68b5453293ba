"""Where a run's chunks end: between them samples are handed on, energy is checked, and progress is told."""

from __future__ import annotations

from asrsim.errors import InputError

LONGEST = 16_384
"""Substeps of a chunk, at most."""
LONGEST_NUMBERS = 20_480
"""The same times joints: what still goes through the processor's cache."""
SHORTEST = 1024
"""Substeps that are kept before they are handed on, at least; chunks grow from there."""


def longest_chunk(joints: int, asked: int | None = None) -> int:
    """Substeps of a chunk of a robot with so many joints, at most, unless others are asked for; raises InputError for none."""
    if asked is not None and not asked >= 1:
        raise InputError("must have a substep at least", key="chunk", value=asked, code="chunk")
    return asked or max(SHORTEST, min(LONGEST, LONGEST_NUMBERS // joints))


def chunk_at(substep: int, longest: int) -> tuple[int, int]:
    """Substeps at which the chunk begins and ends in which `substep` is.

    Chunks end at fixed substeps, first soon, then seldom: a divergence early in the run is found early, and results do not
    depend on how time is cut.
    """
    begin, length = 0, SHORTEST
    while length <= substep and length < longest:
        begin, length = length, 4 * length
    length = min(length, longest)
    start = substep - substep % length
    return max(begin, start), start + length
