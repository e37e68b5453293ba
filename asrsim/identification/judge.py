"""Whether the model fits: errors on what was fitted and on what was not, whiteness, and what is missing if it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.identification.fit import WHITE, solve
from asrsim.identification.intervals import BLOCKS
from asrsim.identification.keys import LATEST, Parameter
from asrsim.identification.layout import Entry
from asrsim.identification.noise import lag_correlation
from asrsim.identification.residuals import Residuals
from asrsim.identification.task import Tie
from asrsim.identification.track import Track
from asrsim.samples import Array

HELD_OUT = 1.3
"""Held-out error in training errors beyond which a model does not fit."""
BETTER = 0.6
"""Share of the mean square error at which another cause is suspected."""
TREND = 0.6
"""Rank correlation of a spring's estimate in parts of the record with their deflection, beyond which it depends on it."""


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

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {name: None if isinstance(v, float) and np.isnan(v) else v for name, v in vars(self).items()}


def channel_fits(
    tracks: Sequence[Track], ends: Sequence[float], before: Sequence[Any], after: Sequence[Any]
) -> list[ChannelFit]:
    """before, after: by recording, residuals of each channel over the whole recording (None: not sane)."""
    found = []
    for track, end, old, new in zip(tracks, ends, before, after, strict=True):
        for i, channel in enumerate(track.channels):
            training = channel.time <= end + 1e-9 if not track.data.held else np.zeros(len(channel.time), bool)
            rows = [np.full(len(channel.time), np.nan) if r is None else r[i] for r in (old, new)]
            spread = float(np.var(channel.values))
            found.append(
                ChannelFit(
                    recording=track.data.name, key=channel.key, unit=channel.unit, noise=float(channel.noise),
                    before=_rms(rows[0][training]), after=_rms(rows[1][training]), held_before=_rms(rows[0][~training]),
                    held_after=_rms(rows[1][~training]),
                    correlation=lag_correlation(rows[1][training]) if training.sum() > 10 else np.nan,
                    explained=1.0 - _rms(rows[1]) ** 2 / spread if spread > 0.0 else np.nan,
                )
            )  # fmt: skip
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def verdict(fits: Sequence[ChannelFit]) -> list[str]:
    """Why the model does not fit; empty where it does."""
    reasons = []
    trained = {one.key: one.after for one in fits if not np.isnan(one.after)}
    for key in dict.fromkeys(one.key for one in fits):
        mine = [one for one in fits if one.key == key]
        train = [one.after for one in mine if not np.isnan(one.after)]
        held = [one.held_after for one in mine if not np.isnan(one.held_after)]
        if train and held:
            a, b = float(np.sqrt(np.mean(np.square(train)))), float(np.sqrt(np.mean(np.square(held))))
            if b > HELD_OUT * max(a, 1e-300):
                reasons.append(
                    f"{key}: the held-out error is {b / a:.2g} times that of the training part ({b:.3g} for {a:.3g})"
                )
        worst = max((one.correlation for one in mine if not np.isnan(one.correlation)), default=0.0)
        if worst > WHITE:
            reasons.append(f"{key}: residuals are not white, neighbours correlate by {worst:.2f}")
    if not trained:
        reasons.append("nothing was fitted")
    return reasons


def missing_causes(residuals: Residuals, x: Array, start: Array) -> list[str]:
    """What a model that does not fit may lack: a delay or zero that is not free, stiffness that depends on the amplitude."""
    return [*_suspected(residuals, x, start), *_amplitude(residuals, x), *_hysteresis(residuals, x)]


def _suspected(residuals: Residuals, x: Array, start: Array) -> list[str]:
    """Delays and zeros, each tried free beside the others, from the estimate and from the start."""
    free = {entry.parameter.key for entry in residuals.layout.entries}
    base = float(np.mean(residuals(x) ** 2))
    commands = list(dict.fromkeys(c.key for track in residuals.tracks for c in track.data.commands))
    channels = {c.key: c.unit for track in residuals.tracks for c in track.channels}
    found: list[tuple[float, str]] = []
    trials: list[tuple[str, list[str], Parameter]] = []
    if commands and not any(key.endswith(".delay") or key == "clock" for key in free):
        keys = [f"{key}.delay" for key in commands]
        parameter = Parameter(key=keys[0], unit="s", start=0.0, low=-1e-3, high=LATEST)
        trials.append(("a delay of the commands", keys, parameter))
    trials += [
        (f"a zero offset of {key}", [f"{key}.offset"], Parameter(key=f"{key}.offset", unit=unit, start=0.0))
        for key, unit in channels.items()
        if key.endswith("position") and f"{key}.offset" not in free
    ]
    for what, keys, parameter in trials:
        layout = residuals.layout
        extended = replace(
            layout, entries=(*layout.entries, Entry(parameter, None, parameter.key, parameter.start)),
            ties=(*layout.ties, *(Tie(key=key, to=keys[0]) for key in keys[1:])),
        )  # fmt: skip
        trial = Residuals(residuals.tracks, extended, residuals.weights, residuals.ends, residuals.counter)
        best, cost = 0.0, base
        for begin in (x, start):
            there = solve(
                trial, np.append(begin, 2.0 if parameter.unit == "s" else 0.0), loss="linear", rounds=25, tolerance=1e-4
            )
            mean = float(np.mean(trial(there) ** 2))
            if mean < cost:
                best, cost = extended.entries[-1].value(float(there[-1])), mean
            if mean < BETTER * base:
                break
        if cost < BETTER * base:
            size = f"{1e3 * best:.3g} {'ms' if parameter.unit == 's' else 'm' + parameter.unit}"
            flags = " ".join(f"--free {key}" for key in keys[:1])
            ties = "".join(f" --tie {key}={keys[0]}" for key in keys[1:])
            found.append(
                (
                    cost / base,
                    f"{what} is suspected: {size} would bring the error to {100 * (cost / base) ** 0.5:.0f} % ({flags}{ties})",
                )
            )
    return [text for _, text in sorted(found)][:2]


def block_estimates(residuals: Residuals, x: Array, jacobian: Array, count: int = BLOCKS) -> tuple[Array, Array, Array]:
    """One step of the estimate in each block alone: (blocks, n) moves, their deviations, and each residual's block."""
    left, numbers = residuals(x), residuals.blocks(count)
    n = jacobian.shape[1]
    total = int(numbers.max()) + 1
    moves, errors = np.full((total, n), np.nan), np.full((total, n), np.nan)
    for block in range(total):
        mine = numbers == block
        for i in range(n):
            size = float(jacobian[mine, i] @ jacobian[mine, i])
            if size > 0.0:
                moves[block, i] = -float(jacobian[mine, i] @ left[mine]) / size
                errors[block, i] = 1.0 / np.sqrt(size)
    return moves, errors, numbers


def _amplitude(residuals: Residuals, x: Array) -> list[str]:
    """Springs whose estimates go with the deflection, in the parts of the record."""
    from scipy.stats import spearmanr

    springs = [
        i for i, entry in enumerate(residuals.layout.entries)
        if any(word in entry.name for word in ("spring_stiffness", "spring_k", "passive_stiffness", ".k"))
        and entry.parameter.logarithmic
    ]  # fmt: skip
    if not springs:
        return []
    jacobian = residuals.jacobian(x)
    moves, errors, numbers = block_estimates(residuals, x, jacobian, 12)
    reach = np.array([np.sqrt(np.mean(np.sum(jacobian[numbers == b][:, springs] ** 2, axis=1))) for b in range(len(moves))])
    found = []
    for i in springs:
        told = errors[:, i] < 0.2
        if told.sum() < 6:
            continue
        rank = float(spearmanr(reach[told], moves[told, i]).statistic)
        extent = float(np.ptp(moves[told, i]))
        if abs(rank) > TREND and extent > 6.0 * float(np.median(errors[told, i])) and extent > 0.02:
            way = "falls" if rank < 0.0 else "grows"
            found.append(
                f"{residuals.layout.entries[i].name} {way} with the amplitude: parts of the record differ by "
                f"{100 * extent:.0f} %; a spring whose law is another is missing"
            )
    return found


def _hysteresis(residuals: Residuals, x: Array) -> list[str]:
    """Residuals that go with the sign of a channel's velocity."""
    found = []
    for track, one in enumerate(residuals.tracks):
        raw = residuals.raw(x, track, residuals.until(track))
        if raw is None:
            continue
        for channel, left in zip(one.channels, raw, strict=True):
            if "torque" not in channel.quantity:
                continue
            sign = np.sign(np.gradient(np.convolve(channel.values[: len(left)], np.ones(5) / 5.0, "same")))
            share = float(np.mean(left * sign)) ** 2 / max(float(np.mean(left**2)), 1e-300)
            if share > 0.3:
                size = abs(float(np.mean(left * sign)))
                found.append(
                    f"{channel.key} is {size:.3g} {channel.unit} off by the direction of its change: "
                    "hysteresis or friction is missing"
                )
    return found


def still_joints(tracks: Sequence[Track]) -> Mapping[str, str]:
    """Joint -> why nothing is told of its link, where no recording moves it beyond its noise."""
    moved: dict[str, float] = {}
    for track in tracks:
        for channel in track.channels:
            if channel.quantity == "link_position":
                extent = float(np.ptp(channel.values)) / (max(channel.noise, channel.quantum) * 8.0)
                moved[channel.joint] = max(moved.get(channel.joint, 0.0), extent)
    return {joint: "the link never moves beyond its noise" for joint, extent in moved.items() if extent < 1.0}


def coarse_joints(tracks: Sequence[Track]) -> list[str]:
    """Joints whose encoders' steps are larger than their noise."""
    return list(
        dict.fromkeys(c.joint for track in tracks for c in track.channels if c.quantum > 0.0 and "position" in c.quantity)
    )
