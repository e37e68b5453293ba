"""Why the prediction of another motion fails: the fitted recordings do not show enough, or the model lacks something.

Two motions may differ in how hard they are to predict: a link that rests where friction holds it may rest anywhere within a
band. So the error of a prediction is compared with the error that is left if the model is fitted to the motion, too.
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
"""Ratio of the error of a prediction to the error of a fit to the same motion up to which the estimates hold for the motion."""


def failed_predictions(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on recordings that are predicted but not fitted: whether a fit to them, too, would explain them better.
    problem: with a free simulation; x: estimate.
    """
    predicted = [i for i, track in enumerate(problem.tracks) if track.data.predicted_only]
    if not predicted:
        return
    # Without separate values for them, only the robot's parameters and common ones follow the predicted recordings.
    everything = weighed(problem.everything, x)
    there = refined(everything, x)
    before, after = _errors(everything, x), _errors(everything, there)
    for track in predicted:
        name, ratio = problem.tracks[track].data.name, before[track] / max(after[track], 1e-300)
        if ratio > TRANSFERS:
            yield (
                f"{name}: if it is fitted, too, its error falls to {percent(1.0 / ratio)}: the other recordings contain too "
                "little information for its motion; fit it, too, and validate with another recording"
            )
        else:
            yield (
                f"{name}: if it is fitted, too, {percent(1.0 / ratio)} of its error are left: its motion shows something that "
                "the model lacks"
            )


def _errors(problem: FitProblem, x: Array) -> dict[int, float]:
    """Error of each recording: root mean square of its channels' residuals relative to the recorded motion."""
    found: dict[int, list[float]] = {}
    for part, left in differences(problem, x):
        found.setdefault(part.track, []).append(size_of(left) / max(float(np.std(part.recorded)), part.noise))
    return {track: size_of(np.array(sizes)) for track, sizes in found.items()}
