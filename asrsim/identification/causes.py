"""Possible causes of a misfit: extensions of the model that are tried together, and reported with the error that would remain.

`CAUSES` is the registry. Users add further causes: `CAUSES.add("integral", Cause(title="an integral", extensions=wider))` in
a plugin file, or an entry point in the group "asrsim.causes".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from asrsim.errors import AsrsimError, InputError
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
    exchanged,
    extended,
    held_out,
    is_significant,
    pruned,
    tied_to,
    with_all,
)
from asrsim.identification.flexible import BEND, TIP, axis_inertia
from asrsim.identification.judge import ENOUGH, FOLLOWED, explains, missing_mode
from asrsim.identification.noise import frequency, independent_samples
from asrsim.identification.parameters import CLOCK, LATEST, FitParameter, parameters_of
from asrsim.identification.problem import (
    FitProblem,
    differences,
    mean_square,
    residuals,
    robust_mean_square,
    slopes_along,
    solve,
)
from asrsim.identification.result import CLOSE
from asrsim.identification.search import Stopped, level_by_level
from asrsim.identification.task import Tie
from asrsim.plugins import plugin_fault
from asrsim.registry import Registry, result_fault
from asrsim.samples import Array

EXPLAINED = 0.9
"""The search for causes ends if the suspected causes explain this fraction of the squared misfit beyond the noise. The RMS
error beyond the noise then falls to a third. `benchmarks/causes.py` tests this threshold and the other thresholds of this file
that state no source: with them, `asrsim identify` names each of eleven simulated effects first, and suspects nothing if the
model is right.
"""
NOISE = 2.0
"""The suspected causes count as a complete explanation if the mean square residual, in units of the variance of the recorded
noise, is below this limit. The model error is then at most as large as the noise.
"""
RIVALS = 2
"""Largest number of equally likely causes that a message names in addition to the suspected cause. More names would make the
message hard to read.
"""
MOST, ROUNDS = 3, 15
"""MOST: largest number of causes in one suggestion, and largest number of rounds of `--adopt`.
ROUNDS: largest number of steps of a search with a cause. Searches that end by their tolerance take 5 to 15 steps.
"""
MEASURED_FROM_ZERO = ("position", "deflection", "torque_1", "torque_2", "link_torque")
"""Endings of the names of quantities whose sensors may have a zero offset."""
EFFORTS = ("N m", "N", "V", "A")
"""Units of commands whose scale may be unknown, and of channels whose scale may differ between recordings."""
LIMIT_FACTORS = (2.0, 0.5, 0.1, 0.02)
"""Start values of a limit, as multiples of the largest simulated torque or speed of the motor, or of the largest simulated
deflection of the spring. The simulation does not reach the first limit. Each start value is a quarter or a fifth of the
previous start value. The start value nearest to the true limit is therefore wrong by a factor of at most 2.3.
"""
LAWS = (
    ("spring_cubic", "a cubic term in the spring", (1.0, -1.0)),
    ("backlash", "backlash", (1.0, 5.0)),
    ("spring_damping", "a damper parallel to the springs", (1.0,)),
)
"""Parameters of spring laws that are tried: name of the parameter, words for its effect, and start values, in units of
`FitParameter.size`. The cubic term starts at 10 and -10 N m/rad^3. Backlash starts at 0.01 and 0.05 rad, since a search that
starts at a small backlash does not find a large backlash. The damping starts at 0.02 N m s/rad.
"""
MODES = (1.5, 3.0, 6.0)
"""Frequencies of a second mode that are tried, in units of the bandwidth of the motion. The lowest frequency is so close to the
bandwidth that the motion excites the mode strongly.
"""
SMALL = float(np.log(0.2))
"""Logarithm of the inertia of the second body at the start of a trial, relative to its default inertia, 30 % of the link. At
the start the second body has 6 % of the link's inertia, so that the first mode hardly changes.
"""
VANISHED = 0.02
"""The damping of a motor counts as 0 if it is below this fraction of the derivative gain of its controller."""
MASSES = (float(np.log(1.3)), float(np.log(0.75)))
"""Logarithms of the factors of a link's mass that are tried. The link may carry a load, or it may be lighter than the robot
file states.
"""
TREND, CHANCE, PARTS = 0.6, 2.9, 12
"""TREND: a message reports that a spring's stiffness depends on the deflection if their rank correlation exceeds this value.
CHANCE: the rank correlation must also exceed this multiple of its standard deviation for randomly ordered parts. Chance alone
exceeds this multiple once in 270 times.
PARTS: number of parts of a recording in each of which the stiffness is estimated.
"""
RINGING, DRIVEN = 0.1, 0.3
"""RINGING: an oscillation of the residuals is reported if their standard deviation exceeds this fraction of the standard
deviation of the recorded motion.
DRIVEN: a command does not cause an oscillation if the two frequencies differ by more than this fraction.
"""
LATE = (2.0, 25.0, 50.0)
"""Delays that are tried, in typical sizes: 4, 50 and 100 ms. A search that starts at a small delay does not find a large delay.
"""
BESIDE = {"hysteresis_torque": "hysteresis_deflection", "stribeck_friction": "stribeck_velocity"}
"""Second unknown parameter of an effect, by the parameter that states the effect's size. For hysteresis it is the deflection
over which the hysteresis torque builds up; for static friction, the speed at which the additional friction fades.
"""
SPRINGS = ("spring_stiffness", "spring_k", "passive_stiffness", ".k")
"""Words in the names of the parameters that are stiffnesses of springs."""


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
    """Sentence on the suspected effects. Empty if no effect is suspected although models with effects have smaller errors."""
    trials: tuple[Mapping[str, float], ...] = ()
    """For each tried model with a smaller error: its estimates, by parameter name. The model with the suspected effects comes
    last.
    """
    model: tuple[FitProblem, Array] | None = None
    """Problem with the suspected effects, and its estimated parameter vector. None if no parameters of the robot or of a
    recording describe these effects.
    """
    added: tuple[str, ...] = ()
    """Names of the parameters of the suspected effects."""
    rivals: tuple[Mapping[str, float], ...] = ()
    """For each model with equally likely effects: its estimates, by parameter name."""
    remarks: tuple[str, ...] = ()
    """Sentences on causes of a user or of an installed package that could not be tried."""


def missing_causes(problem: FitProblem, x: Array) -> Iterator[Suspicion]:
    """Yield the effects that the model may lack. problem: problem whose residuals are weighted by the recorded noise; x:
    estimated parameter vector.
    """
    # Give the model without further effects as many steps as the models with further effects. Otherwise the improvement by a
    # longer search would be ascribed to an effect.
    start = np.zeros(len(x))
    x = min((x, *(solve(problem, one, rounds=ROUNDS) for one in (x, start))), key=lambda one: mean_square(problem, one))
    base, least = mean_square(problem, x), robust_mean_square(problem, x)
    # Residuals below the estimated noise may still be correlated, so count at least a fraction of their mean square as misfit.
    excess = max(base - 1.0, (1.0 - FURTHER) * base)
    target = base - EXPLAINED * excess
    found, trials = Extended((), problem, x, least), list[Extended]()
    alone, faults = found, {f"{one}. It was not tried": None for one in CAUSES.broken()}
    kinds = [partial(_tried, faults, name) for name in CAUSES]
    for first in _beginnings(alone, start):
        there = extended(
            first.problem, first.x, kinds, chosen=first.chosen, most=MOST, rounds=ROUNDS, least=least,
            enough=lambda wider, there: mean_square(wider, there) <= target,
        )  # fmt: skip
        trials += there.trials
        there = pruned(problem, there, rounds=ROUNDS)
        found, _ = best_predictions(sorted((found, there), key=lambda one: mean_square(one.problem, one.x)))
        if mean_square(found.problem, found.x) < NOISE:
            break
    if found.chosen and mean_square(found.problem, found.x) <= base - MUCH * excess:
        found = exchanged(problem, found, kinds, rounds=ROUNDS)
    found = _with_either_command(found)
    explained, rest = (problem, x), mean_square(found.problem, found.x)
    # Effects of a machine improve predictions of its other motions, too. Parameters that only follow errors of a wrong model do
    # not.
    predicts = held_out(found.problem, found.x) <= held_out(problem, x)
    if found.chosen and rest <= base - MUCH * excess and predicts:
        more = "" if rest <= target else "; the model lacks further effects"
        explained = found.problem, found.x
        yield Suspicion(
            text=_suspected(found, percent((rest / base) ** 0.5), faults) + more,
            trials=tuple(one.estimates for one in (*trials, *found.rivals, found)),
            model=None if any(cause.elastic for cause in found.chosen) else explained,
            added=tuple(one.name for cause in found.chosen for one in cause.parameters),
            rivals=tuple(one.estimates for one in found.rivals),
        )
    # If no cause is suspected, report only the trial models that Schwarz's criterion prefers to the model without effects.
    elif likely := [one.estimates for one in trials if one.criterion(one.samples) < alone.criterion(one.samples)]:
        yield Suspicion(trials=tuple(likely))
    for text in chain(_oscillations(*explained), _varying_springs(*explained)):
        yield Suspicion(text=text)
    if faults:
        yield Suspicion(remarks=tuple(faults))


def _beginnings(alone: Extended, start: Array) -> Iterator[Extended]:
    """Problems and estimates at which searches for missing effects begin: the estimate without effects; the problem with zero
    offsets and a delay of the commands; and the start values, since the fit may have moved parameters to values at which
    nothing has an effect.
    """
    yield alone
    yield _with_command_errors(alone.problem)
    yield Extended((), alone.problem, start, robust_mean_square(alone.problem, start))


def _with_either_command(found: Extended) -> Extended:
    """The extended problem, or the same problem with commands that are not held, if its error is then smaller. A command that
    is played as a staircase may have imitated the effects that the problem now has.
    """
    if not found.chosen or not found.problem.playing.staircases:
        return found
    smooth = found.problem.played(frozenset())
    x = solve(smooth, found.x, rounds=ROUNDS)
    other = replace(found, problem=smooth, x=x, cost=robust_mean_square(smooth, x))
    return min((found, other), key=lambda one: mean_square(one.problem, one.x))


def _of_asrsim(function: Callable[..., Any]) -> bool:
    return str(getattr(function, "__module__", "")).partition(".")[0] == "asrsim"


def _fault_of(function: Callable[..., Any], error: Exception) -> str:
    """Message of an exception that a function of a user raised, with file and line."""
    if isinstance(error, AsrsimError):
        return str(error)
    return str(plugin_fault(error) or result_fault(function, f"raised {type(error).__name__}: {error}"))


def _tried(faults: dict[str, None], name: str, problem: FitProblem, x: Array) -> list[Extension]:
    """Extensions that a cause proposes. A user's cause that fails proposes nothing, and `faults` gets a sentence on it."""
    function = CAUSES.get(name).extensions
    try:
        return [*_proposed(name, problem, x)]
    except Stopped:
        raise
    except Exception as error:
        if _of_asrsim(function):
            raise
        faults[f"the cause '{name}' was not tried: {_fault_of(function, error)}"] = None
        return []


def _proposed(name: str, problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that the cause with this name proposes. Raises InputError if an extension frees a parameter that does not
    exist.
    """
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
        free = {own.key for own in (*problem.layout.entries, *one.parameters)}
        for field, is_valid, form in (
            ("text", isinstance(one.text, str), "a text"),
            ("size", one.size is None or callable(one.size), "a function of the parameters' values that returns a text"),
            ("begins", isinstance(one.begins, Sequence) and not isinstance(one.begins, str), "a tuple of start values"),
            (
                "ties",
                isinstance(one.ties, tuple)
                and all(isinstance(tie, Tie) and tie.to in free and tie.key in problem.known for tie in one.ties),
                "a tuple of asrsim.identification.task.Tie to free parameters",
            ),
            ("untied", one.untied is None or one.untied in problem.layout.ties, "a tie of `problem.layout.ties`"),
            ("elastic", one.elastic is None or _is_mode(one.elastic, problem), "a joint and a frequency in rad/s"),
            ("share", isinstance(one.share, int | float) and 0.0 < one.share <= 1.0, "a number above 0 and up to 1"),
            ("excess", isinstance(one.excess, int | float) and 0.0 < one.excess <= 1.0, "a number above 0 and up to 1"),
        ):
            if not is_valid:
                told = f"the cause '{name}' must give `{field}` as {form}; it gives {getattr(one, field)!r}"
                raise result_fault(function, told)
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


def _is_mode(elastic: Any, problem: FitProblem) -> bool:
    joints = problem.tracks[0].door.joints
    return isinstance(elastic, tuple) and len(elastic) == 2 and elastic[0] in joints and isinstance(elastic[1], int | float)


def _suspected(found: Extended, rest: str, faults: dict[str, None]) -> str:
    """Sentence on suspected causes. It states their sizes, and the options of `asrsim identify` that add them to the problem.
    rest: words for the error that remains if the causes are added.
    """
    texts, options, links = [], list[str](), []
    values = iter(_last_values(found, sum(len(cause.parameters) for cause in found.chosen)))
    for cause in found.chosen:
        texts.append(_with_size(cause, values, faults))
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
    return f"{' and '.join(texts)} {verb} the error to {rest}{added}{''.join(_rivals(found, faults))}"


def _rivals(found: Extended, faults: dict[str, None]) -> Iterator[str]:
    """Ends of the sentence on suspected causes: for each suspected cause, the other causes that explain the recordings equally
    well.
    """
    for i, cause in enumerate(found.chosen):
        others = found.chosen[:i] + found.chosen[i + 1 :]
        likely = [one for one in found.rivals if one.chosen[:-1] == others][:RIVALS]
        names = []
        for one in likely:
            other = one.chosen[-1]
            ways = " ".join(dict.fromkeys(_options(one, other)))
            names.append(
                _with_size(other, iter(_last_values(one, len(other.parameters))), faults) + (f" ({ways})" if ways else "")
            )
        if names:
            yield f"; equally likely instead of {cause.text}: {', or '.join(names)}"


def _last_values(found: Extended, count: int) -> list[float]:
    """Values of the last `count` parameters of an extended problem."""
    return found.problem.layout.values(found.x).tolist()[-count:] if count else []


def _with_size(cause: Extension, values: Iterator[float], faults: dict[str, None]) -> str:
    """Text of a cause with the size of its effect. The function `size` of the cause gives the size; without this function, the
    size is the value of the cause's last parameter. values: iterator over the values of the cause's parameters, followed by the
    values of the parameters of later causes.
    """
    text, own = cause.text, [next(values) for _ in cause.parameters]
    if cause.size is not None:
        try:
            if isinstance(words := cause.size(*own), str):
                return f"{text} ({words})"
            raise result_fault(cause.size, f"it must return a text; it returns {words!r}")
        except Exception as error:
            if _of_asrsim(cause.size):
                raise
            faults[f"`size` of the cause '{text}' was not used: {_fault_of(cause.size, error)}"] = None
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
    """Sentences on joints whose simulated motion under the controller does not follow the recorded motion, although the torque
    of their drive was recorded.
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
    """Sentences on motors whose recorded motion the model of their drive does not explain. Such an error of the drive hides
    errors of springs and links.
    """
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


def _with_command_errors(problem: FitProblem) -> Extended:
    """Problem with zero offsets and a delay of the commands, and its estimate from a search that begins at the start values.

    A wrong delay or zero offset changes the estimates of inertia and friction, and friction that falls with speed imitates
    both. Therefore a search without them ends far from the estimates of the right model.
    """
    chosen, delays = (*_command_zeros(problem), *_command_delay(problem)), _delay_keys(problem)
    wider = with_all(problem, chosen)
    late = np.array([one.key in delays for one in wider.layout.entries])
    x = level_by_level(wider, [late * begin for begin in (0.0, *LATE)])
    return Extended(chosen, wider, x, robust_mean_square(wider, x))


def _delay_keys(problem: FitProblem) -> list[str]:
    """Keys of the delays of all commands of the fitted recordings."""
    return [f"{one.key}.delay" for one in _played(problem)]


def _command_delay(problem: FitProblem) -> Iterator[Extension]:
    """Extension that frees a common delay of all commands; no extension if a delay is free."""
    delays = _delay_keys(problem)
    if delays and not any(key.endswith(".delay") or key == CLOCK for key in problem.layout.keys):
        first, *others = delays
        ties = tied_to(first, others)
        yield Extension(text="a delay of the commands", parameters=(_delay(first),), ties=ties, begins=LATE)


def _command_zeros(problem: FitProblem) -> Iterator[Extension]:
    """Extensions that free the zero offsets of commands, such as the offset of an amplifier."""
    for command in _played(problem):
        offset, _ = _zero_and_scale(command)
        if offset.key not in problem.layout.keys:
            yield Extension(text=f"a zero offset of {command.key}", parameters=(offset,))


def _played(problem: FitProblem) -> Iterable[RecordedSignal]:
    """Commands of the fitted recordings, one for each key."""
    return {one.key: one for i in problem.fitted for one in problem.tracks[i].data.commands}.values()


def _delays(problem: FitProblem, _: Array) -> Iterator[Extension]:
    """Extensions that free a common delay of all commands, or the delay of one channel. The sensor of this channel may be
    slower than other sensors.
    """
    yield from _command_delay(problem)
    free, data = problem.layout.keys, [problem.tracks[i].data for i in problem.fitted]
    channels = dict.fromkeys(one.key for own in data for one in own.channels)
    for key in channels if len(channels) > 1 else ():
        if f"{key}.delay" not in free:
            yield Extension(text=f"a delay of {key}", parameters=(_delay(f"{key}.delay"),), begins=LATE)


def _delay(key: str) -> FitParameter:
    return FitParameter(key=key, unit="s", start=0.0, low=-1e-3, high=LATEST)


def _sensors(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that free zero offsets and gains of channels. All recordings share the value, or each recording has a separate
    value. Only gains of torques, forces, voltages and currents may differ between recordings.
    """
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
        # Do not free the scale if the prediction is nearly constant: no scale within the bounds would make the prediction as
        # large as the recorded motion.
        moves = float(np.ptp(predicted)) > 1e-3 * float(np.ptp(part.recorded))
        if zeroed and moves and not {offset.key, gain.key} & free:
            slope, zero = np.polyfit(predicted, part.recorded, 1).tolist()
            if 1e-3 < slope < 1e3:
                begin = (zero / offset.size, -float(np.log(slope)))
                yield Extension(text=f"a different scale and zero offset of {key}", parameters=(offset, gain), begins=(begin,))
        for name, parameter in (("zero offset", offset), ("gain", gain)):
            # If the shared parameter is free, it stays free and serves the first recording; each other recording gets a
            # separate value. The scale of an encoder is the same in all recordings.
            varies = zeroed if name == "zero offset" else channel.unit in EFFORTS
            if len(problem.fitted) > 1 and varies and parameter.key not in own:
                tracks = problem.fitted[parameter.key in free :]
                separate = tuple(parameter.of_recording(track, names) for track in tracks)
                yield Extension(text=f"a {name} of {key} in each recording", parameters=separate)


def _zero_and_scale(signal: RecordedSignal) -> tuple[FitParameter, FitParameter]:
    """Parameters for the zero offset and for the scale of a recorded channel or command."""
    offset = FitParameter(key=f"{signal.key}.offset", unit=signal.unit, start=0.0)
    return offset, FitParameter(key=f"{signal.key}.gain", unit="1", start=1.0, low=1e-3, high=1e3, logarithmic=True)


def _commands(problem: FitProblem, _: Array) -> Iterator[Extension]:
    """Extensions that free the zero offsets of commands, such as the offset of an amplifier, and the scales of torque, voltage
    and current commands. The scale may be wrong since a drive computes its torque from a nominal torque constant, or since a
    supply voltage sags.
    """
    yield from _command_zeros(problem)
    for command in _played(problem):
        gain = _zero_and_scale(command)[1]
        if gain.key not in problem.layout.keys and command.unit in EFFORTS:
            yield Extension(text=f"a different scale of {command.key}", parameters=(gain,))


def _modes(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that add a second mode to the model: the link behind a joint becomes elastic. The position of the joint must
    be recorded.
    """
    track, lowest = problem.tracks[0], MODES[0] * problem.motion
    sensed = {channel.key for i in problem.fitted for channel in problem.tracks[i].channels}
    for joint in track.door.joints if lowest else ():
        if f"{joint}.link_position" not in sensed or joint.endswith(BEND) or f"{joint}{BEND}" in track.door.joints:
            continue
        # Test only with the first recording whether the link can be elastic, since all recordings show the same robot.
        if (elastic := track.elastic(joint, lowest)) is None:
            continue
        known, link = parameters_of(elastic.door.robot, (), {}), track.door.robot.joint(joint).child
        inertia = f"{link}{TIP}.{axis_inertia(track.door.robot, joint)}"
        spring = known[f"{joint}{BEND}.passive_stiffness"]
        # A small second body hardly changes the rest of the motion. The frequency of the second mode depends on the body's
        # inertia and on the spring, so change both together.
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
            ("load_friction", "friction that grows with the load", moves),
            ("armature", "another inertia of the rotor", moves),
            ("motor_1_friction_torque", "another motor friction", motor), ("motor_1_damping", "another motor damping", motor),
            ("motor_1_load_friction", "motor friction that grows with the load", motor),
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
            # The damping of the motor has the same effect as the derivative gain. Since the estimated damping is nearly 0, the
            # gain is probably too large.
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
    """Keys of the same parameter of the joint's other motors. name: a parameter of motor 1, such as `motor_1_max_torque`. No
    keys if the parameter belongs to no motor.
    """
    for i in range(2, drive.dynamic_motors + 1) if "_1_" in name else ():
        yield f"{drive.name}.{name.replace('_1_', f'_{i}_')}"


def _largest(problem: FitProblem, x: Array, quantity: tuple[int, str]) -> float:
    """Largest magnitude of a simulated quantity in all fitted recordings; 0 if all simulations diverge. quantity: index of the
    joint, and name of the quantity.
    """
    played = ((problem.tracks[i], problem.layout.table(x, i)) for i in problem.fitted)
    found = [track.series(values, problem.playing, [quantity]) for track, values in played]
    return max((float(np.abs(series).max()) for series in found if series is not None), default=0.0)


def _wrong_ties(problem: FitProblem, x: Array) -> Iterator[Extension]:
    """Extensions that free a tied parameter."""
    entries = {entry.key: entry for entry in problem.layout.entries if entry.track is None}
    for tie in problem.layout.ties:
        if tie.to in entries and not tie.key.endswith(".delay"):
            parameter = replace(entries[tie.to], key=tie.key, start=problem.layout.table(x, 0)[tie.key])
            text = f"a value of {tie.key} other than {_multiple(tie)}, to which it is tied,"
            yield Extension(text=text, parameters=(parameter,), untied=tie)


def _multiple(tie: Tie) -> str:
    """The multiple of another parameter to which a parameter is tied, such as `0.5 * joint_1.motor_1_damping`."""
    return tie.to if tie.factor == 1.0 else f"{tie.factor:g} * {tie.to}"


def contradicted_ties(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on ties that the recordings contradict. A tie is contradicted if the fit without it is significantly better,
    and if the two parameters then differ by more than 5 %.
    """
    if not problem.layout.ties:
        return
    optimum, before = Optimum(problem, x), mean_square(problem, x)
    promises = [optimum.promise(extension) for extension in _wrong_ties(problem, x)]
    for promise in sorted(promises, key=lambda one: -one.share)[:TRIED]:
        if not promise.share:
            break
        (parameter,), wider = promise.extension.parameters, promise.problem
        # Fit the extension. The linearised problem may predict an improvement that no value of the parameter achieves, for
        # example if friction keeps a joint at rest.
        found = solve(wider, promise.start, rounds=ROUNDS, tolerance=1e-5)
        apart = abs(parameter.value(float(found[-1])) - parameter.start) / (abs(parameter.start) or parameter.size)
        better = is_significant(before, mean_square(wider, found), independent_samples(optimum.residuals))
        if better and apart > CLOSE and (tie := promise.extension.untied) is not None:
            yield f"{parameter.key} is tied to {_multiple(tie)}, but they differ by {percent(apart)}"


def _varying_springs(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on springs whose estimated stiffness varies with the amplitude. The model then lacks backlash, or its spring
    law is wrong.
    """
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
        # The correlation must be stronger than by chance, and the stiffness must vary by more than its standard error.
        if abs(trend) > max(TREND, CHANCE / (known.sum() - 1) ** 0.5) and extent > max(6.0 * deviation, 0.02):
            # With backlash, the effective stiffness at amplitude A is k (1 - width / A). The effective stiffness of a hardening
            # spring grows with A^2.
            backlash = trend > 0.0 and abs(_correlation(1.0 / reach, moves)) > abs(_correlation(reach**2, moves))
            joint = entry.key.rpartition(".")[0]
            law = f"backlash is missing (--free {joint}.backlash)" if backlash else "the spring's law is wrong"
            way = "falls" if trend < 0.0 else "grows"
            parts = f"estimates from parts of the recording differ by {100 * extent:.0f} %"
            yield f"{entry.name} {way} with the amplitude: {parts}; {law}"


def _oscillations(problem: FitProblem, x: Array) -> Iterator[str]:
    """Sentences on large oscillations of the residuals whose frequency occurs in no command."""
    for part, left in differences(problem, x):
        hertz = frequency(part.time, left) if float(np.std(left)) > RINGING * float(np.std(part.recorded)) else 0.0
        driven = [frequency(one.time, one.values) for one in problem.tracks[part.track].data.commands]
        if hertz and all(abs(one - hertz) > DRIVEN * hertz for one in driven):
            yield f"{part.channel.key}: {missing_mode(hertz)}"


def _correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])


for name, cause in {
    "sensors": Cause(title="zero offsets and scales of sensors, such as a gear ratio", extensions=_sensors),
    "commands": Cause(title="zero offsets of commands, scales of torques, voltages and currents", extensions=_commands),
    "robot": Cause(
        title="passive springs, friction, damping, static friction, friction that grows with the load, hysteresis, backlash, "
        "cubic terms and dampers of springs, limits of motors and of deflections, derivative gains of controllers, masses of "
        "links, inertias of rotors",
        extensions=_robot,
    ),
    "delays": Cause(title="a delay of the commands, or of a sensor", extensions=_delays),
    "ties": Cause(title="wrong ties", extensions=_wrong_ties),
    "modes": Cause(title="an elastic link: a trial robot has two bodies with a spring between them", extensions=_modes),
}.items():
    CAUSES.own(name, cause)
