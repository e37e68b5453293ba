"""Whether the model fits: errors on what was fitted and on what was not, and whiteness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.identification.noise import beyond_steps, is_nothing, lag_correlation, swings
from asrsim.identification.problem import Problem, Weights, jacobian
from asrsim.identification.search import WHITE, is_loud
from asrsim.identification.track import Track
from asrsim.samples import Array

SMALL = 1e-2
"""Correlations below it are not told."""
HELD_OUT = 1.3
"""Held-out error in training errors beyond which a model does not fit."""

SWING = 0.03
"""Share of a channel's residuals that a swing has, at least, which the model should have."""
SHAKEN = 2.0
"""Deviations of what the commands' noise and the estimates' uncertainty make of a prediction."""
EXPLAINED = 0.5
"""Share of a channel's variance from which on a fit explains it, more or less."""
EXACT = 1e-4
"""Share of a channel's deviation that no sensor tells: what simulations without noise differ by, whose inputs between samples
are not known.
"""
OPPOSED = 0.5
"""Correlation of prediction and record, with its sign turned, from which on a sign may be another."""
MOVES = 8.0
"""Deviations of its noise that a record extends over which moves."""
HELD = "the held-out error is"


@dataclass(frozen=True)
class ChannelFit:
    """A channel of a recording, before and after."""

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
    """Of neighbouring residuals, training part after the fit."""
    explained: float
    """Share of the recorded deviation that the fit explains, 1 - rms^2 / variance, over the whole recording."""
    shaken: float = 0.0
    """RMS, in the held-out part, of what noise as that of the recorded commands makes of the prediction."""
    loud: bool = False
    """Whether more than the noise is left of the training part."""
    swings: bool = False
    """Whether a swing is left there."""
    borne: float = 0.0
    """Part of the correlation that noise as that of the recorded commands makes, or an encoder's steps."""
    unsure: float = 0.0
    """RMS there of what the estimates' deviations make of it."""
    steps: float = 0.0
    """RMS that an encoder leaves at most which counts up to where it is."""
    opposed: bool = False
    """Whether the prediction goes against the record: its sign may be another."""
    held_moves: bool = True
    """Whether anything moves in the held-out part."""

    @property
    def explained_whole(self) -> bool:
        """Whether nothing that counts is left: less than the noise, as of a simulation without any, or than a sensor tells."""
        left = float(np.nanmax([self.after, self.held_after, 0.0]))
        return is_nothing(left, self.noise) or self.explained > 1.0 - EXACT**2

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {name: None if isinstance(v, float) and np.isnan(v) else v for name, v in vars(self).items()}


def channel_fits(
    tracks: Sequence[Track], ends: Sequence[float], before: Sequence[Any], after: Sequence[Any], shaken: Sequence[Any]
) -> list[ChannelFit]:
    """before, after: by recording, residuals of each channel over the whole recording (None: not sane); shaken: what noise of
    the commands makes of each.
    """
    found = []
    for track, end, old, new, moved in zip(tracks, ends, before, after, shaken, strict=True):
        for i, channel in enumerate(track.channels):
            training = channel.time <= end + 1e-9 if not track.data.held else np.zeros(len(channel.time), bool)
            rows = [np.full(len(channel.time), np.nan) if r is None else r[i] for r in (old, new)]
            beyond, borne = beyond_steps(rows[1][training], channel.values[training], channel.quantum)
            told = new is not None and int(training.sum()) > 10
            rings = told and not channel.quantum and swings(rows[1][training], SWING)
            spread = float(np.var(channel.values))
            predicted = channel.values + rows[1]
            played = 0.0
            if told and moved is not None:
                played = SHAKEN * _rms(moved[i][training])
                share = min(played / max(_rms(rows[1][training]), 1e-300), 1.0) ** 2
                borne = max(borne, share * lag_correlation(moved[i][training]), key=abs)
                # What is played shakes the arm, most where it swings.
                rings = rings and share < SWING
            found.append(
                ChannelFit(
                    recording=track.data.name, key=channel.key, unit=channel.unit, noise=float(channel.noise),
                    before=_rms(rows[0][training]), after=_rms(rows[1][training]), held_before=_rms(rows[0][~training]),
                    held_after=_rms(rows[1][~training]),
                    shaken=0.0 if moved is None or training.all() else _rms(moved[i][~training]),
                    correlation=lag_correlation(beyond) if told else np.nan, borne=borne,
                    loud=told and is_loud(beyond, float(np.hypot(channel.floor, played))), swings=rings,
                    steps=channel.quantum / float(np.sqrt(3.0)),
                    opposed=new is not None and _opposed(predicted, channel.values),
                    held_moves=_moves(channel.values[~training], channel.floor),
                    explained=1.0 - _rms(rows[1]) ** 2 / spread if spread > 0.0 else np.nan,
                )
            )  # fmt: skip
    return found


def with_unsure(fits: Sequence[ChannelFit], problem: Problem, x: Array, covariance: Array) -> list[ChannelFit]:
    """The same with what a covariance (n, n) of x makes of the held-out part."""
    values, vectors = np.linalg.eigh(covariance)
    ends = tuple(track.data.duration for track in problem.tracks)
    weights = tuple(tuple(Weights(channel.floor) for channel in track.channels) for track in problem.tracks)
    everything = replace(problem, ends=ends, weights=weights)
    moves = jacobian(everything, x) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    result = []
    for one, part in zip(fits, everything.parts, strict=True):
        held = part.channel.time > problem.ends[part.track] + 1e-9
        size = np.linalg.norm(moves[part.rows][held]) / max(int(held.sum()), 1) ** 0.5
        result.append(replace(one, unsure=float(size) * part.weights.noise))
    return result


def _opposed(predicted: Array, recorded: Array) -> bool:
    """Whether two series (n,) go against each other."""
    a, b = predicted - predicted.mean(), recorded - recorded.mean()
    return float(a @ b) < -OPPOSED * float(np.linalg.norm(a) * np.linalg.norm(b))


def _moves(values: Array, noise: float) -> bool:
    """Whether a record (n,) moves beyond its noise."""
    return len(values) > 0 and float(np.ptp(values)) > MOVES * noise


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def verdict(fits: Sequence[ChannelFit]) -> list[str]:
    """Why the model does not fit; empty where it does."""
    reasons = []
    trained = {one.key: one.after for one in fits if not np.isnan(one.after)}
    for key in dict.fromkeys(one.key for one in fits if not one.explained_whole):
        mine = [one for one in fits if one.key == key]
        train = [one.after for one in mine if not np.isnan(one.after)]
        held = [one.held_after for one in mine if not np.isnan(one.held_after)]
        if train and held:
            a, b = float(np.sqrt(np.mean(np.square(train)))), float(np.sqrt(np.mean(np.square(held))))
            moved = float(np.sqrt(np.mean([one.shaken**2 + one.unsure**2 for one in mine if not np.isnan(one.held_after)])))
            # Noise of what is played, and estimates that the training part told roughly, are no faults of the model.
            steps = max(one.steps for one in mine)
            if b > max(HELD_OUT * float(np.hypot(a, SHAKEN * moved)), steps, 1e-300):
                reasons.append(f"{key}: {HELD} {b / a:.2g} times that of the training part ({b:.3g} for {a:.3g})")
        worst = max(mine, key=lambda one: np.nan_to_num(one.correlation - one.borne), default=None)
        if worst is not None and worst.correlation - worst.borne > WHITE:
            also = "noise of what is played, or an encoder's steps"
            noise = f", by {worst.borne:.2f} from {also}" if abs(worst.borne) > SMALL else ""
            reasons.append(f"{key}: residuals are not white, neighbours correlate by {worst.correlation:.2f}{noise}")
        elif any(one.loud for one in mine):
            most = max(one.after / one.noise for one in mine if one.loud)
            reasons.append(f"{key}: what is left is {most:.2g} times the noise")
        elif any(one.swings for one in mine):
            reasons.append(f"{key}: a swing is left in the residuals: no start came to its frequency, or something else swings")
    if not trained:
        reasons.append("nothing was fitted")
    return reasons


def foreign(fits: Sequence[ChannelFit]) -> list[str]:
    """Channels of which the fit explains nothing while it explains others: they may be of something else. All of them, where it
    explains little of any. Of another sign is only what goes against its prediction.
    """
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
    """What a fit that was found to fit is praised for: no more than what was looked at shows."""
    judged = [one for one in fits if not one.explained_whole]
    white = all(abs(one.correlation) <= WHITE for one in judged if not np.isnan(one.correlation))
    left = (
        "residuals are white"
        if white
        else "residuals correlate no more than noise of what is played, or an encoder, makes them"
    )
    held = [one for one in fits if not np.isnan(one.held_after)]
    if not judged:
        left = "nothing that counts is left"
    if not held:
        return f"{left}; nothing was held out"
    if not any(one.held_moves for one in held):
        return f"{left}; nothing moves in the held-out part, which therefore proves nothing"
    return f"{left}, and the held-out error is what the training part lets expect"


def still_joints(tracks: Sequence[Track]) -> Mapping[str, str]:
    """Joint -> why nothing is told of its link, where no recording moves it beyond its noise."""
    moved: dict[str, float] = {}
    for track in tracks:
        for channel in track.channels:
            if channel.quantity == "link_position":
                extent = float(np.ptp(channel.values)) / (max(channel.noise, channel.quantum) * 8.0)
                moved[channel.joint] = max(moved.get(channel.joint, 0.0), extent)
    return {joint: "the link never moves beyond its noise" for joint, extent in moved.items() if extent < 1.0}
