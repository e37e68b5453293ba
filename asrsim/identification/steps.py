"""Substeps of a fit: those that runs with the estimates take, and by how much finer ones would make the estimates others."""

from __future__ import annotations

import numpy as np

from asrsim.errors import RobotError, UnresolvedSpringError
from asrsim.identification.intervals import Uncertainty
from asrsim.identification.residuals import Residuals
from asrsim.identification.told import percent
from asrsim.samples import Array

ROUNDS = 3
"""Changes of substeps, at most."""
FINER = 4
"""Times as many substeps, against which an estimate is held: where joints stick, errors are nearer to first order."""
SAID = 2.0
"""Deviations from which on it is said what substeps do to an estimate."""


def followed(residuals: Residuals, x: Array) -> bool:
    """Give each recording the substeps that a run with x's numbers takes; whether any are others than before."""
    changed = False
    for number, track in enumerate(residuals.tracks):
        resolution = track.prepared.resolution
        try:
            wanted = track.resolution(residuals.layout.table(x, number))
        except (RobotError, UnresolvedSpringError):
            continue
        if wanted != (resolution.substeps, resolution.motor_substeps):
            track.resolve(*wanted)
            changed = True
    return changed


def discretised(residuals: Residuals, x: Array, found: Uncertainty) -> Array:
    """(n,) by which x would be another, could substeps be as fine as one likes: from a run with many more, by the order."""
    before = residuals(x)
    sizes = [(one.prepared.resolution.substeps, one.prepared.resolution.motor_substeps) for one in residuals.tracks]
    for track, (substeps, motor_substeps) in zip(residuals.tracks, sizes, strict=True):
        track.resolve(FINER * substeps, motor_substeps)
    after = residuals(x)
    for track, (substeps, motor_substeps) in zip(residuals.tracks, sizes, strict=True):
        track.resolve(substeps, motor_substeps)
    order = residuals.tracks[0].prepared.stepping.order
    return np.asarray(-found.inverse @ (found.jacobian.T @ (after - before)) / (1.0 - FINER**-order))


def remarks(residuals: Residuals, x: Array, found: Uncertainty) -> list[str]:
    """Estimates that finer substeps would put outside their intervals."""
    if residuals.tracks[0].prepared.stepping.released:
        return []
    shift = discretised(residuals, x, found)
    values, slopes = residuals.layout.values(x), residuals.layout.slopes(x)
    with np.errstate(invalid="ignore"):
        said = (np.abs(shift) > SAID * found.deviation) & (values != 0.0)
    moved = ", ".join(
        f"{residuals.layout.entries[i].name} by {percent(shift[i] * slopes[i] / values[i], '+')}"
        for i in np.flatnonzero(said).tolist()
    )
    text = "estimates are for the substeps that runs take; as fine ones as one likes would move out of their intervals"
    return [f"{text} {moved}: `substeps:` in the scenario sets them"] if moved else []
