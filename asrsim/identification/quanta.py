"""What noise of played commands does to estimates: the robot's own swings carry it on."""

from __future__ import annotations

import numpy as np

from asrsim.identification.intervals import Uncertainty
from asrsim.identification.inverse import InverseTrack
from asrsim.identification.residuals import Residuals
from asrsim.samples import Array

DRAWS = 8
"""Of noise of the played commands."""


def with_played(residuals: Residuals, x: Array, found: Uncertainty) -> Uncertainty:
    """The same with deviations that hold what noise as the played commands have it makes of the estimates: what it leaves is
    correlated as the robot swings, which a few blocks do not tell.
    """
    if any(isinstance(track, InverseTrack) for track in residuals.tracks):
        # There noise of places is all that is left.
        return found
    shifts = []
    for draw in range(DRAWS):
        parts = np.zeros(len(found.jacobian))
        for number, track in enumerate(residuals.tracks):
            moved = track.shaken(residuals.layout.table(x, number), draw)
            if moved is not None:
                mine = [one for one in residuals.parts() if one.track == number]
                cut = [one[: part.rows.stop - part.rows.start] for one, part in zip(moved, mine, strict=True)]
                parts[mine[0].rows.start : mine[-1].rows.stop] = residuals.weighted(cut, number)
        if not np.any(parts):
            return found
        shifts.append(found.inverse @ (found.jacobian.T @ parts))
    alone = np.sqrt(np.diag(found.inverse @ found.noise @ found.inverse) + np.mean(np.square(shifts), axis=0))
    with np.errstate(invalid="ignore"):
        wider = np.maximum(1.0, 1.96 * alone / (found.deviation * found.quantile))
    return found.with_deviation(found.deviation * np.where(np.isfinite(wider), wider, 1.0), found.quantile)
