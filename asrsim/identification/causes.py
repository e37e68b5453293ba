"""What a model that does not fit may lack: delays, zeros, other signs, springs of joints, limits of motors, ties that are none,
other laws of springs, hysteresis.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.between import ASKED
from asrsim.identification.intervals import Uncertainty, noise_of
from asrsim.identification.keys import LATEST, Parameter, parameters_of
from asrsim.identification.layout import Layout
from asrsim.identification.limits import limits
from asrsim.identification.missing_laws import amplitude, hysteresis
from asrsim.identification.residuals import Residuals
from asrsim.identification.solver import Known, solve
from asrsim.identification.task import Tie
from asrsim.identification.told import percent
from asrsim.samples import Array

EXPLAINED = 0.9
"""Share of the error beyond the noise, squared, that a cause must explain to be suspected: others would, too, in part."""
FURTHER = 0.8
"""Share of the mean square error that is left, at most, where a second cause is looked for beside a first."""
MEASURED_FROM_ZERO = ("position", "deflection", "torque_1", "torque_2", "link_torque")
"""Ends of quantities whose sensors may have another zero."""
CONTROLLER = ("proportional", "derivative")
"""Gains that may be others than the robot's file says."""
HOPE = 0.02
"""Share of the error, squared, that a cause must explain by slopes to be tried beside the rest."""
TRIED = 4
"""Causes that are tried at a time, at most, those that promise most: of a model that is all wrong, nothing explains it."""
ROUNDS = 15
"""Steps with a cause free, at most."""
FOLLOWED = 0.5
"""Share of a channel's variance below which a fit hardly follows it."""
CAUSES = 3
"""That are suspected together, at most."""
TIE_STEP, DIFFERENT = 1e-3, 0.05
"""Of a difference along a number that is tied, in the vector's units, and share by which two differ that are said to."""


def missing_causes(residuals: Residuals, x: Array, start: Array) -> list[str]:
    """For people. residuals: weighted by the channels' noise; x: the estimate; start: where it began."""
    suspected = _suspected(residuals, x, start) or list(_nobody_gave(residuals))
    return [*suspected, *amplitude(residuals, x), *hysteresis(residuals, x)]


def ties_that_are_none(residuals: Residuals, x: Array, found: Uncertainty) -> list[str]:
    """Ties of which the recordings show that the two numbers differ: by more than chance, and by more than a few percent."""
    faults = []
    for cause, tie in _ties(residuals.layout, x):
        trial = residuals.under(cause.layout)
        base = residuals(x)
        slope = (trial(np.append(x, TIE_STEP)) - trial(np.append(x, -TIE_STEP))) / (2.0 * TIE_STEP)
        both = np.column_stack([found.jacobian, slope])
        noise, _ = noise_of(residuals, base, both)
        inverse = np.linalg.pinv(both.T @ both)
        move = float(-(inverse @ (both.T @ base))[-1])
        deviation = float(np.sqrt((inverse @ noise @ inverse)[-1, -1]))
        entry = cause.layout.entries[-1]
        share = abs(entry.value(move) / entry.value(0.0) - 1.0) if entry.value(0.0) else 0.0
        if move**2 > ASKED * deviation**2 and share > DIFFERENT:
            faults.append(f"{tie.key} is not {tie.to}, to which it is tied: they differ by {percent(share)}")
    return faults


def _nobody_gave(residuals: Residuals) -> Iterator[str]:
    """Gains that are guesses: those of a law, of a controller that is another."""
    free = {entry.parameter.key for entry in residuals.layout.entries}
    for drive in residuals.tracks[0].prepared.drives:
        key = f"{drive.name}.controller_1_proportional"
        gain = drive.block.parameters.get(key.partition(".")[2]) if drive.block else None
        if gain and gain.origin == "default" and drive.mode and drive.mode.controller and key not in free:
            yield (
                f"the gains of {drive.name}'s controller are the law's own, which nobody gave: is it another? "
                f"(--free {key}; a derivative gain brakes as damping does)"
            )


@dataclass(frozen=True)
class _Cause:
    """Something that could be free and is not."""

    text: str
    flags: str
    layout: Layout
    """With it as its last entry."""
    begin: float | None
    """Where its search begins; None: where slopes say."""
    jump: bool = False
    """At its start it acts already: slopes about the estimate, where it does not, tell nothing of it."""


def _suspected(residuals: Residuals, x: Array, start: Array) -> list[str]:
    """What explains nearly all of the error where it is free beside the others: one cause, or a few together."""
    base = float(np.mean(residuals(x) ** 2))
    texts: list[str] = []
    flags: list[str] = []
    layout, begins, cost = residuals.layout, [x, start], base
    while len(texts) < CAUSES and cost - 1.0 > (1.0 - EXPLAINED) * (base - 1.0):
        here = residuals.under(layout)
        places = [_looked(here, place) for place in begins]
        promises = [one for cause in _causes(residuals, layout, begins[0]) for one in _promises(residuals, cause, places)]
        # One that explains nearly all does so by its slopes, too, at one of the places.
        # The first of each: a limit is tried at several sizes, and from several places.
        ordered = sorted((one for one in promises if one.share > HOPE), key=lambda one: -one.share)
        first = {one.cause.text: one for one in reversed(ordered)}
        ordered = [one for one in ordered if first[one.cause.text] is one]
        # What jumps promises more than it keeps: the best of the others has its turn, too.
        others = [one for one in ordered[TRIED:] if not one.cause.jump]
        promises = ordered[:TRIED] + others[: all(one.cause.jump for one in ordered[:TRIED])]
        if not promises:
            break
        trials = [(*_kept(residuals, one), one.cause) for one in promises]
        least, there, cause = min(trials, key=lambda one: one[0])
        if least > FURTHER * cost:
            break
        value = cause.layout.entries[-1].value(float(there[-1]))
        unit = cause.layout.entries[-1].parameter.unit
        # Times and zeros are small.
        size = f"{1e3 * value:.3g} m{unit}" if cause.flags.endswith((".delay", ".offset")) else f"{value:.4g} {unit}"
        texts.append(f"{cause.text} ({size.strip()})")
        flags.append(cause.flags.replace("START", f"{value:.4g}"))
        layout, begins, cost = cause.layout, [there], least
    if not texts or cost - 1.0 > (1.0 - EXPLAINED) * (base - 1.0):
        return []
    verb = "is suspected: it would bring" if len(texts) == 1 else "are suspected: together they would bring"
    return [f"{' and '.join(texts)} {verb} the error to {percent((cost / base) ** 0.5)} ({' '.join(flags)})"]


@dataclass(frozen=True, eq=False)
class _Promise:
    """What a cause, beside all that is free, would do near a place, if slopes hold."""

    cause: _Cause
    near: Array
    """The place, with the cause at its start as the last entry."""
    known: Known | None
    """Of it."""
    move: float
    """Of that entry."""
    share: float
    """Of the error that all else leaves, squared."""


def _looked(residuals: Residuals, x: Array) -> Known:
    """A place from which causes are tried."""
    there = residuals(x)
    return x, there, residuals.jacobian(x, base=there)


def _promises(residuals: Residuals, cause: _Cause, places: Sequence[Known]) -> Iterator[_Promise]:
    """What a cause promises near each place."""
    trial = residuals.under(cause.layout)
    for place, there, matrix in places:
        x, step = np.append(place, 0.0), 0.0 if cause.jump else 1e-3
        slope = (trial(np.append(place, step)) - there) / (step or 1.0)
        free = np.linalg.qr(matrix)[0]
        alone, left = slope - free @ (free.T @ slope), there - free @ (free.T @ there)
        along, size = float(alone @ left), float(alone @ alone)
        if size > 0.0:
            known = None if cause.jump else (x, there, np.column_stack([matrix, slope]))
            yield _Promise(cause, x, known, -along / size, along**2 / (size * float(left @ left)))


def _kept(residuals: Residuals, promise: _Promise) -> tuple[float, Array]:
    """Mean square error and vector with a cause free."""
    cause, x = promise.cause, promise.near.copy()
    trial, x[-1] = residuals.under(cause.layout), promise.move if cause.begin is None else cause.begin
    there = solve(trial, x, loss="linear", rounds=ROUNDS, tolerance=1e-3, known=promise.known)
    return float(np.mean(trial(there) ** 2)), there


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
        if key.endswith(MEASURED_FROM_ZERO) and f"{key}.offset" not in free:
            parameter = Parameter(key=f"{key}.offset", unit=unit, start=0.0)
            yield _Cause(f"a zero offset of {key}", f"--free {key}.offset", layout.extended(parameter), 0.0)
    for key in _lost(residuals, layout, x):
        if f"{key}.gain" not in free:
            parameter = Parameter(key=f"{key}.gain", unit="", start=1.0, low=-10.0, high=10.0)
            yield _Cause(f"another sign of {key}", f"--map COLUMN=-{key}", layout.extended(parameter), -2.0)
    for drive in residuals.tracks[0].prepared.drives:
        key, linear = f"{drive.name}.passive_stiffness", drive.joint.kind == "prismatic"
        if drive.joint.spring_stiffness == 0.0 and key not in free and not (drive.mode and drive.mode.spring):
            parameter = Parameter(key=key, unit="N/m" if linear else "N m/rad", start=0.0, low=0.0)
            yield _Cause(f"a spring of {drive.name}'s own", f"--free {key}=START", layout.extended(parameter), None)
    for parameter, ties in _gains(residuals, free, [tie.key for tie in layout.ties]):
        text = f"another {parameter.key.rpartition('_')[2]} gain of {parameter.key.partition('.')[0]}'s controller"
        flags = f"--free {parameter.key}=START" + "".join(f" --tie {tie.key}={tie.to}" for tie in ties)
        yield _Cause(text, flags, layout.extended(parameter, ties), None)
    for text, parameter, ties in limits(residuals, layout, x):
        flags = f"--free {parameter.key}=START" + "".join(f" --tie {tie.key}={tie.to}" for tie in ties)
        yield _Cause(text, flags, layout.extended(parameter, ties), 0.0, jump=True)
    yield from (cause for cause, _ in _ties(layout, x))


def _ties(layout: Layout, x: Array) -> Iterator[tuple[_Cause, Tie]]:
    """Ties, each with its key free."""
    values = dict(zip((entry.parameter.key for entry in layout.entries), layout.values(x).tolist(), strict=True))
    for tie in layout.ties:
        entry = next((one for one in layout.entries if one.parameter.key == tie.to and one.track is None), None)
        if entry is not None and not tie.key.endswith(".delay"):
            value = tie.factor * values[tie.to]
            parameter = replace(entry.parameter, key=tie.key, start=value)
            without = replace(layout, ties=tuple(one for one in layout.ties if one is not tie))
            text = f"{tie.key} other than {'' if tie.factor == 1.0 else f'{tie.factor:g} * '}{tie.to}, to which it is tied"
            yield _Cause(text, f"--free {tie.key}", without.extended(parameter), 0.0), tie


def _gains(residuals: Residuals, free: Collection[str], tied: Collection[str]) -> Iterator[tuple[Parameter, list[Tie]]]:
    """Of controllers; a second motor's with the first's, where they are one number."""
    track = residuals.tracks[0]
    known = parameters_of(track.prepared.robot, (), {})
    for drive in track.prepared.drives:
        for name in CONTROLLER if drive.mode and drive.mode.controller else ():
            key, other = (f"{drive.name}.controller_{i}_{name}" for i in (1, 2))
            if key in known and known[key].start > 0.0 and key not in free and key not in tied:
                same = other in known and other not in free and other not in tied and known[other].start == known[key].start
                yield known[key], [Tie(key=other, to=key)] if same else []


def _lost(residuals: Residuals, layout: Layout, x: Array) -> list[str]:
    """Channels that are hardly followed."""
    here, found = residuals.under(layout), dict[str, None]()
    for number, track in enumerate(residuals.tracks):
        for channel, left in zip(track.channels, here.raw(x, number, here.until(number)) or (), strict=False):
            if float(np.mean(left**2)) > (1.0 - FOLLOWED) * float(np.var(channel.values[: len(left)])):
                found[channel.key] = None
    return list(found)
