"""Whether the model fits: residuals of the training part against the noise, and errors of the held-out part."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asrsim.identification.data import Channel
from asrsim.identification.noise import SWING, beyond_steps, is_nothing, lag_correlation, size_of, swing
from asrsim.identification.problem import Errors, Problem, errors
from asrsim.samples import Array

FITS, SURE = 1.25, 2.0
"""Residuals up to this multiple of the estimated noise may be noise; what the estimate from n samples adds, times sqrt(n)."""
WHITE = 0.3
"""Correlation of neighbouring residuals below which they may be noise."""
HELD_OUT = 1.3
"""Held-out error, in training errors, beyond which a model does not fit."""
SHAKEN = 2.0
"""Standard deviations of a prediction that noise of the played commands and the intervals of the estimates explain."""
EXPLAINED = 0.5
"""Fraction of a channel's variance below which a fit does not follow it."""
EXACT = 1e-4
"""Fraction of a channel's deviation below which errors do not count: no sensor is so exact."""
OPPOSED = 0.5
"""Negative correlation of prediction and record from which on the sign may be wrong."""
MOVES = 8.0
"""A record that moves extends over more standard deviations of its noise than this."""


@dataclass(frozen=True)
class ChannelFit:
    """A channel of a recording, before and after the fit."""

    recording: str
    key: str
    unit: str
    noise: float
    """Estimated from the record's fine structure, or given."""
    before: float
    """RMS of predicted less recorded, training part."""
    after: float
    held_before: float
    """Held-out part; nan where there is none."""
    held_after: float
    correlation: float
    """Of neighbouring residuals of the training part, after the fit."""
    explained: float
    """Fraction of the recorded variance that the fit explains, over the whole recording."""
    faults: tuple[str, ...] = ()
    """Why residuals of the training part are more than noise."""
    shaken: float = 0.0
    """RMS of the change of the held-out prediction by noise of the played commands."""
    steps: float = 0.0
    """Largest RMS error of an encoder that rounds down."""
    opposed: bool = False
    """Whether the prediction moves against the record: the sign may be wrong."""
    held_moves: bool = True
    """Whether anything moves in the held-out part."""

    @property
    def is_exact(self) -> bool:
        """Whether the errors do not count: below the noise, as of a simulation's own log, or below any sensor's accuracy."""
        left = float(np.nanmax([self.after, self.held_after, 0.0]))
        return is_nothing(left, self.noise) or self.explained > 1.0 - EXACT**2

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {name: None if isinstance(v, float) and np.isnan(v) else v for name, v in vars(self).items()}


def faults(channel: Channel, left: Array, moved: Array | None = None) -> Iterator[str]:
    """Why residuals (n,) of a channel are more than noise.

    moved: (n,) change of the prediction by noise of the played commands.
    """
    if is_nothing(size_of(left), channel.noise):
        return
    beyond, borne = beyond_steps(left, channel.values[: len(left)], channel.quantum)
    played = 0.0 if moved is None else SHAKEN * rms(moved)
    share = min(played / max(rms(left), 1e-300), 1.0) ** 2
    if moved is not None:
        borne = max(borne, share * lag_correlation(moved), key=abs)
    if lag_correlation(beyond) - borne > WHITE:
        yield f"residuals are not white, neighbours correlate by {lag_correlation(beyond):.2f}"
    elif is_loud(beyond, float(np.hypot(channel.floor, played))):
        yield f"the residuals are {size_of(beyond) / channel.floor:.2g} times the noise"
    # Steps of an encoder, and noise of played commands, swing with the motion.
    elif not channel.quantum and share < SWING and (cycles := swing(left)):
        hertz = cycles * (len(left) - 1) / float(channel.time[len(left) - 1] - channel.time[0])
        yield f"a swing of {hertz:.3g} Hz is left in the residuals: a second mode, or no start came to its frequency"


def is_loud(left: Array, noise: float) -> bool:
    """Whether residuals (n,) are larger than a noise that was estimated from as many samples."""
    return bool(size_of(left) > (FITS + SURE / max(len(left), 1) ** 0.5) * noise)


def fits_noise(problem: Problem, x: Array) -> bool:
    """Whether the residuals look like noise, or are none, in every channel of every fitted recording."""
    return all(left is not None and not any(faults(channel, left)) for channel, left in _left(problem, x))


def is_explained(problem: Problem, x: Array) -> bool:
    """Whether no residuals are left in any channel, as of a simulation's own log."""
    return all(left is not None and is_nothing(size_of(left), channel.noise) for channel, left in _left(problem, x))


def _left(problem: Problem, x: Array) -> Iterator[tuple[Channel, Array | None]]:
    for number in problem.fitted:
        left, channels = errors(problem, x, number), problem.tracks[number].channels
        yield from zip(channels, [None] * len(channels) if left is None else left, strict=True)


def channel_fits(problem: Problem, before: Errors, after: Errors, shaken: Errors) -> list[ChannelFit]:
    """before, after: residuals over each whole recording; shaken: change of the predictions by noise of the commands."""
    found = []
    for track, end, old, new, moved in zip(problem.tracks, problem.ends, before, after, shaken, strict=True):
        for i, channel in enumerate(track.channels):
            count = 0 if track.data.held else int(np.sum(channel.time <= end + 1e-9))
            missing = np.full(len(channel.time), np.nan)
            was, left = (missing if rows is None else rows[i] for rows in (old, new))
            change = None if moved is None else moved[i]
            judged = new is not None and count > 10
            spread = float(np.var(channel.values))
            beyond, _ = beyond_steps(left[:count], channel.values[:count], channel.quantum)
            found.append(
                ChannelFit(
                    recording=track.data.name, key=channel.key, unit=channel.unit, noise=float(channel.noise),
                    before=rms(was[:count]), after=rms(left[:count]), held_before=rms(was[count:]),
                    held_after=rms(left[count:]), correlation=lag_correlation(beyond) if judged else np.nan,
                    explained=1.0 - rms(left) ** 2 / spread if spread > 0.0 else np.nan,
                    faults=tuple(faults(channel, left[:count], None if change is None else change[:count])) if judged else (),
                    shaken=0.0 if change is None or count == len(left) else rms(change[count:]),
                    steps=channel.quantum / float(np.sqrt(3.0)),
                    opposed=new is not None and _opposed(channel.values + left, channel.values),
                    held_moves=count < len(left) and float(np.ptp(channel.values[count:])) > MOVES * channel.floor,
                )
            )  # fmt: skip
    return found


def _opposed(predicted: Array, recorded: Array) -> bool:
    a, b = predicted - predicted.mean(), recorded - recorded.mean()
    return float(a @ b) < -OPPOSED * float(np.linalg.norm(a) * np.linalg.norm(b))


def rms(values: Array) -> float:
    """Root mean square; nan of no values."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def verdict(fits: Sequence[ChannelFit], unsure: Callable[[], Sequence[float]]) -> list[str]:
    """Why the model does not fit; empty where it does.

    unsure: for each channel, RMS of the change of its held-out prediction within the intervals of the estimates.
    """
    reasons = []
    for key in dict.fromkeys(one.key for one in fits if not one.is_exact):
        mine = [(i, one) for i, one in enumerate(fits) if one.key == key]
        reasons += [f"{key}: {fault}" for _, one in mine for fault in one.faults][:1]
        train = _mean([one.after for _, one in mine])
        held = [(i, one) for i, one in mine if not np.isnan(one.held_after)]
        error, steps = _mean([one.held_after for _, one in held]), max(one.steps for _, one in mine)
        if error > max(HELD_OUT * train, steps, 1e-300):
            # Noise of the played commands, and the uncertainty of the estimates, are no faults of the model.
            known = unsure()
            change = _mean([float(np.hypot(one.shaken, known[i])) for i, one in held])
            if error > HELD_OUT * float(np.hypot(train, SHAKEN * change)):
                ratio = f"{error / train:.2g} times that of the training part ({error:.3g} for {train:.3g})"
                reasons.append(f"{key}: the held-out error is {ratio}")
    if all(np.isnan(one.after) for one in fits):
        reasons.append("nothing was fitted")
    return reasons


def _mean(sizes: Sequence[float]) -> float:
    """Root mean square of RMS values, without missing ones; nan of none."""
    known = np.array(sizes)[~np.isnan(sizes)]
    return rms(known)


def foreign(fits: Sequence[ChannelFit]) -> list[str]:
    """Channels that the fit does not follow: their sign, quantity or start may be wrong."""
    some = any(one.explained > EXPLAINED for one in fits)
    found: dict[str, str] = {}
    for one in fits:
        if one.explained >= (0.0 if some else EXPLAINED):
            continue
        if one.opposed:
            found[one.key] = f"{one.key} goes against its prediction: another sign? (--map COLUMN=-{one.key})"
        elif some:
            found[one.key] = f"{one.key} is not followed at all: another quantity or zero? (--map COLUMN=ignore)"
        else:
            found[one.key] = f"{one.key} is hardly followed: its start may be far off, or the quantity another"
    return list(found.values())


def praise(fits: Sequence[ChannelFit]) -> str:
    """What the held-out part shows of a model that fits."""
    held = [one for one in fits if not np.isnan(one.held_after)]
    if not held:
        return "the model fits; nothing was held out"
    if not any(one.held_moves for one in held):
        return "the model fits; nothing moves in the held-out part, which therefore proves nothing"
    return "the model fits, and predicts the held-out part as well as the training part lets expect"
