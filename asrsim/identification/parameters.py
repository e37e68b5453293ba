"""Parameters that can be free, and the vector of the free parameters.

All parameters of the robot can be free. Further parameters belong to the recordings: zero offsets, gains and delays of channels
and commands, the clock offset, and initial states.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators import ACTUATORS
from asrsim.actuators.stages import STAGES
from asrsim.errors import InputError, Problem, did_you_mean, hint_of_own
from asrsim.identification.task import Task, Tie, Wish
from asrsim.quantities import linear_unit
from asrsim.robot.model import INERTIAS, Robot
from asrsim.samples import Array

CLOCK, JUMP = "clock", "jump_"
"""CLOCK: key of the common delay of all channels.
JUMP: prefix of the keys of the instants of command jumps, which are numbered from 1.
"""
LATEST = 0.25
"""Largest delay and largest clock offset that a fit allows, s. Buses and networks that carry commands have shorter delays."""
TYPICAL = {
    "rad": 1e-2, "m": 1e-2, "rad/s": 0.1, "m/s": 0.1, "N m": 0.05, "N": 0.5, "N m s/rad": 0.02, "N s/m": 1.0, "s": 2e-3,
    "kg": 0.1, "kg m^2": 1e-3, "N m/rad^3": 10.0, "N/m^3": 1e4,
}  # fmt: skip
"""Typical size of a parameter whose start value is 0, by unit. The sizes are typical of robot arms of 0.1 to 1 m and 0.1 to 10
kg. They scale the search, and the margins of values near 0.
"""
FACTOR = 1e6
"""Largest factor by which a positive parameter may grow or shrink. A mistaken unit, such as mm^2 instead of m^2, changes a
value by this factor.
"""
LOSSES = ("damping", "friction", "hysteresis_torque")
"""Words in the names of parameters of friction and other losses. These parameters may be 0."""
NOT_THE_ROBOTS, INITIAL = ("offset", "gain", "delay"), "initial_"
"""NOT_THE_ROBOTS: names of parameters that belong to a recording, not to the robot.
INITIAL: prefix of the names of initial positions and velocities, which also belong to a recording.
"""


@dataclass(frozen=True, kw_only=True)
class FitParameter:
    """A parameter of the robot or of a recording that a fit may estimate.

    The search uses a number x instead of the value. It is the logarithm of the value relative to the start value, or the change
    of the value relative to a typical size.
    """

    key: str
    unit: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    logarithmic: bool = False
    """Whether the search uses the logarithm of the parameter. The logarithm is used for positive parameters, except friction
    and damping, which may be 0.
    """
    own: bool = False
    """Whether each recording has a separate value."""
    spread: float = math.inf
    """Standard deviation of a normal prior of x, whose mean is the start value; infinite: no prior."""
    track: int | None = None
    """Index of the recording to which this value belongs; None: all recordings share the value."""
    recording: str = ""
    """Name of the recording to which this value belongs; empty if there is only one recording, or if all share the value."""

    @property
    def name(self) -> str:
        """Displayed name: the key, followed by the name of the recording if each recording has a separate value."""
        return f"{self.key} ({self.recording})" if self.recording else self.key

    @property
    def size(self) -> float:
        """Typical change of a parameter whose logarithm is not used in the search."""
        return max(abs(self.start), TYPICAL.get(self.unit, 0.1))

    def value(self, x: float) -> float:
        """Value in the parameter's unit."""
        value = self.start * math.exp(min(max(x, -50.0), 50.0)) if self.logarithmic else self.start + self.size * x
        return min(max(value, self.low), self.high)

    def slope(self, x: float) -> float:
        """Derivative of the value with respect to x."""
        return self.value(x) if self.logarithmic else self.size

    def place(self, value: float) -> float:
        """Number x of a value; inverse of `value`."""
        if self.logarithmic:
            return math.log(value / self.start) if value > 0.0 else -math.inf
        return (value - self.start) / self.size

    def of_recording(self, track: int, names: Sequence[str]) -> FitParameter:
        """Separate parameter of a recording. names: names of all recordings."""
        return replace(self, track=track, recording=names[track] if len(names) > 1 else "")


@dataclass(frozen=True)
class Layout:
    """Free parameters as the elements of a vector, and parameters that are tied to them."""

    entries: tuple[FitParameter, ...]
    ties: tuple[Tie, ...]

    def __len__(self) -> int:
        return len(self.entries)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the vector, (n,) each."""
        low, high = np.array([(one.place(one.low), one.place(one.high)) for one in self.entries]).T
        return low, high

    @cached_property
    def priors(self) -> Array:
        """Inverse standard deviations (n,) of the priors of the vector; 0: no prior."""
        return np.array([1.0 / one.spread for one in self.entries])

    def at_bound(self, x: Array) -> NDArray[np.bool_]:
        """Whether each entry (n,) of the vector is at its lower or upper bound."""
        low, high = self.bounds
        near = 1e-4 * np.minimum(high - low, 1.0)
        return np.asarray((x - low < near) | (high - x < near))

    def scaled(self, x: Array, words: Sequence[str], factor: float) -> Array:
        """Vector in which parameters with one of these words in their names are multiplied by a factor, if the search uses
        their logarithm.
        """
        hit = [entry.logarithmic and any(word in entry.name for word in words) for entry in self.entries]
        return np.clip(np.where(hit, x + math.log(factor), x), *self.bounds)

    def values(self, x: Array) -> Array:
        """Values (n,) in the parameters' units."""
        return np.array([entry.value(float(v)) for entry, v in zip(self.entries, x, strict=True)])

    def named(self, x: Array) -> dict[str, float]:
        """Values by displayed name."""
        return dict(zip((entry.name for entry in self.entries), self.values(x).tolist(), strict=True))

    def slopes(self, x: Array) -> Array:
        """Derivatives (n,) of the values with respect to the vector."""
        return np.array([entry.slope(float(v)) for entry, v in zip(self.entries, x, strict=True)])

    def table(self, x: Array, track: int) -> dict[str, float]:
        """Values by key for a recording, including tied parameters."""
        pairs = zip(self.entries, x, strict=True)
        return self.tied({one.key: one.value(float(v)) for one, v in pairs if one.track in (None, track)})

    def tied(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values by key, extended by the tied parameters."""
        return tied(values, self.ties)

    @property
    def keys(self) -> set[str]:
        """Keys of the parameters that are free or tied."""
        return {entry.key for entry in self.entries} | {tie.key for tie in self.ties}


def tied(values: Mapping[str, float], ties: Iterable[Tie]) -> dict[str, float]:
    """Values by key, extended by the tied parameters."""
    return {**values, **{tie.key: tie.factor * values[tie.to] for tie in ties if tie.to in values}}


def make_layout(
    free: Sequence[FitParameter], ties: Sequence[Tie], names: Sequence[str], starts: Sequence[Mapping[str, float]],
    within: Sequence[Mapping[str, float]],
) -> Layout:  # fmt: skip
    """Layout of the free parameters. names: names of the recordings; starts: for each fitted recording, start values by key of
    the parameters that depend on the recording; within: for each fitted recording, the largest errors of these start values.
    """
    entries: list[FitParameter] = []
    for parameter in free:
        separate = [
            _near(parameter, known, far).of_recording(i, names)
            for i, (known, far) in enumerate(zip(starts, within, strict=True))
        ]
        entries += separate if parameter.own and separate else [parameter]
    return Layout(tuple(entries), tuple(ties))


def _near(parameter: FitParameter, starts: Mapping[str, float], within: Mapping[str, float]) -> FitParameter:
    """Parameter whose start value is measured, and whose bounds are the measured value plus and minus its largest error."""
    start, far = starts.get(parameter.key, parameter.start), within.get(parameter.key, math.inf)
    return replace(parameter, start=start, low=max(parameter.low, start - far), high=min(parameter.high, start + far))


def numbers_of(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Parameters of the robot, by joint or link."""
    robot: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        owner, _, name = key.rpartition(".")
        if owner and name not in NOT_THE_ROBOTS and not name.startswith(INITIAL):
            robot.setdefault(owner, {})[name] = value
    return robot


def parameters_of(robot: Robot, commands: Sequence[str], channels: Mapping[str, str]) -> dict[str, FitParameter]:
    """All parameters by key. commands: recorded commands such as `joint.reference_1`; channels: units of the recorded channels,
    by `joint.quantity`.
    """
    found = [*_of_actuators(robot), *_of_joints(robot), *_of_links(robot), *_of_channels(commands, channels)]
    return {parameter.key: parameter for parameter in found}


def _parameter(key: str, unit: str, start: float, low: float = -math.inf, high: float = math.inf) -> FitParameter:
    name = key.rpartition(".")[2]
    loss = any(word in name for word in LOSSES) and not name.endswith("_stiffness")
    logarithmic = low >= 0.0 and 0.0 < start < math.inf and not loss
    if logarithmic:
        low, high = max(low, start / FACTOR), min(high, start * FACTOR)
    own = key == CLOCK or name.startswith(INITIAL)
    return FitParameter(key=key, unit=unit, start=start, low=low, high=high, logarithmic=logarithmic, own=own)


def motor_start(joint: str, motor: int) -> tuple[str, str]:
    """Keys of the initial position and velocity of motor 1, 2, ... of a joint."""
    return f"{joint}.{INITIAL}motor_{motor}_position", f"{joint}.{INITIAL}motor_{motor}_velocity"


def _of_actuators(robot: Robot) -> Iterator[FitParameter]:
    for block in robot.actuators:
        values, unit_of = block.values(), linear_unit if robot.joint(block.joint).kind == "prismatic" else str
        for one in ACTUATORS.get(block.actuator).all_parameters():
            yield _parameter(f"{block.joint}.{one.name}", unit_of(one.unit), values[one.name], one.minimum, one.maximum)
        for i in range(1, 1 + ACTUATORS.get(block.actuator).motors):
            for key, unit in zip(motor_start(block.joint, i), ("rad", "rad/s"), strict=True):
                yield _parameter(key, unit_of(unit), math.nan)


def _of_joints(robot: Robot) -> Iterator[FitParameter]:
    for joint in robot.moving_joints:
        force, place = ("N", "m") if joint.kind == "prismatic" else ("N m", "rad")
        for name, unit, *numbers in (
            ("damping", f"{force} s/{place}", joint.damping, 0.0), ("friction", force, joint.friction, 0.0),
            ("stribeck_friction", force, joint.stribeck_friction, 0.0), ("load_friction", "1", joint.load_friction, 0.0),
            ("stribeck_velocity", f"{place}/s", joint.stribeck_velocity, 0.0),
            ("passive_stiffness", f"{force}/{place}", joint.spring_stiffness, 0.0),
            ("passive_reference", place, joint.spring_reference),
            ("armature", "kg" if force == "N" else "kg m^2", joint.armature, 0.0),
            ("initial_position", place, math.nan), ("initial_velocity", f"{place}/s", math.nan),
        ):  # fmt: skip
            yield _parameter(f"{joint.name}.{name}", unit, *numbers)


def _of_links(robot: Robot) -> Iterator[FitParameter]:
    for link in robot.links:
        if link.mass is None:
            continue
        yield _parameter(f"{link.name}.mass", "kg", link.mass, 0.0)
        for name, value in zip("xyz", link.centre_of_mass, strict=True):
            yield _parameter(f"{link.name}.{name}", "m", value)
        for name, value in zip(INERTIAS, link.inertia or (0.0,) * 6, strict=True):
            yield _parameter(f"{link.name}.{name}", "kg m^2", value, 0.0 if name[1] == name[2] else -math.inf)


def _of_channels(commands: Sequence[str], channels: Mapping[str, str]) -> Iterator[FitParameter]:
    yield _parameter(CLOCK, "s", 0.0, -LATEST, LATEST)
    for key in dict.fromkeys((*commands, *channels)):
        yield _parameter(f"{key}.offset", channels.get(key) or "rad", 0.0)
        yield _parameter(f"{key}.gain", "1", 1.0, 0.0)
        yield _parameter(f"{key}.delay", "s", 0.0, -LATEST, LATEST)


def free_parameters(task: Task, known: Mapping[str, FitParameter]) -> tuple[list[FitParameter], list[Tie]]:
    """Free parameters in the order of the task, and ties between single parameters. Raises InputError with all problems."""
    problems: list[Problem] = []
    free: dict[str, FitParameter] = {}
    for pattern, wish in task.free.items():
        # A pattern matches a parameter without a finite value only if the user states a start value.
        given = wish.start is not None
        keys = [
            key
            for key, one in known.items()
            if key == pattern or (fnmatchcase(key, pattern) and (given or math.isfinite(one.start)))
        ]
        free |= {key: _wished(known[key], wish) for key in keys}
        problems += [fault for key in keys for fault in _faults(free[key])] if keys else [_unknown(pattern, known)]
    ties: list[Tie] = []
    for tie in task.ties:
        pairs = list(_tied(tie, known))
        found = [Tie(key=key, to=to, factor=tie.factor) for key, to in pairs if "*" not in tie.key or to in free]
        if not pairs:
            problems.append(_unknown(tie.key, known))
        elif not found:
            problems.append(Problem(f"is tied to {tie.to}, which matches no free parameter", key=tie.key, code="tie"))
        ties += found
    # Remove tied parameters: a tied parameter is not free, even if a pattern matches it.
    for tie in ties:
        free.pop(tie.key, None)
    problems += _tie_faults(ties, free)
    if not free and not problems:
        hint = "Name parameters: --free 'joint_1.spring_*'"
        problems.append(Problem("no parameter is free", key="free", hint=hint, choices=_roots(known), code="free"))
    if problems:
        raise InputError(problems)
    return list(free.values()), ties


def _wished(known: FitParameter, wish: Wish) -> FitParameter:
    given = {name: value for name, value in vars(wish).items() if value is not None}
    start = given.get("start", known.start)
    ratio = start / known.start if known.logarithmic and start > 0.0 else 1.0
    found = replace(known, **{"low": known.low * ratio, "high": known.high * ratio} | given)
    low, high = found.low, found.high
    if wish.start is None and {"low", "high"} <= given.keys() and not low <= start <= high:
        start = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
    logarithmic = (known.logarithmic or known.start == known.low == 0.0) and start > 0.0 and low > 0.0
    return replace(found, start=start, logarithmic=logarithmic)


def _faults(parameter: FitParameter) -> Iterator[Problem]:
    key = parameter.key
    if not parameter.low < parameter.high:
        yield Problem("its lower bound is not below its upper bound", key=key, value=parameter.low, code="bounds")
    elif not math.isnan(parameter.start) and not parameter.low <= parameter.start <= parameter.high:
        message = f"its start value is out of range, {parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip()
        yield Problem(message, key=key, value=f"{parameter.start:g}", code="start-range")
    elif math.isinf(parameter.start):
        yield Problem("has no finite start value", key=key, hint=f"Give a start value: {key}=START", code="start-range")


def _tied(tie: Tie, known: Mapping[str, FitParameter]) -> Iterator[tuple[str, str]]:
    """Keys that the pattern `tie.key` matches, each with the key to which it is tied. The text that matches `*` replaces `*` in
    `tie.to`.
    """
    pattern = re.compile("([^.]*)".join(map(re.escape, tie.key.split("*"))))
    for key in known:
        if (match := pattern.fullmatch(key)) is not None:
            to = tie.to
            for part in match.groups():
                to = to.replace("*", part, 1)
            yield key, to


def _tie_faults(ties: Sequence[Tie], free: Mapping[str, FitParameter]) -> Iterator[Problem]:
    for key, count in Counter(tie.key for tie in ties).items():
        if count > 1:
            yield Problem("is tied twice", key=key, code="tie")
    for tie in ties:
        if tie.to not in free:
            yield Problem(f"is tied to {tie.to}, which is not free", key=tie.key, meant=tie.to, choices=tuple(free), code="tie")


def _unknown(pattern: str, known: Mapping[str, FitParameter]) -> Problem:
    owner = pattern.partition(".")[0]
    choices = tuple(key for key in known if key.partition(".")[0] == owner) or _roots(known)
    hint = did_you_mean(pattern, tuple(known)) or ""
    if pattern.count(".") == 1:  # parameters of stages and actuators: JOINT.NAME
        broken = [one.message for one in STAGES.broken()]
        hint = ". ".join([hint_of_own(pattern, tuple(known), "stages and actuators"), *broken])
    return Problem("no parameter has this key", key=pattern, hint=hint, choices=choices, code="unknown-key")


def _roots(known: Mapping[str, FitParameter]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"{key.rpartition('.')[0]}.*" if "." in key else key for key in known))
