"""Reasons why the prediction of another motion fails. Either the fitted recordings contain too little information, or the model
lacks an effect.

Some motions are more difficult to predict than others. For example, friction may hold a link at rest at any position of an
interval. Therefore the error of a prediction is compared with the error that remains if the model is also fitted to this
motion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from asrsim.identification.combinations import percent
from asrsim.identification.noise import size_of
from asrsim.identification.problem import FitProblem, differences, weighed
from asrsim.identification.search import refined
from asrsim.samples import Array

TRANSFERS = 1.5
"""The estimates count as valid for another motion if the prediction error is at most this multiple of the error of a fit to
this motion.
"""


def failed_predictions(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on recordings that are predicted but not fitted. They state whether the error falls if such a recording is also
    fitted. problem: problem with a free simulation; x: estimated parameter vector.
    """
    predicted = [i for i, track in enumerate(problem.tracks) if track.data.predicted_only]
    if not predicted:
        return
    # The predicted recordings have no separate parameters. Only parameters of the robot and parameters that all recordings
    # share are fitted to them.
    everything = weighed(problem.everything, x)
    there = refined(everything, x)
    before, after = _errors(everything, x), _errors(everything, there)
    for track in predicted:
        # After a fit to all recordings, the error of one recording may be larger than before.
        name, ratio = problem.tracks[track].data.name, max(before[track] / max(after[track], 1e-300), 1.0)
        if ratio > TRANSFERS:
            yield (
                f"{name}: if this recording is also fitted, its error falls to {percent(1.0 / ratio)}: the other "
                "recordings contain too little information for its motion; fit this recording too, and validate with another "
                "recording"
            )
        else:
            yield (
                f"{name}: if this recording is also fitted, {percent(1.0 / ratio)} of its error remain: its motion "
                "shows an effect that the model lacks"
            )


def _errors(problem: FitProblem, x: Array) -> dict[int, float]:
    """Error of each recording, by its index: root mean square of its channels' residuals, each relative to the recorded
    motion.
    """
    found: dict[int, list[float]] = {}
    for part, left in differences(problem, x):
        found.setdefault(part.track, []).append(size_of(left) / max(float(np.std(part.recorded)), part.noise))
    return {track: size_of(np.array(sizes)) for track, sizes in found.items()}
