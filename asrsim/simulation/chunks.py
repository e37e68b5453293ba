"""Division of a run into chunks: after each chunk, samples go to the sinks, energy is checked and progress is reported."""

from __future__ import annotations

from asrsim.errors import InputError

LONGEST = 16_384
"""Largest number of substeps in a chunk."""
LONGEST_NUMBERS = 61_440
"""Largest number of substeps times joints in a chunk, so that its arrays fit into the processor's cache."""
SHORTEST = 1024
"""Number of substeps in the first chunks; later chunks are longer."""


def longest_chunk(joints: int, asked: int | None = None) -> int:
    """Largest number of substeps in a chunk for a robot with `joints` joints; `asked` overrides this number. Raises InputError
    if `asked` is below 1."""
    if asked is not None and not asked >= 1:
        raise InputError("must be at least 1 substep", key="chunk", value=asked, code="chunk")
    return asked or max(SHORTEST, min(LONGEST, LONGEST_NUMBERS // joints))


def chunk_at(substep: int, longest: int) -> tuple[int, int]:
    """First and last substep of the chunk that contains `substep`.

    Chunks end at fixed substeps, so that results do not depend on the grouping of calls. The first chunks are short, so that
    an early divergence is found early.
    """
    begin, length = 0, SHORTEST
    while length <= substep and length < longest:
        begin, length = length, 4 * length
    length = min(length, longest)
    start = substep - substep % length
    return max(begin, start), start + length
