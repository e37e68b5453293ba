"""What a model that does not fit may lack: delays, zeros, other signs, springs of joints, ties that are none, other laws of
springs, hysteresis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.intervals import BLOCKS
from asrsim.identification.keys import LATEST, Parameter
from asrsim.identification.layout import Layout
from asrsim.identification.residuals import Residuals
from asrsim.identification.solver import solve
from asrsim.identification.task import Tie
from asrsim.identification.told import percent
from asrsim.samples import Array

EXPLAINED = 0.9
"""Share of the error beyond the noise, squared, that a cause must explain to be suspected: others would, too, in part."""
FURTHER = 0.8
"""Share of the mean square error that is left, at most, where a second cause is looked for beside a first."""
HOPE = 0.005
"""Share of the error, squared, that a cause must explain with all else as it is, to be tried beside the rest."""
FOLLOWED = 0.5
"""Share of a channel's variance below which a fit hardly follows it."""
CAUSES = 3
"""That are suspected together, at most."""
TREND = 0.6
"""Rank correlation of a spring's estimate in parts of the record with their deflection, beyond which it depends on it."""


def missing_causes(residuals: Residuals, x: Array, start: Array) -> list[str]:
    """For people. residuals: weighted by the channels' noise; x: the estimate; start: where it began."""
    return [*_suspected(residuals, x, start), *_amplitude(residuals, x), *_hysteresis(residuals, x)]


@dataclass(frozen=True)
class _Cause:
    """Something that could be free and is not."""

    text: str
    flags: str
    layout: Layout
    """With it as its last entry."""
    begin: float | None
    """Where its search begins; None: where slopes say."""
    far: bool = False
    """Tried whatever slopes say."""


def _suspected(residuals: Residuals, x: Array, start: Array) -> list[str]:
    """What explains nearly all of the error where it is free beside the others: one cause, or a few together."""
    base = float(np.mean(residuals(x) ** 2))
    texts: list[str] = []
    flags: list[str] = []
    layout, places, cost = residuals.layout, [x, start], base
    while len(texts) < CAUSES and cost - 1.0 > (1.0 - EXPLAINED) * (base - 1.0):
        here = residuals.under(layout)
        slopes = np.linalg.qr(here.jacobian(places[0]))[0]
        causes = list(_causes(residuals, layout, places[0]))
        promised = [1.0 if cause.far else _promised(residuals, cause, places[0], slopes) for cause in causes]
        trials = [_tried(residuals, cause, places, step) for cause, step in zip(causes, promised, strict=True) if step]
        if not trials:
            break
        least, there, cause = min(trials, key=lambda one: one[0])
        if least > FURTHER * cost:
            break
        value = cause.layout.entries[-1].value(float(there[-1]))
        unit = cause.layout.entries[-1].parameter.unit
        # Times and zeros are small.
        size = f"{1e3 * value:.3g} m{unit}" if cause.flags.endswith((".delay", ".offset")) else f"{value:.4g} {unit}"
        texts.append(f"{cause.text} ({size.strip()})")
        flags.append(cause.flags.replace("START", f"{value:.4g}"))
        layout, places, cost = cause.layout, [there], least
    if not texts or cost - 1.0 > (1.0 - EXPLAINED) * (base - 1.0):
        return []
    verb = "is suspected: it would bring" if len(texts) == 1 else "are suspected: together they would bring"
    return [f"{' and '.join(texts)} {verb} the error to {percent((cost / base) ** 0.5)} ({' '.join(flags)})"]


def _promised(residuals: Residuals, cause: _Cause, place: Array, slopes: Array) -> float:
    """What a cause, beside all that is free (slopes (m, n), orthonormal), would be, if slopes hold; 0 where it explains nothing
    of the error.
    """
    trial = residuals.under(cause.layout)
    x = np.append(place, 0.0)
    base = trial(x)
    step = np.zeros(len(x))
    step[-1] = 1e-3
    slope = (trial(x + step) - base) / 1e-3
    slope -= slopes @ (slopes.T @ slope)
    along, size = float(slope @ base), float(slope @ slope)
    return -along / size if along**2 > HOPE * size * float(base @ base) else 0.0


def _tried(residuals: Residuals, cause: _Cause, places: list[Array], promised: float) -> tuple[float, Array, _Cause]:
    """Mean square error and vector with a cause free, the best from several places."""
    trial, begin = residuals.under(cause.layout), promised if cause.begin is None else cause.begin
    best: tuple[float, Array, _Cause] | None = None
    for place in places:
        there = solve(trial, np.append(place, begin), loss="linear", rounds=25, tolerance=1e-4)
        cost = float(np.mean(trial(there) ** 2))
        if best is None or cost < best[0]:
            best = cost, there, cause
        if cost < 1.0 + 0.1 * (float(np.mean(residuals(place[: len(residuals.layout)]) ** 2)) - 1.0):
            break
    assert best is not None  # there is a place
    return best


def _causes(residuals: Residuals, layout: Layout, x: Array) -> Iterator[_Cause]:
    """What could be free beside a layout's entries."""
    free = {entry.parameter.key for entry in layout.entries}
    commands = list(dict.fromkeys(c.key for track in residuals.tracks for c in track.data.commands))
    if commands and not any(key.endswith(".delay") or key == "clock" for key in free):
        keys = [f"{key}.delay" for key in commands]
        parameter = Parameter(key=keys[0], unit="s", start=0.0, low=-1e-3, high=LATEST)
        ties = [Tie(key=key, to=keys[0]) for key in keys[1:]]
        flags = f"--free {keys[0]}" + "".join(f" --tie {tie.key}={tie.to}" for tie in ties)
        yield _Cause("a delay of the commands", flags, layout.extended(parameter, ties), 2.0)
    for key, unit in {c.key: c.unit for track in residuals.tracks for c in track.channels}.items():
        if key.endswith("position") and f"{key}.offset" not in free:
            parameter = Parameter(key=f"{key}.offset", unit=unit, start=0.0)
            yield _Cause(f"a zero offset of {key}", f"--free {key}.offset", layout.extended(parameter), 0.0)
    for key in _lost(residuals, layout, x):
        if f"{key}.gain" not in free:
            parameter = Parameter(key=f"{key}.gain", unit="", start=1.0, low=-10.0, high=10.0)
            yield _Cause(f"another sign of {key}", f"--map COLUMN=-{key}", layout.extended(parameter), -2.0, far=True)
    for drive in residuals.tracks[0].prepared.drives:
        key, linear = f"{drive.name}.passive_stiffness", drive.joint.kind == "prismatic"
        if drive.joint.spring_stiffness == 0.0 and key not in free and not (drive.mode and drive.mode.spring):
            parameter = Parameter(key=key, unit="N/m" if linear else "N m/rad", start=0.0, low=0.0)
            yield _Cause(f"a spring of {drive.name}'s own", f"--free {key}=START", layout.extended(parameter), None)
    values = dict(zip((entry.parameter.key for entry in layout.entries), layout.values(x).tolist(), strict=True))
    for tie in layout.ties:
        entry = next((one for one in layout.entries if one.parameter.key == tie.to and one.track is None), None)
        if entry is not None and not tie.key.endswith(".delay"):
            value = tie.factor * values[tie.to]
            parameter = replace(entry.parameter, key=tie.key, start=value)
            without = replace(layout, ties=tuple(one for one in layout.ties if one is not tie))
            text = f"{tie.key} other than {'' if tie.factor == 1.0 else f'{tie.factor:g} * '}{tie.to}, to which it is tied"
            yield _Cause(text, f"--free {tie.key}", without.extended(parameter), 0.0)


def _lost(residuals: Residuals, layout: Layout, x: Array) -> list[str]:
    """Channels that are hardly followed."""
    here, found = residuals.under(layout), dict[str, None]()
    for number, track in enumerate(residuals.tracks):
        for channel, left in zip(track.channels, here.raw(x, number, here.until(number)) or (), strict=False):
            if float(np.mean(left**2)) > (1.0 - FOLLOWED) * float(np.var(channel.values[: len(left)])):
                found[channel.key] = None
    return list(found)


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
                    f"hysteresis or friction is missing (--free {channel.joint}.hysteresis_torque=START, "
                    f"{channel.joint}.stribeck_friction=START)"
                )
    return found
