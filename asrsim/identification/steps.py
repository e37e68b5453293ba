"""Substeps of a fit: those that runs with the estimates take, finer ones where a recording is more exact than these, and by how
much still finer ones would make the estimates others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from asrsim.errors import RobotError, UnresolvedSpringError
from asrsim.identification.intervals import Uncertainty, noise_of
from asrsim.identification.residuals import Residuals
from asrsim.identification.solver import solve
from asrsim.identification.told import percent
from asrsim.identification.track import Track
from asrsim.samples import Array

ROUNDS = 3
"""Changes of substeps, at most."""
FINER = 4
"""Times as many substeps, against which an estimate is held."""
COARSE, FINEST = 0.3, 8
"""Deviations of an estimate that substeps may move it, and how many times as many there are for that, at most."""
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
    """Give all recordings substeps so fine that their errors move no estimate by much of its deviation.

    Returns the estimate with them, and the substeps as a scenario has them; x and nothing where those of runs suffice,
    where the scenario gives its own, or where finer ones explain less: then the recording is a simulation's, made with these.
    """
    if tracks[0].prepared.stepping.released or tracks[0].given_substeps or not len(x):
        return x, {}
    before = residuals(x)
    jacobian = residuals.jacobian(x, base=before)
    inverse = np.asarray(np.linalg.pinv(jacobian.T @ jacobian), dtype=np.float64)
    noise, _ = noise_of(residuals, before, jacobian)
    deviation = np.sqrt(np.maximum(np.diag(inverse @ noise @ inverse), 1e-300))
    worst = float(np.max(np.abs(_shift(residuals, x, inverse, jacobian)) / deviation))
    factor = next((2**k for k in range(4) if worst <= COARSE * 2**k), FINEST)
    if factor == 1:
        return x, {}
    coarse = [(track, track.prepared.resolution) for track in tracks]
    for track, resolution in coarse:
        track.resolve(factor * resolution.substeps, resolution.motor_substeps)
    there = solve(residuals, x, loss="linear", rounds=20)
    if float(np.mean(residuals(there) ** 2)) > WORSE * float(np.mean(before**2)):
        for track, resolution in coarse:
            track.resolve(resolution.substeps, resolution.motor_substeps)
        return x, {}
    found = max((track.prepared.resolution for track in tracks), key=lambda one: one.substeps)
    return there, {"substeps": found.substeps, "motor_substeps": found.motor_substeps}


def _shift(residuals: Residuals, x: Array, inverse: Array, jacobian: Array) -> Array:
    """(n,) by which infinitely fine substeps would move the estimate, from a run with more of them.

    Errors are taken to be of first order, as they are where joints stick.
    """
    before = residuals(x)
    with _finer(residuals):
        after = residuals(x)
    return np.asarray(-inverse @ (jacobian.T @ (after - before)) / (1.0 - 1.0 / FINER))


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


def with_substeps(residuals: Residuals, x: Array, found: Uncertainty) -> tuple[Uncertainty, str]:
    """The same with deviations that hold what finer substeps would make of the estimates; and what is said of those that this
    widens much.
    """
    if residuals.tracks[0].prepared.stepping.released:
        return found, ""
    shift = _shift(residuals, x, found.inverse, found.jacobian)
    values, slopes = residuals.layout.values(x), residuals.layout.slopes(x)
    with np.errstate(invalid="ignore"):
        said = (np.abs(shift) > SAID * found.deviation) & (values != 0.0)
    moved = ", ".join(
        f"{residuals.layout.entries[i].name} by {percent(shift[i] * slopes[i] / values[i], '+')}"
        for i in np.flatnonzero(said).tolist()
    )
    found = found.with_deviation(np.hypot(found.deviation, shift), found.quantile)
    text = f"intervals are wider by what finer substeps would make of {moved}: `substeps:` in the scenario sets them"
    return found, text if moved else ""
