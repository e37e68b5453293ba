"""Extensions of a model: they are proposed, freed together with the other parameters, refitted and scored. They are adopted
during a fit, or named as possible causes if the model does not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from asrsim.identification.combinations import percent
from asrsim.identification.keys import CLOCK, LATEST, Parameter, parameters_of
from asrsim.identification.layout import entry_of
from asrsim.identification.noise import frequency, independent_samples
from asrsim.identification.problem import (
    Problem,
    differences,
    huber,
    jacobian,
    mean_square,
    residuals,
    solve,
    with_own_substeps,
)
from asrsim.identification.task import Tie
from asrsim.robot.model import Robot
from asrsim.samples import Array

SIGNIFICANT = 20.0
"""Chi squared above which an extension is significant: noise alone exceeds it with a probability of 1e-5."""
TRIED, ADOPTED = 4, 4
"""Largest number of extensions that are refitted in a round, the most promising first; largest number of extensions that are
adopted.
"""
PROBE_STEP = 1e-3
"""Step of finite differences for a new entry of the parameter vector, in the vector's units."""
FAR_OFF = 4.0
"""Mean square residual, relative to the noise, above which a model counts as badly fitting."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extension:
    """A problem with additional free parameters at the end of its parameter vector, or with commands played as a staircase."""

    text: str = ""
    problem: Problem
    begins: Sequence[float | Sequence[float]] = ()
    """Start values of the new entries of the parameter vector, at which the effect of the extension is simulated; empty: the
    start is the optimum of the linearised problem.
    """
    restepped: bool = False
    """Whether the extension changes the required number of substeps."""
    share: float = 1.0
    """Largest fraction of the mean square error that may remain with the extension."""
    excess: float = 1.0
    """Largest fraction of the misfit beyond the noise that may remain with the extension if the model fits badly. In a badly
    fitting model any additional parameter reduces the misfit.
    """
    clear: float = 0.0
    """Remaining fraction of the mean square error below which the extension is real, even if few samples are independent."""

    def accepts(self, before: float, after: float, samples: float) -> bool:
        """Whether mean square errors before and after, from independent samples, show that the extension is real."""
        far = before > FAR_OFF and after - 1.0 > self.excess * (before - 1.0)
        significant = samples * np.log(before / max(after, 1e-300)) > SIGNIFICANT or after <= self.clear * before
        return bool(not far and after <= self.share * before and significant)


class _Optimum:
    """The parameter vector at which extensions are compared, with its residuals and derivatives."""

    def __init__(self, problem: Problem, x: Array) -> None:
        self.x, self.residuals = x, residuals(problem, x)
        self._free = np.linalg.qr(jacobian(problem, x, base=self.residuals))[0]
        """Orthonormal basis (m, n) of the changes that the free parameters can produce."""
        self._left = self.uncompensated(self.residuals)

    def uncompensated(self, change: Array) -> Array:
        """Part of a change (m,) or (m, k) of the residuals that the free parameters cannot compensate."""
        return np.asarray(change - self._free @ (self._free.T @ change))

    def promises(self, extension: Extension) -> Iterator[tuple[float, Extension, Array]]:
        """Yield, for each start of an extension, the fraction of the squared error that it would explain to first order, the
        extension with suitable substeps, and the start vector of a refit.
        """
        from scipy.optimize import lsq_linear

        new, (low, high) = range(len(self.x), len(extension.problem.layout)), extension.problem.layout.bounds
        for begin in extension.begins or [(0.0,) * len(new)]:
            start, trial = np.append(self.x, begin), extension.problem
            trial = with_own_substeps(trial, start) if extension.restepped else trial
            if extension.begins:
                change, limits = (residuals(trial, start) - self.residuals)[:, None], (np.zeros(1), np.full(1, np.inf))
            else:
                change = jacobian(trial, start, PROBE_STEP, base=self.residuals, columns=new)
                limits = np.minimum(low[new], -1e-9), high[new]
            alone = self.uncompensated(change)
            moves = lsq_linear(alone, -self._left, bounds=limits).x if alone.any() else np.zeros(alone.shape[1])
            entries = extension.problem.layout.entries[new.start :]
            if not extension.begins or not any(entry.parameter.logarithmic for entry in entries):
                # The effect is nearly linear, so the start is the optimum of the linearised problem.
                best = moves * np.asarray(begin) if extension.begins else moves
                start = np.append(self.x, np.clip(best, low[new], high[new]))
            yield self._share(alone @ moves), replace(extension, problem=trial), start

    def _share(self, change: Array) -> float:
        """Fraction of the squared error that a change of the residuals explains; 0 if the fraction is not significant."""
        before, after = float(self._left @ self._left), float(np.sum((self._left + change) ** 2))
        return 1.0 - after / before if (before - after) * len(change) > SIGNIFICANT * after else 0.0


@dataclass(frozen=True, eq=False)
class Extended:
    """A problem with the adopted extensions, and the fitted parameter vector."""

    chosen: tuple[Extension, ...]
    problem: Problem
    x: Array
    cost: float
    """Mean of the Huber loss of the residuals."""


Propose = Callable[[Problem, Array], Iterable[Extension]]


def extended(
    problem: Problem, x: Array, propose: Propose, *, enough: Callable[[Problem, Array], bool], most: int = ADOPTED,
    rounds: int = 60,
) -> Extended:  # fmt: skip
    """Problem with added extensions: in each round, the extension with the smallest remaining error is added, until `enough` is
    true or no further extension is significant.
    """
    found = Extended((), problem, x, huber(residuals(problem, x)))
    while len(found.chosen) < most and not enough(found.problem, found.x):
        optimum, proposed = _Optimum(found.problem, found.x), list(propose(found.problem, found.x))
        promised = [max(optimum.promises(one), key=lambda promise: promise[0]) for one in proposed]
        trials = []
        for share, extension, start in sorted(promised, key=lambda promise: -promise[0])[:TRIED]:
            if not share:
                continue
            there = solve(extension.problem, start, rounds=rounds, tolerance=1e-5)
            left = residuals(extension.problem, there)
            if extension.accepts(found.cost, huber(left), independent_samples(left)):
                trials.append((huber(left), extension, there))
        if not trials:
            break
        cost, extension, there = min(trials, key=lambda trial: trial[0])
        found = Extended((*found.chosen, extension), extension.problem, there, cost)
    return found


def freed(
    problem: Problem, parameters: Sequence[Parameter], ties: Sequence[Tie] = (), *, tracks: Sequence[int | None] = (None,)
) -> Problem:
    """Problem with additional free parameters. tracks: recordings that get separate values; None: all recordings
    share a value.
    """
    layout, names = problem.layout, [track.data.name for track in problem.tracks]
    entries = [entry_of(one, track, names) for one in parameters for track in tracks]
    return problem.under(replace(layout, entries=(*layout.entries, *entries), ties=(*layout.ties, *ties)))


FACTORS = (0.03, 0.3, 3.0, 30.0)
"""Start values of the pre-sliding stiffness, relative to the default of the friction law."""
MUCH = 0.5
"""Pre-sliding is adopted by a badly fitting model if at most this fraction of the misfit beyond the noise remains."""
STAIRS = 0.9
"""A command is played as a staircase if at most this fraction of the mean square error then remains."""
EXPLAINED = 0.9
"""The search for causes ends if the suspected causes explain this fraction of the squared misfit beyond the noise."""
PARTLY = 0.5
"""Causes are named if at most this fraction of the squared misfit beyond the noise remains with them."""
FURTHER = 0.8
"""A further cause is suspected if at most this fraction of the mean square error remains with this cause."""
CLEAR = 0.4
"""A cause is suspected without a test of significance if at most this fraction of the mean square error remains with it."""
CAUSES, ROUNDS = 3, 15
"""Largest number of causes in one suggestion; largest number of steps of a search with a cause."""
MEASURED_FROM_ZERO = ("position", "deflection", "torque_1", "torque_2", "link_torque")
"""Endings of the names of quantities whose sensors may have a zero offset."""
DIFFERENT = 0.05
"""Relative difference of two tied parameters above which their tie is reported as wrong."""
LIMIT_FACTORS = (0.75, 0.3, 2.0)
"""Limits that are tried, as fractions of the largest simulated torque or speed of the motor."""
TREND, CHANCE, PARTS = 0.6, 2.9, 12
"""Rank correlation of a spring's stiffness with the deflection above which the correlation is reported; smallest ratio of this
correlation to the correlation of randomly ordered parts; number of parts of a recording in which the stiffness is estimated.
"""
RINGING, DRIVEN = 0.1, 0.3
"""Size of residuals, relative to the recorded motion, above which their oscillation is reported; relative difference from the
frequency of a command above which the command does not cause the oscillation.
"""
SPRINGS = ("spring_stiffness", "spring_k", "passive_stiffness", ".k")


# -- extensions that are adopted during a fit ---------------------------------------------------------------------------------


def stairs(problem: Problem) -> Iterator[Extension]:
    """Extensions that hold each sample of a command until the next sample, as a digital controller does."""
    for key in _commands(problem, hold=False):
        if key not in problem.playing.staircases:
            yield Extension(problem=problem.played(problem.playing.staircases | {key}), begins=((),), share=STAIRS)


def presliding(problem: Problem, robot: Robot) -> Iterator[Extension]:
    """Extensions that free the pre-sliding stiffness of motor friction, for motors without this stiffness; motors with tied
    friction share the stiffness.
    """
    known, tied, taken = parameters_of(robot, (), {}), {tie.key: tie.to for tie in problem.layout.ties}, _taken(problem)
    groups: dict[str, list[str]] = {}
    for block in robot.actuators:
        for name, value in block.parameters.items():
            key = f"{block.joint}.{name}"
            if key.endswith("friction_stiffness") and value.origin == "default" and key not in taken:
                level = key.replace("stiffness", "torque")
                groups.setdefault(tied.get(level, level), []).append(key)
    for first, *others in groups.values():
        ties = [Tie(key=key, to=first) for key in others]
        wider = freed(problem, [known[first]], ties)
        yield Extension(problem=wider, begins=tuple(np.log(FACTORS)), restepped=True, excess=MUCH)


# -- causes that are named if the model does not fit --------------------------------------------------------------------------


def missing_causes(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences that name effects that the model may lack. problem: problem whose residuals are weighted by the
    recorded noise.
    """
    base = mean_square(problem, x)
    # Residuals below the estimated noise may be correlated nevertheless.
    excess = max(base - 1.0, (1.0 - FURTHER) * base)
    target = base - EXPLAINED * excess
    found = extended(
        problem, x, _causes, most=CAUSES, rounds=ROUNDS,
        enough=lambda wider, there: mean_square(wider, there) <= target,
    )  # fmt: skip
    # The fit without the causes may have moved parameters to values without effect. Therefore a search from the start values is
    # tried, too.
    again = solve(found.problem, np.append(np.zeros(len(x)), found.x[len(x) :]), rounds=ROUNDS)
    found = min((found, replace(found, x=again)), key=lambda one: mean_square(one.problem, one.x))
    rest = mean_square(found.problem, found.x)
    if found.chosen and rest <= base - PARTLY * excess:
        yield _suspected(problem, found, base, rest, complete=rest <= target)
    yield from _varying_springs(problem, x)
    yield from _oscillations(problem, x)


def _suspected(problem: Problem, found: Extended, base: float, rest: float, *, complete: bool) -> str:
    """Sentence on suspected causes, with the values and the options of `asrsim identify` that add them to the problem."""
    texts, options, before = [], [], problem.layout
    values = found.problem.layout.values(found.x).tolist()
    for cause in found.chosen:
        layout = cause.problem.layout
        new = list(zip(layout.entries, values, strict=False))[len(before) :]
        entry, value = new[-1]
        # Small delays and offsets are shown in ms and mrad.
        unit, small = entry.parameter.unit.removeprefix("1"), abs(value) < 0.1
        small &= entry.parameter.key.endswith((".delay", ".offset"))
        size = f"{1e3 * value:.3g} m{unit}" if small else f"{value:.4g} {unit}".strip()
        texts.append(cause.text if entry.track is not None else f"{cause.text} ({size})")
        options += [
            f"--free {entry.parameter.key}={value:.4g}" if entry.track is None else f"--own {entry.parameter.key}"
            for entry, value in new
        ]  # fmt: skip
        options += [f"--tie {tie.key}={tie.to}" for tie in layout.ties if tie not in before.ties]
        before = layout
    verb = "is suspected: it would bring" if len(texts) == 1 else "are suspected: together they would bring"
    flags, more = " ".join(dict.fromkeys(options)), "" if complete else "; more is missing"
    return f"{' and '.join(texts)} {verb} the error to {percent((rest / base) ** 0.5)} ({flags}){more}"


def _causes(problem: Problem, x: Array) -> Iterator[Extension]:
    """Extensions of a problem; each extension adds one possible cause of the misfit."""
    yield from _sensors(problem, x)
    yield from _robot(problem, x)
    commands = [f"{key}.delay" for key in _commands(problem)]
    if commands and not any(key.endswith(".delay") or key == CLOCK for key in _taken(problem)):
        parameter = Parameter(key=commands[0], unit="s", start=0.0, low=-1e-3, high=LATEST)
        yield _cause("a delay of the commands", problem, parameter, others=commands[1:], begins=(2.0,))
    for tie, wider in _without_ties(problem, x):
        other = f"{'' if tie.factor == 1.0 else f'{tie.factor:g} * '}{tie.to}"
        yield Extension(text=f"{tie.key} other than {other}, to which it is tied", problem=wider, share=FURTHER)


def _sensors(problem: Problem, x: Array) -> Iterator[Extension]:
    """Extensions that free zeros and gains of channels, shared by all recordings, or separate for each recording."""
    free = _taken(problem)
    own = {entry.parameter.key for entry in problem.layout.entries if entry.track is not None}
    channels = problem.tracks[problem.fitted[0]].channels
    for channel, part, off in zip(channels, problem.parts, differences(problem, x), strict=False):
        # If a torque is compared, it is the recorded command of the joint.
        key, zeroed = channel.guide.command if channel.guide else channel.key, channel.key.endswith(MEASURED_FROM_ZERO)
        offset = Parameter(key=f"{key}.offset", unit=channel.unit, start=0.0)
        gain = Parameter(key=f"{key}.gain", unit="1", start=1.0, low=1e-3, high=1e3, logarithmic=True)
        if zeroed and offset.key not in free:
            yield _cause(f"a zero offset of {key}", problem, offset)
        if zeroed and not {offset.key, gain.key} & free and channel.guide is None:
            slope, zero = np.polyfit(part.recorded + off, part.recorded, 1).tolist() if np.isfinite(off).all() else (0.0, 0.0)
            if 1e-3 < slope < 1e3:
                begin = (zero / offset.size, -float(np.log(slope)))
                yield _cause(f"another scale and zero of {key}", problem, offset, gain, begins=(begin,))
        for name, parameter in (("zero", offset), ("gain", gain)):
            # A shared parameter stays free; in addition each recording except the first gets a separate value.
            if len(problem.fitted) > 1 and (zeroed or name == "gain") and parameter.key not in own:
                tracks = problem.fitted[parameter.key in free :]
                yield _cause(f"a {name} of {key} in each recording", problem, parameter, tracks=tracks)


def _robot(problem: Problem, x: Array) -> Iterator[Extension]:
    """Extensions that free fixed springs, friction, damping, hysteresis and motor limits."""
    track, values, free = problem.tracks[0], problem.layout.table(x, 0), _taken(problem)
    known, moves = parameters_of(track.door.robot, (), {}), track.scenario.engine != "bench"
    for j, drive in enumerate(track.door.drives):
        joint, spring, motor = drive.name, bool(drive.mode and drive.mode.spring), bool(drive.mode and drive.mode.motor)
        for name, text, possible in (
            ("passive_stiffness", "a passive spring", moves and not spring and drive.joint.spring_stiffness == 0.0),
            ("hysteresis_torque", "hysteresis of the springs", spring), ("damping", "another damping", moves),
            ("friction", "another friction", moves), ("stribeck_friction", "static friction", moves),
            ("motor_1_friction_torque", "another motor friction", motor), ("motor_1_damping", "another motor damping", motor),
        ):  # fmt: skip
            parameter = known.get(f"{joint}.{name}")
            if possible and parameter is not None and parameter.key not in free:
                # The deflection over which hysteresis builds up is as unknown as its torque.
                beside = [f"{joint}.hysteresis_deflection"] if name == "hysteresis_torque" else []
                more = [known[key] for key in beside if key not in free]
                begins = ((*(0.0 for _ in more), 1.0),) if parameter.start == 0.0 else ()
                yield _cause(f"{text} of {joint}", problem, *more, parameter, begins=begins)
        for what, unit in (("torque", "N m"), ("velocity", "rad/s")) if drive.dynamic_motors else ():
            key, series = f"{joint}.motor_1_max_{what}", track.series(values, problem.playing, [(j, f"motor_1_{what}")])
            reached = 0.0 if series is None else float(np.abs(series).max())
            if key not in free and reached > 0.0:
                # Both motors of a joint share the limit.
                others = [key.replace("motor_1", "motor_2")] * (drive.dynamic_motors > 1)
                limit = Parameter(key=key, unit=unit, start=reached, low=0.03 * reached, high=4.0 * reached, logarithmic=True)
                text = f"a limit motor_1_max_{what} of {joint}"
                yield _cause(text, problem, limit, others=others, begins=tuple(np.log(LIMIT_FACTORS)))


def _commands(problem: Problem, *, hold: bool = True) -> list[str]:
    """Keys of the recorded commands; hold: include commands that are constant between samples."""
    commands = [one for i in problem.fitted for one in problem.tracks[i].data.commands]
    return list(dict.fromkeys(one.key for one in commands if hold or not one.hold))


def _taken(problem: Problem) -> set[str]:
    """Keys of the parameters that are free or tied."""
    layout = problem.layout
    return {*(entry.parameter.key for entry in layout.entries), *(tie.key for tie in layout.ties)}


def _cause(
    text: str, problem: Problem, *parameters: Parameter, others: Sequence[str] = (), tracks: Sequence[int | None] = (None,),
    begins: Sequence[float | Sequence[float]] = (),
) -> Extension:  # fmt: skip
    """Extension that frees parameters; others: keys that are tied to the first parameter."""
    wider = freed(problem, parameters, [Tie(key=key, to=parameters[0].key) for key in others], tracks=tracks)
    return Extension(text=text, problem=wider, begins=begins, share=FURTHER, clear=CLEAR)


def _without_ties(problem: Problem, x: Array) -> Iterator[tuple[Tie, Problem]]:
    """Yield each tie between parameters, and a problem in which the tied parameter is free."""
    layout = problem.layout
    values = dict(zip((entry.parameter.key for entry in layout.entries), layout.values(x).tolist(), strict=True))
    for tie in layout.ties:
        entry = next((one for one in layout.entries if one.parameter.key == tie.to and one.track is None), None)
        if entry is not None and not tie.key.endswith(".delay"):
            parameter = replace(entry.parameter, key=tie.key, start=tie.factor * values[tie.to])
            without = replace(layout, ties=tuple(one for one in layout.ties if one is not tie))
            yield tie, freed(problem.under(without), [parameter])


def contradicted_ties(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences on ties that the recordings contradict: the two numbers differ significantly and by more than a few percent."""
    if not problem.layout.ties:
        return
    optimum = _Optimum(problem, x)
    for tie, wider in _without_ties(problem, x):
        ((share, _, start),) = optimum.promises(Extension(problem=wider))
        tied, free = (wider.layout.entries[-1].value(move) for move in (0.0, float(start[-1])))
        significant = -np.log(1.0 - share) * independent_samples(optimum.residuals) > SIGNIFICANT
        if significant and abs(free - tied) > DIFFERENT * abs(tied):
            yield f"{tie.key} is not {tie.to}, to which it is tied: they differ by {percent(abs(free / tied - 1.0))}"


def _varying_springs(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences on springs whose stiffness varies with the amplitude: backlash is missing, or the spring law is wrong."""
    left, numbers = residuals(problem, x), problem.blocks(PARTS)
    for i, entry in enumerate(problem.layout.entries):
        if not entry.parameter.logarithmic or not any(word in entry.name for word in SPRINGS):
            continue
        slope = jacobian(problem, x, base=left, columns=[i])[:, 0]
        sizes, pulls = np.bincount(numbers, slope**2), np.bincount(numbers, slope * left)
        known = sizes > 25.0
        if known.sum() < 6:
            continue
        reach, moves = np.sqrt(sizes / np.bincount(numbers))[known], -pulls[known] / sizes[known]
        trend = _correlation(*(np.argsort(np.argsort(one)).astype(float) for one in (reach, moves)))
        extent, deviation = float(np.ptp(moves)), float(np.median(sizes[known] ** -0.5))
        # Noise alone rarely sorts the parts by stiffness.
        if abs(trend) > max(TREND, CHANCE / (known.sum() - 1) ** 0.5) and extent > max(6.0 * deviation, 0.02):
            # With backlash the stiffness is k (1 - width / A) at amplitude A; a hardening spring's stiffness grows with A^2.
            backlash = trend > 0.0 and abs(_correlation(1.0 / reach, moves)) > abs(_correlation(reach**2, moves))
            way, law = "falls" if trend < 0.0 else "grows", "backlash is missing" if backlash else "the spring's law is wrong"
            yield f"{entry.name} {way} with the amplitude: parts of the record differ by {100 * extent:.0f} %; {law}"


def _oscillations(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences on large oscillations of the residuals with frequencies that no command has."""
    for part, left in zip(problem.parts, differences(problem, x), strict=True):
        hertz = frequency(part.time, left) if float(np.std(left)) > RINGING * float(np.std(part.recorded)) else 0.0
        driven = [frequency(one.time, one.values) for one in problem.tracks[part.track].data.commands]
        if hertz and all(abs(one - hertz) > DRIVEN * hertz for one in driven):
            yield (
                f"{part.channel.key} oscillates at {hertz:.2g} Hz, but its prediction does not: a mode is missing, such as an "
                "elastic link or transmission, or no start found this frequency"
            )


def _correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(a, b)[0, 1])
