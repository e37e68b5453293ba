"""Predictions of recordings that were not fitted: how large their errors are, and why.

Each recording has values of its own: its initial state, zero offsets and delays. These values are no properties of the robot,
and no other recording shows them. A recording that is predicted but not fitted therefore gets its own estimates of these
parameters.

Some motions are more difficult to predict than others. For example, friction may hold a link at rest at any position of an
interval. If a prediction is bad, the error of the prediction is therefore compared with the error that remains if this motion
is fitted, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nan

import numpy as np

from asrsim.identification.combinations import percent
from asrsim.identification.extensions import FURTHER
from asrsim.identification.judge import EXACT, ChannelFit
from asrsim.identification.noise import size_of
from asrsim.identification.parameters import INITIAL, JUMP, FitParameter, Layout
from asrsim.identification.problem import FitProblem, differences, weighed
from asrsim.identification.search import refined
from asrsim.metrics.values import root_mean_square
from asrsim.samples import Array

TRANSFERS = 1.5
"""The estimates count as valid for another motion if the prediction error is at most this multiple of the error of the fitted
motions, or of the error of a fit to this motion.
"""
SHORT = 0.5
"""Bandwidth of the observer of short predictions, in units of the bandwidth of the motion. It is one of the levels of the
search (`asrsim.identification.search.LEVELS`). Its predictions are long enough to show more than noise, and so short that
errors of the model do not accumulate.
"""
OWN = (".offset", ".delay")
"""Parameters of channels and commands that differ between recordings of the same robot: zero offsets drift, and delays depend
on the computer that records.
"""


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Error of a free simulation of a recording that was predicted but not fitted."""

    recording: str
    track: int
    """Index of the recording."""
    key: str
    """Channel with the largest error relative to its error in the fitted recordings."""
    unit: str
    error: float
    """RMS error of this channel in the recording; infinite if the simulation diverges."""
    fitted: float
    """RMS error of this channel in the fitted recordings."""
    seconds: float
    """Time of short predictions, each of which starts at the recorded positions, s; nan if there is no observer."""
    short: float
    """RMS error of this channel in short predictions of the recording, divided by this channel's RMS error in the fitted
    recordings. It is nan if there is no observer.
    """

    @property
    def ratio(self) -> float:
        """Error of the predicted recording divided by the error of the fitted recordings."""
        return self.error / self.fitted

    @property
    def succeeds(self) -> bool:
        """Whether the estimates count as valid for the recording."""
        return self.ratio <= TRANSFERS

    @property
    def text(self) -> str:
        """The error in words."""
        if not isfinite(self.error):
            return f"{self.recording} was predicted, not fitted: its simulation diverges{self._short}"
        numbers = f"{self.error:.3g} for {self.fitted:.3g} {self.unit}".rstrip()
        return (
            f"{self.recording} was predicted, not fitted: its RMS error is {self.ratio:.2g} times the RMS error of the fitted "
            f"recordings ({self.key}: {numbers}){self._short}"
        )

    @property
    def _short(self) -> str:
        if self.succeeds or not isfinite(self.short):
            return ""
        return (
            f". In predictions of {self.seconds:.2g} s, each of which starts at the recorded positions, its error is "
            f"{self.short:.2g} times the error of the fitted recordings"
        )


def transfers(problem: FitProblem, x: Array, fits: Sequence[ChannelFit]) -> list[Transfer]:
    """Errors of the recordings that were predicted but not fitted. Recordings without a channel of the fitted recordings are
    left out. fits: errors of all channels in free simulations.
    """
    known, fitted = dict[str, list[ChannelFit]](), problem.fitted
    if not _predicted(problem):
        return []
    for one in fits:
        known.setdefault(one.key, []).extend([one] if one.track in fitted else [])
    bandwidth, sizes = _short_errors(problem, x)
    found: dict[int, Transfer] = {}
    for one in fits:
        if one.track in fitted or not known[one.key]:
            continue
        # Errors below the accuracy of any sensor do not count.
        least = max(one.noise, EXACT * float(np.std(one.lines["recorded"])))
        error = inf if one.diverges else max(one.held_after, least)
        own = max(root_mean_square(np.array([each.after for each in known[one.key]])), least)
        own = own if isfinite(own) else least
        short = sizes.get((one.track, one.key), nan)
        others = root_mean_square(np.array([sizes.get((each.track, each.key), nan) for each in known[one.key]]))
        this = Transfer(
            recording=one.recording, track=one.track, key=one.key, unit=one.unit, error=error, fitted=own,
            seconds=1.0 / bandwidth if bandwidth else nan, short=max(short, least) / max(others, least) if bandwidth else nan,
        )  # fmt: skip
        found[one.track] = max(found.get(one.track, this), this, key=lambda each: each.ratio)
    return [*found.values()]


def _short_errors(problem: FitProblem, x: Array) -> tuple[float, dict[tuple[int, str], float]]:
    """Bandwidth of the observer of short predictions in rad/s, and the RMS error of each channel in these predictions, by
    recording and key. The bandwidth is 0 if there is no observer.
    """
    observed = problem.observed(SHORT).everything
    if not observed.observes:
        return 0.0, {}
    errors = {(part.track, part.channel.key): root_mean_square(left) for part, left in differences(observed, x)}
    return observed.playing.bandwidth, errors


def with_own_values(problem: FitProblem, x: Array) -> FitProblem:
    """Problem in which each recording that is predicted but not fitted has its own estimates of its initial state, of free zero
    offsets and delays, and of the parameters of which each fitted recording has a separate value. x: parameter vector.
    """
    problem, found = replace(problem, own={}), dict[int, Mapping[str, float]]()
    for track in _predicted(problem):
        entries = tuple(_own_entries(problem, x, track))
        alone, start = _alone(problem, x, track, entries), np.zeros(len(entries))
        if not entries or not _simulates(alone, start):
            continue
        there = refined(weighed(alone, start), start)
        found[track] = alone.layout.table(there, track)
    return replace(problem, own=found)


def _predicted(problem: FitProblem) -> list[int]:
    return [i for i, track in enumerate(problem.tracks) if track.data.predicted_only]


def _own_entries(problem: FitProblem, x: Array, number: int) -> Iterator[FitParameter]:
    """Parameters that belong to a recording. Shared parameters start at the estimates. number: index of the recording."""
    track, names = problem.tracks[number], [one.data.name for one in problem.tracks]
    values = problem.layout.table(x, number)
    separate = {entry.key: entry for entry in problem.layout.entries if entry.track is not None}
    separate |= {
        entry.key: replace(entry, start=values[entry.key])
        for entry in problem.layout.entries
        if entry.track is None and entry.key.endswith(OWN)
    }
    if any(key.startswith(JUMP) for key in separate):
        early = (f"{JUMP}{i}" for i in range(1, 1 + len(track.jumps)))
        separate = {key: entry for key, entry in separate.items() if not key.startswith(JUMP)}
        separate |= {key: FitParameter(key=key, unit="s", start=0.0, low=0.0, high=track.sampling) for key in early}
    # Where the zero of a position sensor is unknown, the fitted recordings begin at the scenario's position; this recording may
    # begin elsewhere.
    zeros = (key.removesuffix(".link_position.offset") for key in separate if key.endswith(".link_position.offset"))
    starts = (f"{joint}.{INITIAL}position" for joint in zeros)
    for key in dict.fromkeys((*separate, *track.uncertain, *starts)):
        # The bounds of an initial state are those of its recording.
        one = problem.known[key] if INITIAL in key else separate[key]
        start, far = track.initial.get(key, one.start), track.within.get(key, inf)
        low, high = max(one.low, start - far), min(one.high, start + far)
        yield replace(one, start=start, low=low, high=high).of_recording(number, names)


def _alone(problem: FitProblem, x: Array, track: int, entries: Sequence[FitParameter]) -> FitProblem:
    """Problem of a free simulation of one recording. Only the given parameters are free; the others have the values of x."""
    ends = tuple(one.data.duration if i == track else 0.0 for i, one in enumerate(problem.tracks))
    keys = {one.key for one in entries}
    layout = Layout(tuple(entries), tuple(tie for tie in problem.layout.ties if tie.to in keys))
    fixed = {key: value for key, value in problem.table(x, track).items() if key not in layout.keys}
    return replace(problem.observed(0.0), layout=layout, ends=ends, own={track: fixed})


def _simulates(problem: FitProblem, x: Array) -> bool:
    return all(np.isfinite(left).all() for _, left in differences(problem, x))


def failed_predictions(problem: FitProblem, x: Array, failed: Sequence[Transfer]) -> Iterator[str]:
    """Sentences that explain bad predictions: the fitted recordings contain too little information, a zero offset or a delay
    differs between the recordings, or the model lacks an effect. problem: problem with a free simulation; x: estimated
    parameter vector; failed: the bad predictions.
    """
    if not failed:
        return
    # The predicted recordings keep their own values. Only parameters of the robot and parameters that all recordings share are
    # fitted to them.
    everything = weighed(problem.everything, x)
    there = refined(everything, x)
    before, after = _errors(everything, x), _errors(everything, there)
    for one in failed:
        # After a fit to all recordings, the error of one recording may be larger than before.
        ratio = max(before[one.track] / max(after[one.track], 1e-300), 1.0)
        if ratio > TRANSFERS:
            yield (
                f"{one.recording}: if this recording is also fitted, its error falls to {percent(1.0 / ratio)}: the other "
                "recordings contain too little information for its motion; fit this recording too, and validate with another "
                "recording"
            )
        elif differs := _different(problem, x, one.track):
            share, table = differs
            texts, options = list[str](), list[str]()
            for key, (value, others) in table.items():
                unit = problem.known[key].unit
                texts.append(f"{key} is {value:.3g} {unit} in this recording instead of {others:.3g} {unit}")
                options.append(f"--free {key} --own {key}")
            yield (
                f"{one.recording}: its error falls to {percent(share)} if {' and '.join(texts)}: estimate separate values for "
                f"each recording ({' '.join(options)})"
            )
        else:
            yield (
                f"{one.recording}: if this recording is also fitted, {percent(1.0 / ratio)} of its error remain: its motion "
                "shows an effect that the model lacks; fit this recording too, so that the effect is searched in both motions"
            )


def _different(problem: FitProblem, x: Array, track: int) -> tuple[float, dict[str, tuple[float, float]]] | None:
    """Zero offsets and delays whose separate values for a recording explain the bad prediction: the fraction of the error that
    remains, and for each key the separate value and the value of the fitted recordings. None if no separate value explains it.
    track: index of the recording.
    """
    data, values, known = problem.tracks[track].data, problem.table(x, track), problem.known
    keys = [f"{series.key}{what}" for series in (*data.commands, *data.channels) for what in OWN]
    keys = [key for key in keys if key not in problem.own.get(track, {})]
    free = {key: replace(known[key], start=values.get(key, known[key].start)) for key in keys}
    chosen, found, before = list[str](), dict[str, float](), 1.0
    for _ in keys:
        # Add the parameter with which the least error remains.
        trials = [_separate(problem, x, track, [free[key] for key in (*chosen, new)]) for new in keys if new not in chosen]
        share, values = min(trials, key=lambda trial: trial[0])
        if not share <= FURTHER * before:
            break
        chosen, found, before = [*values], values, share
    return (before, {key: (found[key], free[key].start) for key in chosen}) if before * TRANSFERS < 1.0 else None


def _separate(problem: FitProblem, x: Array, track: int, entries: Sequence[FitParameter]) -> tuple[float, dict[str, float]]:
    """Fraction of a recording's error that remains if these parameters have separate values for it, and these values by key.
    The fraction is infinite if the simulation diverges.
    """
    alone, start = _alone(problem, x, track, entries), np.zeros(len(entries))
    if not _simulates(alone, start):
        return inf, {}
    alone = weighed(alone, start)
    there = refined(alone, start)
    return _errors(alone, there)[track] / _errors(alone, start)[track], alone.layout.named(there)


def _errors(problem: FitProblem, x: Array) -> dict[int, float]:
    """Error of each recording, by its index: root mean square of its channels' residuals, each relative to the recorded
    motion.
    """
    found: dict[int, list[float]] = {}
    for part, left in differences(problem, x):
        found.setdefault(part.track, []).append(size_of(left) / max(float(np.std(part.recorded)), part.noise))
    return {track: size_of(np.array(sizes)) for track, sizes in found.items()}
