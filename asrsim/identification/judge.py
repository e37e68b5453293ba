"""Judgement whether the model fits. A model fits if the residuals of the training part are noise, and if the errors in the
held-out part are not larger.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from asrsim.identification.data import Channel
from asrsim.identification.noise import MOVES, SWING, beyond_steps, frequency, is_nothing, lag_correlation, size_of
from asrsim.identification.problem import Differences, FitProblem, Part, differences
from asrsim.identification.track import Track
from asrsim.metrics.values import root_mean_square
from asrsim.recordings.reading import item_of
from asrsim.recordings.suspicions import beside
from asrsim.samples import Array

FITS, SURE = 1.25, 2.0
"""Residuals of n samples count as noise if their ratio to the estimated noise is at most FITS + SURE / sqrt(n)."""
WHITE = 0.3
"""Residuals count as white noise if their lag-1 correlation is at most this value."""
FEWEST, FEW = 11, "its samples are too few to judge the fit"
"""FEWEST: smallest number of samples in the training part with which a fit can be judged.
FEW: fault of a channel with fewer samples.
"""
HELD_OUT = 1.3
"""A model does not fit if the error of the held-out part is larger than this multiple of the error of the training part."""
SHAKEN = 2.0
"""Noise of the commands and uncertainty of the estimates cause an RMS change of the prediction. They explain a prediction error
up to this multiple of the change.
"""
HIDDEN = 3.0
"""A model that fits gets a remark if its residuals exceed this multiple of the channel's noise. Only noise of the commands can
explain such residuals, and this noise may hide errors of the model.
"""
FOLLOWED = 0.5
"""The fit does not follow a channel if it explains less than this fraction of the channel's variance."""
ACCEPTABLE, ENOUGH = 0.9, 0.95
"""ACCEPTABLE: the user may accept a model that does not fit if it explains this fraction of every channel's variance.
ENOUGH: without the user's consent, such a model is accepted if it explains this fraction.
"""
EXACT = 1e-4
"""Errors below this fraction of a channel's standard deviation are ignored, since no sensor is so exact."""


@dataclass(frozen=True)
class ChannelFit:
    """Errors of a channel of a recording, before and after the fit."""

    recording: str
    key: str
    unit: str
    noise: float
    """Standard deviation of the noise. The user states it, or it is estimated from differences of the samples."""
    before: float
    """RMS of predicted minus recorded values in the training part, before the fit."""
    after: float
    held_before: float
    """RMS error of the held-out part; nan if there is no held-out part."""
    held_after: float
    correlation: float
    """Lag-1 correlation of the training residuals after the fit."""
    explained: float
    """Fraction of the recorded variance that the fit explains, over the whole recording; nan if the simulation diverges."""
    fault: str = ""
    """Reason why the training residuals are not noise; empty if they are noise."""
    shaken: float = 0.0
    """RMS change of the held-out prediction due to noise of the played commands."""
    steps: float = 0.0
    """Largest RMS error due to the steps of an encoder, which occurs if the encoder rounds down; 0 without an encoder."""
    suspicion: str = ""
    """Suspected error of the channel's sign or unit; empty if no error is suspected."""
    held_moves: bool = True
    """Whether the robot moves in the held-out part."""
    track: int = 0
    """Index of the recording."""
    lines: Mapping[str, Array] = field(default_factory=dict, repr=False, compare=False)
    """Time, recorded values, and predictions before and after the fit, (n,) each. A prediction is missing if its simulation
    diverges.
    """

    @property
    def diverges(self) -> bool:
        """Whether the simulation of the recording diverges with the fitted parameters."""
        return bool(np.isnan(self.explained))

    @property
    def is_exact(self) -> bool:
        """Whether the errors are negligible. Negligible errors are far below the noise, as in fits to simulated logs, or below
        the accuracy of any sensor.
        """
        left = float(np.nanmax([self.after, self.held_after, 0.0]))
        return not self.diverges and (is_nothing(left, self.noise) or self.explained > 1.0 - EXACT**2)


def fault_of(channel: Channel, left: Array, moved: Array | float = 0.0) -> str:
    """Reason why residuals (n,) of a channel are not noise. Empty if they are noise or negligible.

    moved: change (n,) of the prediction due to noise of the played commands.
    """
    if is_nothing(size_of(left), channel.noise):
        return ""
    beyond, borne = beyond_steps(left, channel.values[: len(left)], channel.quantum)
    change = np.zeros(len(left)) + moved
    played = SHAKEN * root_mean_square(change)
    share = min(played / max(root_mean_square(left), 1e-300), 1.0) ** 2
    borne = max(borne, share * lag_correlation(change), key=abs)
    if lag_correlation(beyond) - borne > WHITE:
        return f"residuals are not white: neighbouring samples have a correlation of {lag_correlation(beyond):.2f}"
    if is_loud(beyond, float(np.hypot(channel.floor, played))):
        return f"the residuals are {size_of(beyond) / channel.floor:.2g} times the noise"
    # Residuals due to quantisation or to noise of the played commands may oscillate, too. Their oscillation does not show that
    # the model lacks a mode.
    if channel.quantum or share >= SWING or not (hertz := frequency(channel.time, left)):
        return ""
    return missing_mode(hertz)


def missing_mode(hertz: float) -> str:
    """Fault of a channel whose residuals oscillate. hertz: frequency of the oscillation."""
    return (
        f"an oscillation of {hertz:.3g} Hz remains in the residuals: the model lacks a mode, such as an elastic link or "
        "transmission, or no start value of the search led to this frequency"
    )


def is_loud(left: Array, noise: float) -> bool:
    """Whether residuals (n,) are significantly larger than noise. noise: standard deviation, estimated from n samples."""
    return bool(size_of(left) > (FITS + SURE / max(len(left), 1) ** 0.5) * noise)


def fits_noise(problem: FitProblem, x: Array) -> bool:
    """Whether the residuals of every fitted channel are noise or negligible."""
    return all(np.isfinite(left).all() and not fault_of(part.channel, left) for part, left in differences(problem, x))


def fits(problem: FitProblem, x: Array) -> bool:
    """Whether the model fits: all residuals are noise, or all are below the accuracy of any sensor."""
    found = differences(problem, x)
    exact = all(np.isfinite(left).all() and np.mean(left**2) < EXACT**2 * np.var(part.recorded) for part, left in found)
    return exact or fits_noise(problem, x)


def is_explained(problem: FitProblem, x: Array) -> bool:
    """Whether the residuals of every fitted channel are negligible, as in fits to simulated logs."""
    return are_negligible(differences(problem, x))


def are_negligible(found: Differences) -> bool:
    """Whether all residuals are negligible. found: predicted minus recorded values, by part."""
    return all(is_nothing(size_of(left), part.channel.noise) for part, left in found)


def explains(part: Part, left: Array, least: float) -> bool:
    """Whether predictions explain more than the fraction `least` of a channel's variance. left: predicted minus recorded
    values.
    """
    return bool(np.mean(left**2) < (1.0 - least) * np.var(part.recorded))


def channel_fits(problem: FitProblem, before: Differences, x: Array) -> list[ChannelFit]:
    """Errors of each channel with the parameter vector x, over whole recordings. before: predicted minus recorded values with
    the start values, by part.
    """
    whole, found = problem.everything, []
    now = shaken = differences(whole, x)
    if any(command.noise for i in whole.fitted for command in whole.tracks[i].data.commands):
        shaken = differences(replace(whole, playing=replace(whole.playing, draw=0)), x)
    for (part, left), (_, was), (_, moved) in zip(now, before, shaken, strict=True):
        channel, end, change = part.channel, problem.ends[part.track], np.nan_to_num(moved - left)
        count = channel.until(end) if end else 0
        lines = {"time": part.time, "recorded": part.recorded}
        lines |= {
            label: part.recorded + error for label, error in (("before", was), ("after", left)) if np.isfinite(error).all()
        }
        fault = FEW if end and count < FEWEST else ""
        if "after" in lines and count >= FEWEST:
            fault = fault_of(channel, left[:count], change[:count])
        spread = float(np.var(part.recorded))
        beyond, _ = beyond_steps(left[:count], part.recorded[:count], channel.quantum)
        found.append(
            ChannelFit(
                recording=problem.tracks[part.track].data.name, key=channel.key, unit=channel.unit,
                noise=float(channel.noise), before=root_mean_square(was[:count]), after=root_mean_square(left[:count]),
                held_before=root_mean_square(was[count:]), held_after=root_mean_square(left[count:]),
                correlation=lag_correlation(beyond) if count >= FEWEST else np.nan,
                explained=1.0 - root_mean_square(left) ** 2 / spread if spread > 0.0 else np.nan,
                fault=fault,
                shaken=root_mean_square(change[count:]), steps=channel.quantum / 3.0**0.5,
                suspicion=_suspicion(problem.tracks[part.track], channel, part.recorded + left, part.recorded),
                held_moves=count < len(left) and float(np.ptp(part.recorded[count:])) > MOVES * channel.floor,
                track=part.track, lines=lines,
            )
        )  # fmt: skip
    return found


def _suspicion(track: Track, channel: Channel, predicted: Array, recorded: Array) -> str:
    if channel.quantity == "deflection" and channel.column and track.is_reversed(channel):
        hint = f"--map '{item_of(channel.column, gain=-1.0, joint=channel.joint)}'"
        return f"the link accelerates against the torque of its spring: is the sign of the deflection reversed? ({hint})"
    found = beside(predicted, recorded, channel.column, channel.joint, "the prediction") if channel.column else []
    return f"{found[0].message} ({found[0].hint})" if found else ""


def explains_both(problem: FitProblem, whole: FitProblem, x: Array) -> bool:
    """Whether estimates from whole recordings explain training part and held-out part equally well, and both like noise. The
    model is then right even if the training part alone predicts the held-out part badly: the training part does not determine
    the parameters well enough for that prediction. problem: problem of the training part; whole: problem of the recordings.
    """
    if whole.ends == problem.ends or not (fits_noise(problem, x) and fits_noise(whole, x)):
        return False
    sizes = defaultdict[str, list[tuple[float, float]]](list)
    for part, left in differences(whole, x):
        count = part.channel.until(problem.ends[part.track])
        sizes[part.channel.key].append((root_mean_square(left[:count]), root_mean_square(left[count:])))
    pairs = [(_mean([size for size, _ in own]), _mean([size for _, size in own])) for own in sizes.values()]
    return all(not held > HELD_OUT * train for train, held in pairs)


def verdict(
    fits: Sequence[ChannelFit], unsure: Callable[[], Sequence[float]], explained: Callable[[], bool] = lambda: False
) -> list[str]:
    """Reasons why the model does not fit; empty if the model fits.

    unsure: function that returns the RMS change of each channel's held-out prediction due to the uncertainty of the estimates.
    explained: function that returns whether estimates from whole recordings explain both parts; see `explains_both`.
    """
    lost = dict.fromkeys(one.recording for one in fits if one.diverges)
    reasons = [f"the simulation of {recording} diverges with the fitted parameters" for recording in lost]
    for key in dict.fromkeys(one.key for one in fits if not one.is_exact):
        mine = [(i, one) for i, one in enumerate(fits) if one.key == key]
        reasons += [f"{key}: {one.fault}" for _, one in mine if one.fault][:1]
        train = _mean([one.after for _, one in mine])
        error, steps = _mean([one.held_after for _, one in mine]), max(one.steps for _, one in mine)
        if error > max(HELD_OUT * train, steps, 1e-300):
            # Noise of the commands and uncertainty of the estimates cause errors even with a correct model.
            known = unsure()
            change = _mean([float(np.hypot(one.shaken, known[i])) for i, one in mine])
            if error > HELD_OUT * float(np.hypot(train, SHAKEN * change)) and not explained():
                ratio = f"{error / train:.2g} times the error of the training part ({error:.3g} and {train:.3g})"
                reasons.append(f"{key}: the held-out error is {ratio}")
    return reasons


def _predicted_worse(fits: Sequence[ChannelFit]) -> str:
    """Reason why a model that fits predicts the held-out part with a larger error than the error of the training part; empty
    if no channel has a larger error."""
    one = max(fits, key=lambda one: one.held_after / max(one.after, one.steps, 1e-300))
    ratio = one.held_after / max(one.after, one.steps, 1e-300)
    if one.is_exact or not ratio > HELD_OUT:
        return ""
    return f"the training part determines the parameters less accurately ({one.key}: {ratio:.2g} times the error)"


def _mean(sizes: Sequence[float]) -> float:
    """Root mean square of the RMS values that are not nan; nan if all values are nan."""
    return root_mean_square(np.array([size for size in sizes if not np.isnan(size)]))


def foreign(fits: Sequence[ChannelFit]) -> list[str]:
    """Sentences on channels whose recorded motion the fit does not follow. Their sign, quantity or initial state may be
    wrong.
    """
    doubt = (
        "the fit hardly explains it: check its quantity, its zero offset and the start values, or leave it out "
        "(--map COLUMN=ignore)"
    )
    return list({one.key: f"{one.key}: {one.suspicion or doubt}" for one in _not_followed(fits)}.values())


def misread(fits: Sequence[ChannelFit]) -> bool:
    """Whether the sign or the unit of a channel that the fit does not follow is probably wrong. A search for missing effects
    then makes no sense.
    """
    return any(one.suspicion for one in _not_followed(fits))


def _not_followed(fits: Sequence[ChannelFit]) -> list[ChannelFit]:
    lowest = 0.0 if any(one.explained > FOLLOWED for one in fits) else FOLLOWED
    return [one for one in fits if one.explained < lowest]


def praise(fits: Sequence[ChannelFit]) -> Iterator[str]:
    """Sentences on a model that fits. They state how well it predicts the held-out part, and whether noise of the commands may
    hide errors of the model.
    """
    held = [one for one in fits if not np.isnan(one.held_after)]
    if not held:
        yield "the model fits; nothing was held out"
    elif not any(one.held_moves for one in held):
        yield "the model fits; no channel moves in the held-out part, so that part does not test the model"
    elif worse := _predicted_worse(held):
        yield f"the model fits; its prediction of the held-out part is less accurate, since {worse}"
    else:
        yield "the model fits, and predicts the held-out part as well as the training part"
    if hidden := [one.key for one in fits if one.after > HIDDEN * max(one.noise, one.steps)]:
        yield (
            f"the recorded commands are so noisy that they explain residuals far above the noise of {', '.join(hidden)}: "
            "errors of the model may be hidden"
        )
