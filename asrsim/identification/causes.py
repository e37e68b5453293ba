"""Possible causes of a misfit: extensions of the model that are tried together, and reported with the error that would remain.

`CAUSES` is the registry. Users add further causes: `CAUSES.add("integral", Cause(title="an integral", extensions=wider))` in
a plugin file, or an entry point in the group "asrsim.causes".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import chain

import numpy as np

from asrsim.errors import InputError
from asrsim.identification.combinations import percent
from asrsim.identification.data import RecordedSignal
from asrsim.identification.door import SteppedJoint
from asrsim.identification.extensions import (
    FURTHER,
    MUCH,
    TRIED,
    Extended,
    Extension,
    Optimum,
    Propose,
    best_predictions,
    extended,
    is_significant,
    pruned,
    tied_to,
)
from asrsim.identification.flexible import BEND, TIP, axis_inertia
from asrsim.identification.judge import ENOUGH, FOLLOWED, explains, missing_mode
from asrsim.identification.noise import frequency, independent_samples
from asrsim.identification.parameters import CLOCK, LATEST, FitParameter, parameters_of
from asrsim.identification.problem import FitProblem, differences, huber, mean_square, residuals, slopes_along, solve
from asrsim.identification.result import CLOSE
from asrsim.identification.search import level_by_level
from asrsim.registry import Registry, result_fault
from asrsim.samples import Array

EXPLAINED = 0.9
"""The search for causes ends if the suspected causes explain this fraction of the squared misfit beyond the noise: the rest of
the error is then a third. With this and the further thresholds without another source, `benchmarks/causes.py` names each of
ten effects first, and nothing in right models.
"""
NOISE = 2.0
"""Mean square residual, relative to the recorded noise, below which the suspected causes explain everything: the rest is then
at most as large as the noise.
"""
RIVALS = 2
"""Largest number of equally likely causes that are named beside a suspected one, so that the sentence stays readable."""
MOST, ROUNDS = 3, 15
"""Largest number of causes in one suggestion, and of rounds of `--adopt`; largest number of steps of a search with a cause:
searches that end by their tolerance take 5 to 15.
"""
MEASURED_FROM_ZERO = ("position", "deflection", "torque_1", "torque_2", "link_torque")
"""Endings of the names of quantities whose sensors may have a zero offset."""
EFFORTS = ("N m", "N", "V", "A")
"""Units of commands whose scale may be unknown."""
LIMIT_FACTORS = (2.0, 0.5, 0.1, 0.02)
"""Limits that are tried, as fractions of the largest simulated torque or speed of the motor, or deflection of the spring. The
first is not reached; each is a quarter or a fifth of the one before, so that the nearest start is wrong by a factor below 2.3.
"""
LAWS = (
    ("spring_cubic", "a cubic term in the spring", (1.0, -1.0)),
    ("backlash", "backlash", (1.0, 5.0)),
    ("spring_damping", "a damper parallel to the springs", (1.0,)),
)
"""Parameters of spring laws that are tried, words for them, and their start values, in typical sizes: 10 N m/rad^3 to both
sides; 0.01 and 0.05 rad, since a large backlash is not found from a small one; and 0.1 N m s/rad.
"""
MODES = (1.5, 3.0, 6.0)
"""Frequencies of a second mode that are tried, in units of the band of the motion. The lowest is so near the band that the
motion makes the mode resonate.
"""
SMALL = float(np.log(0.2))
"""Logarithm of the size of the second body at the start of a trial, relative to its default fraction of the link: with
6 % of the link, the first mode hardly changes.
"""
VANISHED = 0.02
"""Damping of a motor, as a fraction of the derivative gain of its controller, below which the damping counts as 0."""
MASSES = (float(np.log(1.3)), float(np.log(0.75)))
"""Logarithms of the factors of a link's mass that are tried: a load, or a link that is lighter than its file states."""
TREND, CHANCE, PARTS = 0.6, 2.9, 12
"""Rank correlation of a spring's stiffness with the deflection above which the correlation is reported; smallest ratio of this
correlation to the standard deviation of that of randomly ordered parts, which exceeds this ratio once in 270 times; number of
parts of a recording in which the stiffness is estimated.
"""
RINGING, DRIVEN = 0.1, 0.3
"""Size of residuals, relative to the recorded motion, above which their oscillation is reported; relative difference of two
frequencies above which a command does not cause the oscillation.
"""
DELAYS = (2.0, 25.0, 50.0)
"""Delays that are tried, in typical sizes: 4, 50 and 100 ms. From a small delay, the search does not find a large one.
"""
BESIDE = {"hysteresis_torque": "hysteresis_deflection", "stribeck_friction": "stribeck_velocity"}
"""Further unknown parameters of an effect, by the parameter that states its size: the deflection over which hysteresis builds
up, and the speed at which static friction fades.
"""
SPRINGS = ("spring_stiffness", "spring_k", "passive_stiffness", ".k")


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Entry of the registry of causes: an effect that the model may lack, and the extensions that represent it."""

    title: str
    """Effect that the model may lack, for the documentation."""
    extensions: Propose
    """Function of a problem and the vector (n,) of its parameters. Returns the extensions of the model to try, each with a text
    that names it.
    """


CAUSES: Registry[Cause] = Registry("cause", "asrsim.causes", instance=Cause)


@dataclass(frozen=True, kw_only=True, eq=False)
class Suspicion:
    """Effects that the model may lack."""

    text: str = ""
    """Sentence on the effects; empty if none is suspected although models with effects reduce the error."""
    trials: tuple[Mapping[str, float], ...] = ()
    """Estimates, by name, of models with effects that reduce the error; models with the suspected effects come last."""
    model: tuple[FitProblem, Array] | None = None
    """Problem with the suspected effects, and its estimate; None if no parameters of the robot or of a recording describe these
    effects.
    """
    added: tuple[str, ...] = ()
    """Names of the parameters of the suspected effects."""
    rivals: tuple[Mapping[str, float], ...] = ()
    """Estimates, by name, of models with equally likely effects."""


def missing_causes(problem: FitProblem, x: Array) -> Iterator[Suspicion]:
    """Effects that the model may lack. problem: problem whose residuals are weighted by the recorded noise."""
    # Search the model without further effects for as long as models with them: otherwise the gain of a longer search would be
    # ascribed to an effect.
    start = np.zeros(len(x))
    x = min((x, *(solve(problem, one, rounds=ROUNDS) for one in (x, start))), key=lambda one: mean_square(problem, one))
    base, least = mean_square(problem, x), huber(residuals(problem, x))
    # Even residuals below the estimated noise may be correlated: count at least a part of them as misfit.
    excess = max(base - 1.0, (1.0 - FURTHER) * base)
    target = base - EXPLAINED * excess
    found, trials = Extended((), problem, x, least), list[Extended]()
    alone = found
    for begin in (alone, None):
        first, kinds = begin or _timed(problem), [partial(_proposed, name) for name in CAUSES]
        there = extended(
            first.problem, first.x, kinds, chosen=first.chosen, most=MOST, rounds=ROUNDS, least=least,
            enough=lambda wider, there: mean_square(wider, there) <= target,
        )  # fmt: skip
        trials += there.trials
        there = pruned(problem, there, rounds=ROUNDS)
        found, _ = best_predictions(sorted((found, there), key=lambda one: mean_square(one.problem, one.x)))
        if mean_square(found.problem, found.x) < NOISE:
            break
    explained, rest = (problem, x), mean_square(found.problem, found.x)
    if found.chosen and rest <= base - MUCH * excess:
        more = "" if rest <= target else "; the model lacks further effects"
        explained = found.problem, found.x
        yield Suspicion(
            text=_suspected(found, percent((rest / base) ** 0.5)) + more,
            trials=(*(one.estimates for one in trials), found.estimates),
            model=None if any(cause.elastic for cause in found.chosen) else explained,
            added=tuple(one.name for cause in found.chosen for one in cause.parameters),
            rivals=tuple(one.estimates for one in found.rivals),
        )
    # Without a cause, only those count that are more likely in spite of their further parameters.
    elif likely := [one.estimates for one in trials if one.criterion(one.samples) < alone.criterion(one.samples)]:
        yield Suspicion(trials=tuple(likely))
    for text in chain(_oscillations(*explained), _varying_springs(*explained)):
        yield Suspicion(text=text)


def _proposed(name: str, problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that the cause with this name proposes. Raises InputError for a parameter that does not exist."""
    function = CAUSES.get(name).extensions
    found = function(problem, x)
    if not isinstance(found, Iterable):
        raise result_fault(function, f"the cause '{name}' must return or yield extensions; it returns {found!r}")
    for one in found:
        if not isinstance(one, Extension):
            message = f"the cause '{name}' must return or yield asrsim.identification.Extension; it gives {one!r}"
            raise result_fault(function, message)
        if not isinstance(one.parameters, tuple) or not all(isinstance(own, FitParameter) for own in one.parameters):
            message = f"the cause '{name}' must free a tuple of parameters of `problem.fixed`; it gives {one.parameters!r}"
            raise result_fault(function, message)
        if not one.text and (one.parameters or one.ties):
            raise result_fault(function, f"the cause '{name}' must give each extension a `text` that names it")
        for parameter in one.parameters if one.elastic is None else ():
            if parameter.key not in problem.known:
                message = f"the cause '{name}' frees a parameter that neither the robot nor a recording has"
                choices = tuple(problem.known)
                raise InputError(message, key=parameter.key, choices=choices, meant=parameter.key, code="unknown-key")
        count = len(one.parameters)
        for begin in one.begins if count else ():
            if np.shape(begin) not in ([(), (1,)] if count == 1 else [(count,)]):
                message = (
                    f"the cause '{name}' must begin '{one.text}' with a number for each of its {count} parameters, such as "
                    f"begins=[{(1.0,) * count}]; it gives {begin!r}"
                )
                raise result_fault(function, message)
        yield one


def _suspected(found: Extended, rest: str) -> str:
    """Sentence on suspected causes, with their sizes and the options of `asrsim identify` that add them to the problem. rest:
    words for the error that remains with the causes.
    """
    texts, options, links = [], list[str](), []
    values = iter(_last_values(found, sum(len(cause.parameters) for cause in found.chosen)))
    for cause in found.chosen:
        texts.append(_with_size(cause, values))
        options += _options(found, cause)
        links += [cause.elastic[0]] if cause.elastic is not None else []
    verb = "is suspected: it would reduce" if len(texts) == 1 else "are suspected: together they would reduce"
    ways = [f"--adopt, or {' '.join(dict.fromkeys(options))}"] if options and not links else []
    ways += [
        f"no option adds it: in the robot file, cut the link behind {joint} into two links, join them by a joint about the "
        "same axis with <springStiffness>, and free this joint's passive_stiffness and damping, and mass and inertia of the "
        "outer link"
        for joint in links
    ]
    added = f" ({'; '.join(ways)})" if ways else ""
    return f"{' and '.join(texts)} {verb} the error to {rest}{added}{''.join(_rivals(found))}"


def _rivals(found: Extended) -> Iterator[str]:
    """Ends of the sentence on causes that explain the recordings as well as suspected ones."""
    for i, cause in enumerate(found.chosen):
        likely = [one for one in found.rivals if one.chosen[:-1] == found.chosen[:i]][:RIVALS]
        names = []
        for one in likely:
            other = one.chosen[-1]
            ways = " ".join(dict.fromkeys(_options(one, other)))
            names.append(_with_size(other, iter(_last_values(one, len(other.parameters)))) + (f" ({ways})" if ways else ""))
        if names:
            yield f"; equally likely instead of {cause.text}: {', or '.join(names)}"


def _last_values(found: Extended, count: int) -> list[float]:
    """Values of the last parameters."""
    return found.problem.layout.values(found.x).tolist()[-count:] if count else []


def _with_size(cause: Extension, values: Iterator[float]) -> str:
    """Text of a cause with its size: as the cause states it, or the value of its last parameter. values: values of the cause's
    parameters, and after them those of later causes.
    """
    text, own = cause.text, [next(values) for _ in cause.parameters]
    if cause.size is not None:
        return f"{text} ({cause.size(*own)})"
    for one, value in zip(cause.parameters, own, strict=True):
        # Show small delays and offsets in ms and mrad.
        unit, small = one.unit.removeprefix("1"), abs(value) < 0.1 and one.key.endswith((".delay", ".offset"))
        size = f"{1e3 * value:.3g} m{unit}" if small else f"{value:.4g} {unit}".strip()
        text = cause.text if one.track is not None else f"{cause.text} ({size})"
    return text


def _options(found: Extended, cause: Extension) -> Iterator[str]:
    """Options of `asrsim identify` that add a cause to the problem."""
    values = found.problem.layout.named(found.x)
    for one in cause.parameters if cause.elastic is None else ():
        yield f"--free {one.key}={values[one.name]:.4g}" if one.track is None else f"--own {one.key}"
    yield from (f"--tie {tie.key}={tie.to}" for tie in cause.ties)


def wrong_controllers(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on joints that do not follow their recorded motion under their controller, although the torque of their drive
    was recorded.
    """
    for part, left in differences(problem, x):
        track, joint = problem.tracks[part.track], part.channel.joint
        mode = next(drive.mode for drive in track.door.drives if drive.name == joint)
        lost = not explains(part, left, FOLLOWED)
        if part.channel.quantity == "link_position" and lost and mode and mode.controller and joint in track.data.torques:
            names = [one.column.source for one in track.data.commands if one.joint == joint and one.column]
            maps = [f"'{track.data.torques[joint]}={joint}.reference_1'", *(f"'{name}=ignore'" for name in names)]
            options = " ".join(f"--map {text}" for text in maps)
            yield (
                f"the controller of {joint} in the robot may differ from the controller in the experiment: play the recorded "
                f"torque instead (--mode 0 {options})"
            )


def unexplained_drives(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on motors whose recorded motion their drives do not explain; errors of springs and links then stay hidden."""
    for part, left in differences(problem, x):
        track, joint = problem.tracks[part.track], part.channel.joint
        commands = [one.column.source for one in track.data.commands if one.joint == joint and one.column]
        others = [one for one in track.channels if one.joint == joint and not one.quantity.startswith("motor")]
        lost = not explains(part, left, ENOUGH)
        if part.channel.quantity == "motor_1_position" and lost and commands and others:
            maps = " ".join(f"--map '{name}=ignore'" for name in commands)
            yield (
                f"the drive of {joint} does not explain the motion of its motor: fit spring and link without the drive, with "
                f"the recorded motion of the motor ({maps})"
            )


def _timed(problem: FitProblem) -> Extended:
    """Problem with zeros and a delay of the commands, and its estimate from a search that begins at the start values.

    A wrong delay or zero changes the estimates of inertia and friction, and friction that falls with speed imitates both.
    Therefore a search without them ends far from the estimates of the right model.
    """
    chosen, commands = (*_command_zeros(problem), *_command_delay(problem)), [one.key for one in _played(problem)]
    wider = reduce(lambda wider, one: one.added_to(wider), chosen, problem)
    layout = wider.layout
    late = np.array([one.key.endswith(".delay") and one.key.rpartition(".")[0] in commands for one in layout.entries])
    x = level_by_level(wider, [late * begin for begin in (0.0, *DELAYS)])
    return Extended(chosen, wider, x, huber(residuals(wider, x)))


def _command_delay(problem: FitProblem) -> Iterator[Extension]:
    """Extension that frees a common delay of all commands; none if a delay is free."""
    commands = [f"{one.key}.delay" for one in _played(problem)]
    if commands and not any(key.endswith(".delay") or key == CLOCK for key in problem.layout.keys):
        first, *others = commands
        ties = tied_to(first, others)
        yield Extension(text="a delay of the commands", parameters=(_delay(first),), ties=ties, begins=DELAYS)


def _command_zeros(problem: FitProblem) -> Iterator[Extension]:
    """Extensions that free the zeros of commands, such as that of an amplifier."""
    for command in _played(problem):
        offset, _ = _zero_and_scale(command)
        if offset.key not in problem.layout.keys:
            yield Extension(text=f"a zero offset of {command.key}", parameters=(offset,))


def _played(problem: FitProblem) -> Iterable[RecordedSignal]:
    """Commands of the fitted recordings, one for each key."""
    return {one.key: one for i in problem.fitted for one in problem.tracks[i].data.commands}.values()


def _delays(problem: FitProblem, _: Array) -> Iterator[Extension]:
    """Extensions that free a common delay of all commands, or the delay of one channel, whose sensor may be slower than other
    sensors.
    """
    yield from _command_delay(problem)
    free, data = problem.layout.keys, [problem.tracks[i].data for i in problem.fitted]
    channels = dict.fromkeys(one.key for own in data for one in own.channels)
    for key in channels if len(channels) > 1 else ():
        if f"{key}.delay" not in free:
            yield Extension(text=f"a delay of {key}", parameters=(_delay(f"{key}.delay"),), begins=DELAYS)


def _delay(key: str) -> FitParameter:
    return FitParameter(key=key, unit="s", start=0.0, low=-1e-3, high=LATEST)


def _sensors(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that free zeros and gains of channels, shared by all recordings, or separate for each recording."""
    free, names = problem.layout.keys, [track.data.name for track in problem.tracks]
    own = {entry.key for entry in problem.layout.entries if entry.track is not None}
    for part, off in differences(problem, x):
        channel = part.channel
        if part.track != problem.fitted[0] or not np.isfinite(off).all():
            continue
        key, zeroed = channel.key, channel.key.endswith(MEASURED_FROM_ZERO)
        offset, gain = _zero_and_scale(channel)
        if zeroed and offset.key not in free:
            yield Extension(text=f"a zero offset of {key}", parameters=(offset,))
        predicted = part.recorded + off
        # Do not free the scale if the prediction is nearly constant: no scale within its bounds makes it as large as the
        # recorded motion.
        moves = float(np.ptp(predicted)) > 1e-3 * float(np.ptp(part.recorded))
        if zeroed and moves and not {offset.key, gain.key} & free:
            slope, zero = np.polyfit(predicted, part.recorded, 1).tolist()
            if 1e-3 < slope < 1e3:
                begin = (zero / offset.size, -float(np.log(slope)))
                yield Extension(text=f"a different scale and zero of {key}", parameters=(offset, gain), begins=(begin,))
        for name, parameter in (("zero", offset), ("gain", gain)):
            # A shared parameter stays free; in addition each recording except the first gets a separate value.
            if len(problem.fitted) > 1 and (zeroed or name == "gain") and parameter.key not in own:
                tracks = problem.fitted[parameter.key in free :]
                separate = tuple(parameter.of_recording(track, names) for track in tracks)
                yield Extension(text=f"a {name} of {key} in each recording", parameters=separate)


def _zero_and_scale(signal: RecordedSignal) -> tuple[FitParameter, FitParameter]:
    """The zero of a recorded channel or command, and its scale."""
    offset = FitParameter(key=f"{signal.key}.offset", unit=signal.unit, start=0.0)
    return offset, FitParameter(key=f"{signal.key}.gain", unit="1", start=1.0, low=1e-3, high=1e3, logarithmic=True)


def _commands(problem: FitProblem, _: Array) -> Iterator[Extension]:
    """Extensions that free the zeros of commands, such as that of an amplifier, and the scales of torques, voltages and
    currents: a drive computes its torque from a nominal torque constant, and a voltage sags.
    """
    yield from _command_zeros(problem)
    for command in _played(problem):
        gain = _zero_and_scale(command)[1]
        if gain.key not in problem.layout.keys and command.unit in EFFORTS:
            yield Extension(text=f"a different scale of {command.key}", parameters=(gain,))


def _modes(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions with a second mode: the link behind a joint with a recorded position is elastic."""
    track, lowest = problem.tracks[0], MODES[0] * problem.motion
    sensed = {channel.key for i in problem.fitted for channel in problem.tracks[i].channels}
    for joint in track.door.joints if lowest else ():
        if f"{joint}.link_position" not in sensed or joint.endswith(BEND) or f"{joint}{BEND}" in track.door.joints:
            continue
        # The first recording tells whether the link can be elastic, since all recordings show the same robot.
        if (elastic := track.elastic(joint, lowest)) is None:
            continue
        known, link = parameters_of(elastic.door.robot, (), {}), track.door.robot.joint(joint).child
        inertia = f"{link}{TIP}.{axis_inertia(track.door.robot, joint)}"
        spring = known[f"{joint}{BEND}.passive_stiffness"]
        # A small second body hardly changes the rest of the motion; its frequency follows from its inertia and the spring.
        begins = tuple((SMALL, SMALL + 2.0 * float(np.log(factor / MODES[0]))) for factor in MODES)
        yield Extension(
            text=f"a second mode, such as an elastic {link},", parameters=(known[inertia], spring), begins=begins,
            elastic=(joint, lowest), restepped=True,
        )  # fmt: skip


def _robot(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that free fixed springs, friction, damping, hysteresis, and limits of motors and springs."""
    track, values, free = problem.tracks[0], problem.layout.table(x, 0), problem.layout.keys
    known, moves = parameters_of(track.door.robot, (), {}), track.scenario.engine != "bench"
    for j, drive in enumerate(track.door.drives):
        joint, mode = drive.name, drive.mode
        spring, motor = mode is not None and mode.spring, mode is not None and mode.motor
        for name, text, starts in LAWS if spring else ():
            if (law := known.get(f"{joint}.{name}")) is not None and law.key not in free:
                yield Extension(text=f"{text} of {joint}", parameters=(law,), begins=starts)
        mass = known.get(f"{drive.joint.child}.mass")
        if mass is not None and mass.logarithmic and mass.key not in free and moves and any(track.scenario.gravity):
            yield Extension(text=f"a different mass of {drive.joint.child}", parameters=(mass,), begins=MASSES)
        for name, text, possible in (
            ("passive_stiffness", "a passive spring", moves and not spring and drive.joint.spring_stiffness == 0.0),
            ("hysteresis_torque", "hysteresis of the springs", spring), ("damping", "another damping", moves),
            ("friction", "another friction", moves), ("stribeck_friction", "static friction", moves),
            ("motor_1_friction_torque", "another motor friction", motor), ("motor_1_damping", "another motor damping", motor),
        ):  # fmt: skip
            parameter = known.get(f"{joint}.{name}")
            if possible and parameter is not None and parameter.key not in free:
                beside = f"{joint}.{BESIDE.get(name, '')}"
                more = (known[beside],) if beside in known.keys() - free else ()
                # If the friction is so large that the joint does not move, the search starts without friction.
                begins = tuple((*(0.0 for _ in more), begin) for begin in (1.0, parameter.place(0.0)))
                yield Extension(text=f"{text} of {joint}", parameters=(*more, parameter), begins=begins)
        gain, damping = known.get(f"{joint}.controller_1_derivative"), f"{joint}.motor_1_damping"
        if gain is not None and gain.key not in free and damping in free and values[damping] < VANISHED * gain.start:
            # Damping of the motor acts like the derivative gain. The estimated damping is nearly 0, so the gain is too large.
            ties = tied_to(gain.key, _of_other_motors(drive, "controller_1_derivative"))
            text = f"a smaller derivative gain of the controller of {joint}"
            starts = gain.place(0.0), gain.place(0.5 * gain.start)
            yield Extension(text=text, parameters=(gain,), ties=ties, begins=starts)
        limited = [(f"motor_1_{name}", f"motor_1_max_{name}") for name in ("torque", "velocity") if drive.dynamic_motors]
        for quantity, name in (*limited, *([("deflection", "max_deflection")] if spring else [])):
            key, reached = f"{joint}.{name}", _largest(problem, x, (j, quantity))
            if key in known and key not in free and reached > 0.0:
                # All motors of a joint share the limit.
                ties = tied_to(key, _of_other_motors(drive, name))
                limit = replace(known[key], start=reached, low=1e-3 * reached, high=4.0 * reached, logarithmic=True)
                text, factors = f"a limit {name} of {joint}", tuple(np.log(LIMIT_FACTORS))
                yield Extension(text=text, parameters=(limit,), ties=ties, begins=factors)


def _of_other_motors(drive: SteppedJoint, name: str) -> Iterator[str]:
    """Keys of a parameter of motor 1, such as `motor_1_max_torque`, at the other motors of the joint; none for a parameter that
    belongs to no motor.
    """
    for i in range(2, drive.dynamic_motors + 1) if "_1_" in name else ():
        yield f"{drive.name}.{name.replace('_1_', f'_{i}_')}"


def _largest(problem: FitProblem, x: Array, quantity: tuple[int, str]) -> float:
    """Largest size of a simulated quantity (index of joint, name) in all fitted recordings; 0 if all simulations diverge."""
    played = ((problem.tracks[i], problem.layout.table(x, i)) for i in problem.fitted)
    found = [track.series(values, problem.playing, [quantity]) for track, values in played]
    return max((float(np.abs(series).max()) for series in found if series is not None), default=0.0)


def _wrong_ties(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that free a tied parameter."""
    entries = {entry.key: entry for entry in problem.layout.entries if entry.track is None}
    for tie in problem.layout.ties:
        if tie.to in entries and not tie.key.endswith(".delay"):
            other = f"{'' if tie.factor == 1.0 else f'{tie.factor:g} * '}{tie.to}"
            parameter = replace(entries[tie.to], key=tie.key, start=problem.layout.table(x, 0)[tie.key])
            yield Extension(text=f"{tie.key} other than {other}, to which it is tied", parameters=(parameter,), untied=tie)


def contradicted_ties(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on ties that the recordings contradict: without the tie, the fit is significantly better, and the parameters
    differ by more than a few percent.
    """
    if not problem.layout.ties:
        return
    optimum, before = Optimum(problem, x), mean_square(problem, x)
    promises = [optimum.promise(extension) for extension in _wrong_ties(problem, x)]
    for promise in sorted(promises, key=lambda one: -one.share)[:TRIED]:
        if not promise.share:
            break
        (parameter,), wider = promise.extension.parameters, promise.problem
        # Fit the extension: to first order it may promise an improvement that no value of the parameter gives, as with friction
        # that keeps a joint at rest.
        found = solve(wider, promise.start, rounds=ROUNDS, tolerance=1e-5)
        apart = abs(parameter.value(float(found[-1])) - parameter.start) / (abs(parameter.start) or parameter.size)
        better = is_significant(before, mean_square(wider, found), independent_samples(optimum.residuals))
        if better and apart > CLOSE:
            yield f"{promise.extension.text.replace(' other than ', ' is not ')}: they differ by {percent(apart)}"


def _varying_springs(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on springs whose stiffness varies with the amplitude: backlash is missing, or the spring law is wrong."""
    left, numbers = residuals(problem, x), problem.blocks(PARTS)
    for i, entry in enumerate(problem.layout.entries):
        if not entry.logarithmic or not any(word in entry.name for word in SPRINGS):
            continue
        slope = slopes_along(problem, x, [i], base=left)[:, 0]
        sizes, pulls, counts = (np.bincount(numbers, one) for one in (slope**2, slope * left, np.ones(len(left))))
        known = sizes > 25.0
        if known.sum() < 6:
            continue
        reach, moves = np.sqrt(sizes[known] / counts[known]), -pulls[known] / sizes[known]
        trend = float(np.corrcoef([np.argsort(np.argsort(one)) for one in (reach, moves)])[0, 1])
        extent, deviation = float(np.ptp(moves)), float(np.median(sizes[known] ** -0.5))
        # The correlation must be stronger than chance explains, and the stiffness must vary by more than its errors.
        if abs(trend) > max(TREND, CHANCE / (known.sum() - 1) ** 0.5) and extent > max(6.0 * deviation, 0.02):
            # With backlash the stiffness is k (1 - width / A) at amplitude A; a hardening spring's stiffness grows with A^2.
            backlash = trend > 0.0 and abs(_correlation(1.0 / reach, moves)) > abs(_correlation(reach**2, moves))
            joint = entry.key.rpartition(".")[0]
            law = f"backlash is missing (--free {joint}.backlash)" if backlash else "the spring's law is wrong"
            way = "falls" if trend < 0.0 else "grows"
            yield f"{entry.name} {way} with the amplitude: parts of the record differ by {100 * extent:.0f} %; {law}"


def _oscillations(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on large oscillations of the residuals at frequencies that do not occur in any command."""
    for part, left in differences(problem, x):
        hertz = frequency(part.time, left) if float(np.std(left)) > RINGING * float(np.std(part.recorded)) else 0.0
        driven = [frequency(one.time, one.values) for one in problem.tracks[part.track].data.commands]
        if hertz and all(abs(one - hertz) > DRIVEN * hertz for one in driven):
            yield f"{part.channel.key}: {missing_mode(hertz)}"


def _correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])


for name, cause in {
    "sensors": Cause(title="zeros and scales of sensors, such as a gear ratio", extensions=_sensors),
    "commands": Cause(title="zeros of commands, scales of torques, voltages and currents", extensions=_commands),
    "robot": Cause(
        title="passive springs, friction, damping, static friction, hysteresis, backlash, cubic terms and dampers of springs, "
        "limits of motors and of deflections, derivative gains of controllers, masses of links",
        extensions=_robot,
    ),
    "delays": Cause(title="a delay of the commands, or of a sensor", extensions=_delays),
    "ties": Cause(title="wrong ties", extensions=_wrong_ties),
    "modes": Cause(title="an elastic link: a trial robot has two bodies with a spring between them", extensions=_modes),
}.items():
    CAUSES.own(name, cause)
