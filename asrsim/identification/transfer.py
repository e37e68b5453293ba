"""Why the prediction of another motion fails: the fitted recordings contain too little information, or the model lacks an
effect.

Two motions may differ in how hard they are to predict: a link that rests where friction holds it may rest anywhere within a
band. So the error of a prediction is compared with the error that remains if the model is also fitted to this motion.
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
"""Largest ratio of the prediction error to the error of a fit to the same motion at which the estimates count as valid for this
motion.
"""


def failed_predictions(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on recordings that are predicted but not fitted: whether the error would fall if they were also fitted.
    problem: with a free simulation; x: estimate.
    """
    predicted = [i for i, track in enumerate(problem.tracks) if track.data.predicted_only]
    if not predicted:
        return
    # The predicted recordings get no values of their own: only parameters of the robot and parameters that all recordings share
    # are fitted to them.
    everything = weighed(problem.everything, x)
    there = refined(everything, x)
    before, after = _errors(everything, x), _errors(everything, there)
    for track in predicted:
        # A fit to all recordings may predict one of them worse than before.
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
    """Error of each recording: root mean square of its channels' residuals relative to the recorded motion."""
    found: dict[int, list[float]] = {}
    for part, left in differences(problem, x):
        found.setdefault(part.track, []).append(size_of(left) / max(float(np.std(part.recorded)), part.noise))
    return {track: size_of(np.array(sizes)) for track, sizes in found.items()}
