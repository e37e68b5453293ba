"""Extensions that are proposed: what recordings may ask for during a fit, and what a model that does not fit may lack."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.identification.extensions import ASKED, Extended, Extension, Propose, extended, freed
from asrsim.identification.keys import JUMP, LATEST, Parameter, parameters_of
from asrsim.identification.layout import Entry, Layout
from asrsim.identification.problem import Problem, errors, jacobian, mean_square, residuals
from asrsim.identification.task import Tie
from asrsim.identification.told import percent
from asrsim.identification.track import Track
from asrsim.identification.uncertainty import Uncertainty, noise_of
from asrsim.robot.model import Robot
from asrsim.samples import Array

FACTORS = (0.03, 0.3, 3.0, 30.0)
"""Of the law's own stiffness of bristles: from friction that gives way to one that hardly does."""
MUCH = 0.5
"""Share of what is more than noise that jumps or bristles may leave of a model that is far off."""
STAIRS = 0.9
"""Share of the mean square that a command played as stairs may leave."""
EXPLAINED = 0.9
"""Share of the error beyond the noise, squared, that suspected causes explain together: others would, too, in part."""
FURTHER = 0.8
"""Share of the mean square error that a cause may leave."""
CAUSES, ROUNDS = 3, 15
"""Causes that are suspected together, and steps of a search with one free, at most."""
MEASURED_FROM_ZERO = ("position", "deflection", "torque_1", "torque_2", "link_torque")
"""Ends of quantities whose sensors may have another zero."""
FOLLOWED = 0.5
"""Share of a channel's variance below which a fit hardly follows it."""
DIFFERENT = 0.05
"""Share by which two tied numbers differ that are said to."""
BITES, RELEASES, REACHED = (0.75, 0.3, 0.1), 2.0, 0.999
"""Shares of what the motion reaches, and of a limit that it reaches, at which another limit is tried; share of a limit from
which on the motion has run into it.
"""
LIMITS = {
    "max_torque": ("torque", 0.0), "max_velocity": ("velocity", 0.0), "max_current": ("current", 0.0),
    "max_voltage": ("voltage", 0.0), "min_position": ("position", -1.0), "max_position": ("position", 1.0),
}  # fmt: skip
"""Last part of a motor's limit -> the motor's quantity that it bounds, and on which side; 0: on both."""
LAGS, TREND, PARTS = 0.3, 0.6, 12
"""Share of a torque's errors, squared, from which on they go with the direction of its change; rank correlation of a spring's
estimates in so many parts of the record with the deflection, beyond which it depends on it.
"""


# -- what recordings may ask for during a fit -----------------------------------------------------------------------------


def jumps(problem: Problem, _: Array) -> Iterator[Extension]:
    """Times of large jumps that came between two samples: a recording shows them at the later one."""
    free = {(entry.parameter.key, entry.track) for entry in problem.layout.entries}
    several = len(problem.tracks) > 1
    entries = [
        Entry(one, number, f"{one.key} ({problem.tracks[number].data.name})" if several else one.key, one.start)
        for number in problem.fitted
        for one in jumps_of(problem.tracks[number], problem.held)
        if (one.key, number) not in free
    ]
    if entries:
        wider = problem.under(replace(problem.layout, entries=(*problem.layout.entries, *entries)))
        yield Extension(text="times of jumps", problem=wider, separable=True, excess=MUCH)


def jumps_of(track: Track, held: frozenset[str]) -> Iterator[Parameter]:
    """Seconds by which each large jump may come before its sample."""
    for command in track.data.commands:
        curve = (command.as_stairs if command.key in held else command).curve
        for number, piece in enumerate(curve.large, start=1):
            width = float(curve.time[piece] - curve.time[piece - 1])
            yield Parameter(key=f"{command.key}.{JUMP}{number}", unit="s", start=0.0, low=0.0, high=width, own=True)


def with_jumps_of_predicted(problem: Problem, x: Array, enough: Callable[[Problem, Array], bool]) -> Problem:
    """With jumps of recordings that are only predicted where these ask for them: when they came is nothing of the model's."""
    ends = tuple(track.data.duration if track.data.held else 0.0 for track in problem.tracks)
    alone = replace(problem, ends=ends, layout=problem.layout.fixed_at(x))
    if not alone.fitted:
        return problem
    found = extended(alone, np.zeros(0), jumps, most=1, enough=enough)
    moved = [
        {key: value for key, value in values.items() if f".{JUMP}" in key and number in alone.fitted}
        for number, values in enumerate(found.problem.layout.fixed_at(found.x).fixed)
    ]
    return problem.under(replace(problem.layout, fixed=tuple(moved)))


def stairs(problem: Problem, _: Array) -> Iterator[Extension]:
    """Commands whose samples are held until the next, as a digital controller does."""
    keys = dict.fromkeys(c.key for i in problem.fitted for c in problem.tracks[i].data.commands if not c.hold)
    for key in keys:
        if key not in problem.held:
            held = problem.played(problem.held | {key})
            yield Extension(text=f"{key} as stairs", problem=held, finite=True, share=STAIRS)


def bristles(problem: Problem, robot: Robot) -> Iterator[Extension]:
    """Stiffness of bristles of motors' friction that nobody gave; of motors whose friction is one number, it is one, too."""
    layout = problem.layout
    known, tied = parameters_of(robot, (), {}), {tie.key: tie.to for tie in layout.ties}
    taken = {*tied, *(entry.parameter.key for entry in layout.entries)}
    groups: dict[str, list[str]] = {}
    for block in robot.actuators:
        for i in range(1, ACTUATORS.get(block.actuator).motors + 1):
            name = f"motor_{i}_friction_stiffness"
            root = f"{block.joint}.motor_{i}_friction_torque"
            while root in tied:
                root = tied[root]
            if block.parameters[name].origin == "default" and f"{block.joint}.{name}" not in taken:
                groups.setdefault(root, []).append(f"{block.joint}.{name}")
    for first, *others in groups.values():
        yield Extension(
            text=first, problem=freed(problem, [known[first]], [Tie(key=key, to=first) for key in others]), finite=True,
            begins=tuple(np.log(FACTORS)), restepped=True, excess=MUCH,
        )  # fmt: skip


def jumps_or_bristles(robot: Robot) -> Propose:
    """Each may explain a part of what is the other's."""
    return lambda problem, x: (*jumps(problem, x), *bristles(problem, robot))


# -- what a model that does not fit may lack ------------------------------------------------------------------------------


def missing_causes(problem: Problem, x: Array, start: Array) -> list[str]:
    """For people. problem: weighted by the channels' noise; x: the estimate; start: where it began."""
    base = mean_square(problem, x)

    def enough(wider: Problem, there: Array) -> bool:
        return mean_square(wider, there) - 1.0 <= (1.0 - EXPLAINED) * (base - 1.0)

    found = extended(problem, x, _causes, most=CAUSES, enough=enough, starts=[start], rounds=ROUNDS, tolerance=1e-3)
    suspected = (
        list(_suspected(found, base)) if found.chosen and enough(found.problem, found.x) else list(_nobody_gave(problem))
    )
    return [*suspected, *_amplitude(problem, x), *_hysteresis(problem, x)]


def _suspected(found: Extended, base: float) -> Iterator[str]:
    texts, flags = [], []
    values = dict(
        zip((entry.name for entry in found.problem.layout.entries), found.problem.layout.values(found.x), strict=True)
    )
    for cause in found.chosen:
        entry = cause.problem.layout.entries[-1]
        value, unit = float(values[entry.name]), entry.parameter.unit
        # Times and zeros are small.
        size = f"{1e3 * value:.3g} m{unit}" if entry.parameter.key.endswith((".delay", ".offset")) else f"{value:.4g} {unit}"
        own = cause.separable
        texts.append(cause.text if own else f"{cause.text} ({size.strip()})")
        flags.append(cause.flags.replace("START", f"{value:.4g}"))
    verb = "is suspected: it would bring" if len(texts) == 1 else "are suspected: together they would bring"
    yield f"{' and '.join(texts)} {verb} the error to {percent((found.cost / base) ** 0.5)} ({' '.join(flags)})"


def _causes(problem: Problem, x: Array) -> Iterator[Extension]:
    """What could be free beside a problem's entries."""
    return (replace(one, share=FURTHER) for one in (*_of_sensors(problem, x), *_of_the_robot(problem, x)))


def _of_sensors(problem: Problem, x: Array) -> Iterator[Extension]:
    """Delays, zeros, gains and signs."""
    free = {entry.parameter.key for entry in problem.layout.entries}
    tracks = [problem.tracks[i] for i in problem.fitted]
    commands = list(dict.fromkeys(c.key for track in tracks for c in track.data.commands))
    if commands and not any(key.endswith(".delay") or key == "clock" for key in free):
        first, *others = (f"{key}.delay" for key in commands)
        parameter = Parameter(key=first, unit="s", start=0.0, low=-1e-3, high=LATEST)
        yield _cause("a delay of the commands", problem, parameter, [Tie(key=key, to=first) for key in others], begins=(2.0,))
    for key, unit in {c.key: c.unit for track in tracks for c in track.channels}.items():
        offset, gain = f"{key}.offset", f"{key}.gain"
        if key.endswith(MEASURED_FROM_ZERO) and offset not in free:
            yield _cause(f"a zero offset of {key}", problem, Parameter(key=offset, unit=unit, start=0.0), begins=(0.0,))
        if key.endswith(MEASURED_FROM_ZERO):
            yield from _own(f"a zero of {key}", problem, x, Parameter(key=offset, unit=unit, start=0.0))
        factor = Parameter(key=gain, unit="1", start=1.0, low=1e-3, high=1e3, logarithmic=True)
        yield from _own(f"a gain of {key}", problem, x, factor)
        if gain not in free and key in _lost(problem, x):
            parameter = Parameter(key=gain, unit="", start=1.0, low=-10.0, high=10.0)
            yield _cause(f"another sign of {key}", problem, parameter, flags=f"--map COLUMN=-{key}", begins=(-2.0,))


def _of_the_robot(problem: Problem, x: Array) -> Iterator[Extension]:
    """Springs, gains of controllers, limits, ties that are none."""
    layout, track = problem.layout, problem.tracks[0]
    taken = {entry.parameter.key for entry in layout.entries} | {tie.key for tie in layout.ties}
    known = parameters_of(track.door.robot, (), {})
    for drive in track.door.drives:
        key, linear = f"{drive.name}.passive_stiffness", drive.joint.kind == "prismatic"
        if drive.joint.spring_stiffness == 0.0 and key not in taken and not (drive.mode and drive.mode.spring):
            parameter = Parameter(key=key, unit="N/m" if linear else "N m/rad", start=0.0, low=0.0)
            yield _cause(f"a spring of {drive.name}'s own", problem, parameter, flags=f"--free {key}=START")
        for name in ("proportional", "derivative") if drive.mode and drive.mode.controller else ():
            key, other = (f"{drive.name}.controller_{i}_{name}" for i in (1, 2))
            if key in known and known[key].start > 0.0 and key not in taken:
                same = other in known and other not in taken and known[other].start == known[key].start
                ties = [Tie(key=other, to=key)] if same else []
                yield _cause(f"another {name} gain of {drive.name}'s controller", problem, known[key], ties, given=True)
    for text, parameter, ties in limits(problem, x):
        yield _cause(text, problem, parameter, ties, given=True, begins=(0.0,), finite=True)
    for tie, wider in _without_ties(problem, x):
        text = f"{tie.key} other than {'' if tie.factor == 1.0 else f'{tie.factor:g} * '}{tie.to}, to which it is tied"
        yield Extension(text=text, flags=f"--free {tie.key}", problem=wider, begins=(0.0,))


def _cause(
    text: str, problem: Problem, parameter: Parameter, ties: Sequence[Tie] = (), *, flags: str = "", given: bool = False,
    begins: tuple[float, ...] = (), finite: bool = False,
) -> Extension:  # fmt: skip
    """given: its start is said to who would free it."""
    asked = f"--free {parameter.key}{'=START' if given else ''}" + "".join(f" --tie {tie.key}={tie.to}" for tie in ties)
    return Extension(
        text=text, flags=flags or asked, problem=freed(problem, [parameter], ties), begins=begins, finite=finite
    )  # fmt: skip


def _own(text: str, problem: Problem, x: Array, parameter: Parameter) -> Iterator[Extension]:
    """A number that each of several recordings has for itself."""
    tracks, key = list(problem.fitted), parameter.key
    if len(tracks) < 2 or any(one.parameter.key == key and one.track is not None for one in problem.layout.entries):
        return
    if (shared := problem.layout.table(x, 0).get(key)) is not None:
        # What all share stays the first one's.
        tracks, parameter = tracks[1:], replace(parameter, start=shared)
    wider = freed(problem, [parameter], tracks=tracks)
    yield Extension(text=f"{text} in each recording", flags=f"--own {key}", problem=wider, separable=True)


def _lost(problem: Problem, x: Array) -> set[str]:
    """Channels that are hardly followed."""
    found = set()
    for number in problem.fitted:
        for channel, left in zip(problem.tracks[number].channels, errors(problem, x, number) or (), strict=False):
            if float(np.mean(left**2)) > (1.0 - FOLLOWED) * float(np.var(channel.values[: len(left)])):
                found.add(channel.key)
    return found


def _nobody_gave(problem: Problem) -> Iterator[str]:
    """Gains that are guesses: those of a law, of a controller that is another."""
    free = {entry.parameter.key for entry in problem.layout.entries}
    for drive in problem.tracks[0].door.drives:
        key = f"{drive.name}.controller_1_proportional"
        gain = drive.block.parameters.get(key.partition(".")[2]) if drive.block else None
        if gain and gain.origin == "default" and drive.mode and drive.mode.controller and key not in free:
            yield (
                f"the gains of {drive.name}'s controller are the law's own, which nobody gave: is it another? "
                f"(--free {key}; a derivative gain brakes as damping does)"
            )


def _without_ties(problem: Problem, x: Array) -> Iterator[tuple[Tie, Problem]]:
    """Ties, each with a problem in which its key is free."""
    layout = problem.layout
    values = dict(zip((entry.parameter.key for entry in layout.entries), layout.values(x).tolist(), strict=True))
    for tie in layout.ties:
        entry = next((one for one in layout.entries if one.parameter.key == tie.to and one.track is None), None)
        if entry is not None and not tie.key.endswith(".delay"):
            parameter = replace(entry.parameter, key=tie.key, start=tie.factor * values[tie.to])
            without: Layout = replace(layout, ties=tuple(one for one in layout.ties if one is not tie))
            yield tie, freed(problem.under(without), [parameter])


def ties_that_are_none(problem: Problem, x: Array, found: Uncertainty) -> list[str]:
    """Ties of which the recordings show that the two numbers differ: by more than chance, and by more than a few percent."""
    faults = []
    for tie, wider in _without_ties(problem, x):
        base, there = residuals(problem, x), np.append(x, 0.0)
        slope = jacobian(wider, there, 1e-3, base=base, central=True, columns=[len(x)])
        both = np.column_stack([found.jacobian, slope])
        noise, _ = noise_of(problem, base, both)
        inverse = np.linalg.pinv(both.T @ both)
        move = float(-(inverse @ (both.T @ base))[-1])
        variance, entry = float((inverse @ noise @ inverse)[-1, -1]), wider.layout.entries[-1]
        share = abs(entry.value(move) / entry.value(0.0) - 1.0) if entry.value(0.0) else 0.0
        if move**2 > ASKED * variance and share > DIFFERENT:
            faults.append(f"{tie.key} is not {tie.to}, to which it is tied: they differ by {percent(share)}")
    return faults


# -- limits that a recording has run into and the model not, or the model while it did not -----------------------------------


def limits(problem: Problem, x: Array) -> Iterator[tuple[str, Parameter, list[Tie]]]:
    """Every limit that is not free, with starts that bite, where it would make a difference to the motion at x; those of a
    joint's two motors, where they are the same number, together.
    """
    track, values = problem.tracks[0], problem.layout.table(x, 0)
    known = parameters_of(track.door.robot, (), {})
    for j, drive in enumerate(track.door.drives):
        motors = [(i, what) for i in range(1, drive.dynamic_motors + 1) for what in LIMITS]
        bounds = [(f"motor_{i}_{what}", f"motor_{i}_{LIMITS[what][0]}", LIMITS[what][1]) for i, what in motors]
        if drive.actuator and drive.mode and drive.mode.spring:
            bounds.append(("max_deflection", "deflection", 0.0))
        tied: set[str] = set()
        for name, quantity, side in bounds:
            key, other = f"{drive.name}.{name}", f"{drive.name}.{name.replace('motor_1', 'motor_2')}"
            if key not in known or key in values or key in tied:
                continue
            same = other != key and other in known and other not in values and known[other].start == known[key].start
            ties = [Tie(key=other, to=key)] if same else []
            found = track.series(values, problem.playing[0], [(j, quantity)])
            for parameter in _biting(known[key], found, side):
                tied.update(tie.key for tie in ties)
                of = "the deflection" if name == "max_deflection" else f"the motors, {name[8:]},"
                yield f"a limit of {of} of {drive.name}", parameter, ties


def _biting(limit: Parameter, found: Array | None, side: float) -> Iterator[Parameter]:
    """Another limit, where it is tried; nowhere, where there is nothing to limit. found: (1, n) what it bounds."""
    if found is None or not np.all(np.isfinite(found)) or np.ptp(found if side else np.abs(found)) == 0.0:
        return
    if side:
        reach, extent = side * float(np.max(side * found)), float(np.ptp(found))
        into = math.isfinite(limit.start) and side * (limit.start - reach) <= (1.0 - REACHED) * extent
        starts = [limit.start + side * extent] * into + [reach - side * (1.0 - bite) * extent for bite in BITES]
        yield from (replace(limit, start=one, low=-math.inf, high=math.inf, logarithmic=False) for one in starts)
        return
    # Where a jump of the command reaches the limit for a moment, a lower one may be missing all the same.
    reach = float(np.max(np.abs(found)))
    starts = [RELEASES * limit.start] * (reach >= REACHED * limit.start) + [bite * reach for bite in BITES]
    yield from (replace(limit, start=one, low=1e-3 * one, high=1e3 * one, logarithmic=True) for one in starts)


# -- laws that errors show to be missing -----------------------------------------------------------------------------------


def _amplitude(problem: Problem, x: Array) -> Iterator[str]:
    """Springs whose estimates, one step in each part of the record alone, go with the deflection."""
    words, entries = ("spring_stiffness", "spring_k", "passive_stiffness", ".k"), problem.layout.entries
    springs = [i for i, one in enumerate(entries) if one.parameter.logarithmic and any(word in one.name for word in words)]
    if not springs:
        return
    left, numbers = residuals(problem, x), problem.blocks(PARTS)
    slopes = jacobian(problem, x, base=left, columns=springs)
    total = int(numbers.max()) + 1
    sizes, pulls, counts = np.zeros((total, len(springs))), np.zeros((total, len(springs))), np.bincount(numbers)
    np.add.at(sizes, numbers, slopes**2)
    np.add.at(pulls, numbers, slopes * left[:, None])
    reach = np.sum(sizes, axis=1) / np.maximum(counts, 1)
    for i, entry in enumerate(springs):
        known = sizes[:, i] > 25.0
        if known.sum() < 6:
            continue
        moves, deviation = -pulls[known, i] / sizes[known, i], float(np.median(sizes[known, i] ** -0.5))
        rank, extent = _rank_correlation(reach[known], moves), float(np.ptp(moves))
        if abs(rank) > TREND and extent > max(6.0 * deviation, 0.02):
            yield (
                f"{entries[entry].name} {'falls' if rank < 0.0 else 'grows'} with the amplitude: parts of the record differ by "
                f"{100 * extent:.0f} %; a spring whose law is another is missing"
            )


def _rank_correlation(a: Array, b: Array) -> float:
    return float(np.corrcoef(np.argsort(np.argsort(a)), np.argsort(np.argsort(b)))[0, 1])


def _hysteresis(problem: Problem, x: Array) -> list[str]:
    """Errors of a torque that go with the sign of its velocity."""
    found: dict[str, tuple[float, str]] = {}
    for number in problem.fitted:
        track = problem.tracks[number]
        modes = {drive.name: drive.mode for drive in track.door.drives}
        for channel, left in zip(track.channels, errors(problem, x, number) or (), strict=False):
            if "torque" not in channel.quantity:
                continue
            sign = np.sign(np.gradient(np.convolve(channel.values[: len(left)], np.ones(5) / 5.0, "same")))
            size = abs(float(np.mean(left * sign)))
            if size**2 <= LAGS * max(float(np.mean(left**2)), 1e-300) or size < found.get(channel.key, (0.0, ""))[0]:
                continue
            mode, names = modes.get(channel.joint), {}
            if mode and mode.spring:
                names["hysteresis"] = "hysteresis_torque"
            if track.scenario.engine != "bench":
                # A link that stands where it is put has no friction.
                names["friction"] = "stribeck_friction"
            flags = " ".join(f"--free {channel.joint}.{name}={size:.2g}" for name in names.values())
            text = f"{channel.unit} off by the direction of its change: {' or '.join(names)} is missing ({flags})"
            found[channel.key] = size, text
    return [f"{key} is {size:.3g} {text}" for key, (size, text) in found.items()]
