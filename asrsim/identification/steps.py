"""Substeps of a fit: those that runs with the estimates take, finer ones where a recording is more exact than these, and by how
much still finer ones would make the estimates others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from asrsim.errors import RobotError, UnresolvedSpringError
from asrsim.identification.intervals import Uncertainty
from asrsim.identification.layout import Layout
from asrsim.identification.residuals import Residuals
from asrsim.identification.solver import solve
from asrsim.identification.told import percent
from asrsim.identification.track import Track
from asrsim.samples import Array

ROUNDS = 3
"""Changes of substeps, at most."""
FINER = 4
"""Times as many substeps, against which an estimate is held: where joints stick, errors are nearer to first order."""
COARSE, FINEST = 0.3, 8
"""Share of what is left of a channel that substeps may be, and how many times as many there are for that, at most."""
WORSE = 1.5
"""Times what is left otherwise, as a mean square, from which on finer substeps explain a recording less."""
SAID = 2.0
"""Deviations from which on it is said what substeps do to an estimate."""


def followed(residuals: Residuals, x: Array, tracks: Sequence[Track]) -> bool:
    """Give each recording, those that are only compared too, the substeps that a run with x's numbers takes; whether any are
    others than before.
    """
    changed = False
    for number, track in enumerate(tracks):
        resolution = track.prepared.resolution
        try:
            wanted = track.resolution(residuals.layout.table(x, number))
        except (RobotError, UnresolvedSpringError):
            continue
        if wanted != (resolution.substeps, resolution.motor_substeps):
            track.resolve(*wanted)
            changed = True
    return changed


def refined(residuals: Residuals, x: Array, tracks: Sequence[Track]) -> tuple[Array, dict[str, int]]:
    """Give all recordings the substeps that the most exact one asks for; the estimate with them, and them as a scenario has
    them. x and nothing where those of runs will do, the scenario gives its own, or finer ones explain less: the recording is
    a simulation's, made with these.
    """
    if tracks[0].prepared.stepping.released or tracks[0].given_substeps:
        return x, {}
    factor = max(_finer_times(residuals, x), FINER if sticks(residuals.layout) else 1)
    if factor == 1:
        return x, {}
    coarse = [(track, track.prepared.resolution) for track in tracks]
    left = float(np.mean(residuals(x) ** 2))
    for track, resolution in coarse:
        track.resolve(factor * resolution.substeps, resolution.motor_substeps)
    there = solve(residuals, x, loss="linear", rounds=20)
    if float(np.mean(residuals(there) ** 2)) > WORSE * left:
        for track, resolution in coarse:
            track.resolve(resolution.substeps, resolution.motor_substeps)
        return x, {}
    found = max((track.prepared.resolution for track in tracks), key=lambda one: one.substeps)
    return there, {"substeps": found.substeps, "motor_substeps": found.motor_substeps}


def _finer_times(residuals: Residuals, x: Array) -> int:
    """How many times as many substeps leave errors of theirs well below what is left over otherwise."""
    tracks, worst = residuals.tracks, 0.0
    before = [residuals.raw(x, number) for number in range(len(tracks))]
    with _finer(residuals):
        after = [residuals.raw(x, number) for number in range(len(tracks))]
    for track, coarse, fine in zip(tracks, before, after, strict=True):
        for channel, a, b in zip(track.channels, coarse or (), fine or (), strict=False):
            left = max(channel.floor, float(np.sqrt(np.mean(a**2))))
            worst = max(worst, float(np.sqrt(np.mean((a - b) ** 2))) / left)
    factor = 1
    while worst / factor > COARSE and factor < FINEST:
        factor *= 2
    return factor


@contextmanager
def _finer(residuals: Residuals) -> Iterator[None]:
    """With many more substeps meanwhile."""
    sizes = [(one.prepared.resolution.substeps, one.prepared.resolution.motor_substeps) for one in residuals.tracks]
    for track, (substeps, motor_substeps) in zip(residuals.tracks, sizes, strict=True):
        track.resolve(FINER * substeps, motor_substeps)
    try:
        yield
    finally:
        for track, (substeps, motor_substeps) in zip(residuals.tracks, sizes, strict=True):
            track.resolve(substeps, motor_substeps)


def sticks(layout: Layout) -> bool:
    """Whether bristles are estimated: a stick that begins within a substep makes an error of first order."""
    return any(entry.parameter.key.endswith("friction_stiffness") for entry in layout.entries)


def with_substeps(residuals: Residuals, x: Array, found: Uncertainty) -> tuple[Uncertainty, str]:
    """What is to be said of estimates that finer substeps would make others by more than their deviations; where motors stick,
    with deviations that hold it.
    """
    if residuals.tracks[0].prepared.stepping.released:
        return found, ""
    before = residuals(x)
    with _finer(residuals):
        after = residuals(x)
    # A run with many more tells it, by the order.
    order = residuals.tracks[0].prepared.stepping.order
    shift = -found.inverse @ (found.jacobian.T @ (after - before)) / (1.0 - FINER**-order)
    values, slopes = residuals.layout.values(x), residuals.layout.slopes(x)
    with np.errstate(invalid="ignore"):
        said = (np.abs(shift) > SAID * found.deviation) & (values != 0.0)
    moved = ", ".join(
        f"{residuals.layout.entries[i].name} by {percent(shift[i] * slopes[i] / values[i], '+')}"
        for i in np.flatnonzero(said).tolist()
    )
    where = "out of their intervals"
    if sticks(residuals.layout):
        found, where = found.with_deviation(np.hypot(found.deviation, shift), found.quantile), "within their intervals"
    text = f"estimates are for the substeps that runs take; as fine ones as one likes would move {where} {moved}"
    return found, f"{text}: `substeps:` in the scenario sets them" if moved else ""
