"""Extensions of a model, which are adopted during a fit, or named as possible causes if the model does not fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.identification.combinations import percent
from asrsim.identification.door import Drive
from asrsim.identification.extensions import ASKED, Extended, Extension, extended, freed
from asrsim.identification.keys import LATEST, Parameter, parameters_of
from asrsim.identification.problem import Problem, errors, jacobian, mean_square, residuals
from asrsim.identification.task import Tie
from asrsim.identification.uncertainty import Uncertainty, noise_of
from asrsim.robot.model import Robot
from asrsim.samples import Array

FACTORS = (0.03, 0.3, 3.0, 30.0)
"""Start values of the pre-sliding stiffness, relative to the default of the friction law."""
MUCH = 0.5
"""Pre-sliding is adopted by a badly fitting model if at most this fraction of the misfit beyond the noise remains."""
STAIRS = 0.9
"""A command is played as a staircase if at most this fraction of the mean square error then remains."""
EXPLAINED = 0.9
"""No further causes are sought if the suspected causes explain this fraction of the squared misfit beyond the noise."""
PARTLY = 0.5
"""Causes are named if at most this fraction of the squared misfit beyond the noise remains with them."""
FURTHER = 0.8
"""A further cause is suspected if at most this fraction of the mean square error remains with this cause."""
CAUSES, ROUNDS = 3, 15
"""Largest number of causes in one suggestion; largest number of steps of a search with a cause."""
MEASURED_FROM_ZERO = ("position", "deflection", "torque_1", "torque_2", "link_torque")
"""Endings of the names of quantities whose sensors may have a zero offset."""
DIFFERENT = 0.05
"""Relative difference of two tied parameters above which their tie is reported as wrong."""
BITES, REACHED = (0.75, 0.3), 0.999
"""Fractions of the largest torque or speed at which a lower limit is tried; fraction of a limit above which the limit counts as
reached.
"""
TREND, CHANCE, PARTS = 0.6, 2.9, 12
"""Rank correlation of a spring's stiffness with the deflection above which the correlation is reported; smallest ratio of this
correlation to the correlation of randomly ordered parts; number of parts of a recording in which the stiffness is estimated.
"""
CALLED = {
    "passive_stiffness": "a passive spring of {}", "hysteresis_torque": "hysteresis of the springs of {}",
    "stribeck_friction": "static friction of {}", "damping": "another damping of {}", "friction": "another friction of {}",
    "motor_1_friction_torque": "another motor friction of {}", "motor_1_damping": "another motor damping of {}",
}  # fmt: skip
SPRINGS = ("spring_stiffness", "spring_k", "passive_stiffness", ".k")


# -- extensions that are adopted during a fit ---------------------------------------------------------------------------------


def stairs(problem: Problem) -> Iterator[Extension]:
    """Extensions that hold each sample of a command until the next sample, as a digital controller does."""
    for key in dict.fromkeys(c.key for i in problem.fitted for c in problem.tracks[i].data.commands if not c.hold):
        if key not in problem.held:
            held = problem.played(problem.held | {key})
            yield Extension(text=f"{key} as stairs", problem=held, finite=True, share=STAIRS)


def presliding(problem: Problem, robot: Robot) -> Iterator[Extension]:
    """Extensions that free the pre-sliding stiffness of motor friction, for motors without this stiffness; motors with tied
    friction share the stiffness.
    """
    known, tied, taken = parameters_of(robot, (), {}), {tie.key: tie.to for tie in problem.layout.ties}, _taken(problem)
    groups: dict[str, list[str]] = {}
    for block in robot.actuators:
        for i in range(1, ACTUATORS.get(block.actuator).motors + 1):
            name = f"motor_{i}_friction_stiffness"
            root = f"{block.joint}.motor_{i}_friction_torque"
            root = tied.get(root, root)
            if block.parameters[name].origin == "default" and f"{block.joint}.{name}" not in taken:
                groups.setdefault(root, []).append(f"{block.joint}.{name}")
    for first, *others in groups.values():
        yield Extension(
            text=first, problem=freed(problem, [known[first]], [Tie(key=key, to=first) for key in others]), finite=True,
            begins=tuple(np.log(FACTORS)), restepped=True, excess=MUCH,
        )  # fmt: skip


# -- causes that are named if the model does not fit --------------------------------------------------------------------------


def missing_causes(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences that name effects that the model may lack. problem: problem whose residuals are weighted by the
    recorded noise.
    """
    base = mean_square(problem, x)
    target = base - EXPLAINED * max(base - 1.0, 0.0)
    found = extended(
        problem, x, _causes, most=CAUSES, rounds=ROUNDS,
        enough=lambda wider, there: mean_square(wider, there) <= target,
    )  # fmt: skip
    rest = mean_square(found.problem, found.x)
    if rest - 1.0 <= PARTLY * (base - 1.0):
        yield _suspected(found, base, complete=rest <= target)
    yield from _amplitude(problem, x)


def _suspected(found: Extended, base: float, *, complete: bool) -> str:
    texts, flags, layout = [], [], found.problem.layout
    values = dict(zip((entry.name for entry in layout.entries), layout.values(found.x).tolist(), strict=True))
    for cause in found.chosen:
        entry = cause.problem.layout.entries[-1]
        value, unit = values[entry.name], entry.parameter.unit.removeprefix("1")
        # Delays and offsets are small, so they are shown in ms and mrad.
        size = f"{1e3 * value:.3g} m{unit}" if entry.parameter.key.endswith((".delay", ".offset")) else f"{value:.4g} {unit}"
        texts.append(cause.text if entry.track is not None else f"{cause.text} ({size.strip()})")
        flags.append(cause.flags.replace("START", f"{value:.4g}"))
    verb = "is suspected: it would bring" if len(texts) == 1 else "are suspected: together they would bring"
    rest = "" if complete else "; more is missing"
    return f"{' and '.join(texts)} {verb} the error to {percent((found.cost / base) ** 0.5)} ({' '.join(flags)}){rest}"


def _causes(problem: Problem, x: Array) -> Iterator[Extension]:
    """Extensions of a problem; each extension adds one possible cause of the misfit."""
    yield from _delay(problem)
    yield from _sensors(problem, x)
    yield from _robot(problem)
    yield from _limits(problem, x)
    for tie, wider in _without_ties(problem, x):
        text = f"{tie.key} other than {'' if tie.factor == 1.0 else f'{tie.factor:g} * '}{tie.to}, to which it is tied"
        yield Extension(text=text, flags=f"--free {tie.key}", problem=wider, begins=(0.0,), share=FURTHER)


def _delay(problem: Problem) -> Iterator[Extension]:
    """Extension of a problem by a common delay of all commands."""
    commands = list(dict.fromkeys(c.key for i in problem.fitted for c in problem.tracks[i].data.commands))
    if commands and not any(key.endswith(".delay") or key == "clock" for key in _taken(problem)):
        first, *others = (f"{key}.delay" for key in commands)
        parameter = Parameter(key=first, unit="s", start=0.0, low=-1e-3, high=LATEST)
        yield replace(
            _cause("a delay of the commands", problem, parameter, [Tie(key=key, to=first) for key in others]), begins=(2.0,)
        )


def _sensors(problem: Problem, x: Array) -> Iterator[Extension]:
    """Extensions that free zeros and gains of channels, shared by all recordings, or separate for each recording."""
    layout, free = problem.layout, _taken(problem)
    own = {entry.parameter.key for entry in layout.entries if entry.track is not None}
    first = problem.fitted[0]
    left = errors(problem, x, first) or [np.zeros(1)] * len(problem.tracks[first].channels)
    for channel, off in zip(problem.tracks[first].channels, left, strict=True):
        key, zeroed = channel.key, channel.key.endswith(MEASURED_FROM_ZERO)
        offset = Parameter(key=f"{key}.offset", unit=channel.unit, start=0.0)
        gain = Parameter(key=f"{key}.gain", unit="1", start=1.0, low=1e-3, high=1e3, logarithmic=True)
        if zeroed and offset.key not in free:
            yield _cause(f"a zero offset of {key}", problem, offset)
        if zeroed and not {offset.key, gain.key} & free and channel.guide is None:
            recorded = channel.values[: len(off)]
            slope, zero = np.polyfit(recorded + off, recorded, 1).tolist()
            if 1e-3 < slope < 1e3:
                flags = f"--free {offset.key}={zero:.4g} --free {gain.key}=START"
                yield Extension(
                    text=f"another scale and zero of {key}", flags=flags, problem=freed(problem, [offset, gain]), finite=True,
                    begins=((zero / offset.size, -float(np.log(slope))),), share=FURTHER,
                )  # fmt: skip
        for name, parameter in (("zero", offset), ("gain", gain)):
            # A shared parameter stays free; in addition each recording except the first gets a separate value.
            if len(problem.fitted) > 1 and (zeroed or name == "gain") and parameter.key not in own:
                wider = freed(problem, [parameter], tracks=list(problem.fitted)[parameter.key in free :])
                text = f"a {name} of {key} in each recording"
                yield Extension(text=text, flags=f"--own {parameter.key}", problem=wider, share=FURTHER)


def _robot(problem: Problem) -> Iterator[Extension]:
    """Extensions that free springs, friction, damping and hysteresis that the robot lacks, or that are not free."""
    door, free = problem.tracks[0].door, _taken(problem)
    known = parameters_of(door.robot, (), {})
    for drive in door.drives:
        spring, motor = bool(drive.mode and drive.mode.spring), bool(drive.mode and drive.mode.motor)
        moves = problem.tracks[0].scenario.engine != "bench"
        wanted = {
            "passive_stiffness": moves and not spring and drive.joint.spring_stiffness == 0.0,
            "hysteresis_torque": spring, "damping": moves, "friction": moves, "stribeck_friction": moves,
            "motor_1_friction_torque": motor, "motor_1_damping": motor,
        }  # fmt: skip
        for name, possible in wanted.items():
            parameter = known.get(f"{drive.name}.{name}")
            if possible and parameter is not None and parameter.key not in free:
                cause, absent = _cause(CALLED[name].format(drive.name), problem, parameter), parameter.start == 0.0
                flags = f"--free {parameter.key}=START"
                yield replace(cause, flags=flags, finite=absent, begins=(1.0,) if absent else ())


def _taken(problem: Problem) -> set[str]:
    """Keys of the parameters that are free or tied."""
    layout = problem.layout
    return {*(entry.parameter.key for entry in layout.entries), *(tie.key for tie in layout.ties)}


def _cause(text: str, problem: Problem, parameter: Parameter, ties: Sequence[Tie] = ()) -> Extension:
    flags = f"--free {parameter.key}" + "".join(f" --tie {tie.key}={tie.to}" for tie in ties)
    return Extension(text=text, flags=flags, problem=freed(problem, [parameter], ties), share=FURTHER)


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


def ties_that_are_none(problem: Problem, x: Array, found: Uncertainty) -> list[str]:
    """Sentences on ties that the recordings contradict: the two numbers differ significantly and by more than a few percent."""
    faults = []
    for tie, wider in _without_ties(problem, x):
        base, there = residuals(problem, x), np.append(x, 0.0)
        slope = jacobian(wider, there, 1e-3, base=base, columns=[len(x)])
        both = np.column_stack([found.jacobian, slope])
        inverse, entry = np.linalg.pinv(both.T @ both), wider.layout.entries[-1]
        move = float(-(inverse @ (both.T @ base))[-1])
        share = abs(entry.value(move) / entry.value(0.0) - 1.0) if entry.value(0.0) else 0.0
        if share <= DIFFERENT:
            continue
        noise, _ = noise_of(problem, base, both)
        if move**2 > ASKED * float((inverse @ noise @ inverse)[-1, -1]):
            faults.append(f"{tie.key} is not {tie.to}, to which it is tied: they differ by {percent(share)}")
    return faults


def _motor_limits(problem: Problem, x: Array) -> Iterator[tuple[Drive, str, float, float]]:
    """Each torque or speed limit of the first motors: drive, name, level, and largest simulated value of the
    limited quantity.
    """
    track, values = problem.tracks[0], problem.layout.table(x, 0)
    for j, drive in enumerate(track.door.drives):
        for what in ("torque", "velocity") if drive.dynamic_motors else ():
            series = track.series(values, problem.playing[0], [(j, f"motor_1_{what}")])
            name = f"motor_1_max_{what}"
            if series is not None:
                yield drive, name, values.get(f"{drive.name}.{name}", drive.values[name]), float(np.abs(series).max())


def _limits(problem: Problem, x: Array) -> Iterator[Extension]:
    """Extensions that free a motor limit. Its start lies below the simulated maximum, or above if the simulation reaches the
    limit. Both motors of a joint share the limit.
    """
    for drive, name, level, reached in _motor_limits(problem, x):
        key, unit = f"{drive.name}.{name}", "N m" if "torque" in name else "rad/s"
        if key not in _taken(problem) and reached > 0.0:
            low, high = 0.1 * min(BITES) * reached, 4.0 * reached
            parameter = Parameter(key=key, unit=unit, start=reached, low=low, high=high, logarithmic=True)
            ties = [Tie(key=key.replace("motor_1", "motor_2"), to=key)] * (drive.dynamic_motors > 1)
            cause = _cause(f"a limit {name} of {drive.name}", problem, parameter, ties)
            flags = cause.flags.replace(key, f"{key}=START", 1)
            begins = (*BITES, 2.0) if reached >= REACHED * level else BITES
            yield replace(cause, flags=flags, finite=True, begins=tuple(np.log(begins)))


def _amplitude(problem: Problem, x: Array) -> Iterator[str]:
    """Sentences on springs whose stiffness depends on the deflection: backlash, or a different spring law."""
    entries = problem.layout.entries
    springs = [i for i, one in enumerate(entries) if one.parameter.logarithmic and any(word in one.name for word in SPRINGS)]
    if not springs:
        return
    left, numbers = residuals(problem, x), problem.blocks(PARTS)
    slopes = jacobian(problem, x, base=left, columns=springs)
    total = int(numbers.max()) + 1
    sizes, pulls, counts = np.zeros((total, len(springs))), np.zeros((total, len(springs))), np.bincount(numbers)
    np.add.at(sizes, numbers, slopes**2)
    np.add.at(pulls, numbers, slopes * left[:, None])
    reach = np.sqrt(np.sum(sizes, axis=1) / np.maximum(counts, 1))
    for i, number in enumerate(springs):
        known = sizes[:, i] > 25.0
        if known.sum() < 6:
            continue
        moves, deviation = -pulls[known, i] / sizes[known, i], float(np.median(sizes[known, i] ** -0.5))
        trend, extent = _rank_correlation(reach[known], moves), float(np.ptp(moves))
        # Noise alone rarely sorts the parts by stiffness.
        if abs(trend) > max(TREND, CHANCE / (known.sum() - 1) ** 0.5) and extent > max(6.0 * deviation, 0.02):
            # With backlash the stiffness is k (1 - width / A) at amplitude A; a hardening spring's stiffness grows with A^2.
            late, hard = (abs(float(np.corrcoef(reach[known] ** power, moves)[0, 1])) for power in (-1.0, 2.0))
            way = "falls" if trend < 0.0 else "grows"
            law = "backlash is missing" if trend > 0.0 and late > hard else "the spring's law is wrong"
            yield f"{entries[number].name} {way} with the amplitude: parts of the record differ by {100 * extent:.0f} %; {law}"


def _rank_correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(np.argsort(np.argsort(a)), np.argsort(np.argsort(b)))[0, 1])
