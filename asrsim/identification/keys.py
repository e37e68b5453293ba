"""Parameters that can be free: all numbers of the robot, and zeros, gains, delays, clocks and starts of recordings."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from asrsim.actuators import ACTUATORS
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.identification.task import Task, Tie, Wish
from asrsim.quantities import linear_unit
from asrsim.robot.model import INERTIAS, Robot

CLOCK = "clock"
LATEST = 0.25
"""Largest delay and largest clock offset that a fit allows, s."""
TYPICAL = {
    "rad": 1e-2, "m": 1e-2, "rad/s": 0.1, "m/s": 0.1, "N m": 0.05, "N": 0.5, "N m s/rad": 0.02, "N s/m": 1.0, "s": 2e-3,
    "kg": 0.1, "kg m^2": 1e-3,
}  # fmt: skip
"""Typical size of a parameter whose start value is 0, by unit."""
FACTOR = 1e6
"""Largest factor by which a positive parameter may grow or shrink."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number of the robot or of a recording that a fit may estimate."""

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

    @property
    def size(self) -> float:
        """Typical change of a parameter whose logarithm is not used in the search."""
        return max(abs(self.start), TYPICAL.get(self.unit, 0.1))


def parameters_of(robot: Robot, commands: Sequence[str], channels: Mapping[str, str]) -> dict[str, Parameter]:
    """All parameters by key. commands: recorded commands such as `joint.reference_1`; channels: units of the recorded channels,
    by `joint.quantity`.
    """
    found = [*_of_actuators(robot), *_of_joints(robot), *_of_links(robot), *_of_channels(commands, channels)]
    return {parameter.key: parameter for parameter in found}


def _of_actuators(robot: Robot) -> Iterator[Parameter]:
    for block in robot.actuators:
        values, prismatic = block.values(), robot.joint(block.joint).kind == "prismatic"
        for one in ACTUATORS.get(block.actuator).all_parameters():
            start = values[one.name]
            lossy = any(word in one.name for word in ("damping", "friction", "hysteresis_torque"))
            loss = lossy and not one.name.endswith("_stiffness")
            low, high = one.minimum, one.maximum
            logarithmic = low >= 0.0 and start > 0.0 and math.isfinite(start) and not loss
            if logarithmic:
                low, high = max(low, start / FACTOR), min(high, start * FACTOR)
            unit = linear_unit(one.unit) if prismatic else one.unit
            yield Parameter(
                key=f"{block.joint}.{one.name}", unit=unit, start=start, low=low, high=high, logarithmic=logarithmic
            )


def _of_joints(robot: Robot) -> Iterator[Parameter]:
    for joint in robot.moving_joints:
        name, (force, place) = joint.name, ("N", "m") if joint.kind == "prismatic" else ("N m", "rad")
        for key, unit, start in (
            ("damping", f"{force} s/{place}", joint.damping), ("friction", force, joint.friction),
            ("stribeck_friction", force, joint.stribeck_friction), ("load_friction", "1", joint.load_friction),
        ):  # fmt: skip
            yield Parameter(key=f"{name}.{key}", unit=unit, start=start, low=0.0)
        yield _positive(f"{name}.stribeck_velocity", f"{place}/s", joint.stribeck_velocity)
        yield _positive(f"{name}.passive_stiffness", f"{force}/{place}", joint.spring_stiffness)
        yield Parameter(key=f"{name}.passive_reference", unit=place, start=joint.spring_reference)
        for key, unit in (("position", place), ("velocity", f"{place}/s")):
            yield Parameter(key=f"{name}.initial_{key}", unit=unit, start=math.nan, own=True)


def _of_links(robot: Robot) -> Iterator[Parameter]:
    for link in robot.links:
        if link.mass is None:
            continue
        yield _positive(f"{link.name}.mass", "kg", link.mass)
        for name, value in zip("xyz", link.centre_of_mass, strict=True):
            yield Parameter(key=f"{link.name}.{name}", unit="m", start=value)
        for name, value in zip(INERTIAS, link.inertia or (0.0,) * 6, strict=True):
            key = f"{link.name}.{name}"
            yield _positive(key, "kg m^2", value) if name[1] == name[2] else Parameter(key=key, unit="kg m^2", start=value)


def _positive(key: str, unit: str, start: float) -> Parameter:
    if start <= 0.0:
        return Parameter(key=key, unit=unit, start=start, low=0.0)
    return Parameter(key=key, unit=unit, start=start, low=start / FACTOR, high=start * FACTOR, logarithmic=True)


def _of_channels(commands: Sequence[str], channels: Mapping[str, str]) -> Iterator[Parameter]:
    yield Parameter(key=CLOCK, unit="s", start=0.0, low=-LATEST, high=LATEST, own=True)
    for key in dict.fromkeys((*commands, *channels)):
        unit = channels.get(key, "")
        yield Parameter(key=f"{key}.offset", unit=unit or "rad", start=0.0)
        yield Parameter(key=f"{key}.gain", unit="1", start=1.0, low=1.0 / FACTOR, high=FACTOR, logarithmic=True)
        low = 0.0 if key in commands else -LATEST
        yield Parameter(key=f"{key}.delay", unit="s", start=0.0, low=low, high=LATEST)


def free_parameters(task: Task, known: Mapping[str, Parameter]) -> tuple[list[Parameter], list[Tie]]:
    """Free parameters in the order of the task, and ties between single parameters. Raises InputError with every problem."""
    problems: list[Problem] = []
    free: dict[str, Parameter] = {}
    for pattern, wish in task.free.items():
        # A pattern matches parameters without a finite value only if a start is given.
        given = wish.start is not None
        keys = [
            key for key, one in known.items()
            if key == pattern or (fnmatchcase(key, pattern) and (given or math.isfinite(one.start)))
        ]  # fmt: skip
        if not keys:
            problems.append(_unknown(pattern, known, "free"))
        for key in keys:
            parameter = _wished(known[key], wish)
            problems += _faults(parameter)
            free[key] = parameter
    ties: list[Tie] = []
    for tie in task.ties:
        pairs = list(_tied(tie, known))
        if not pairs:
            problems.append(_unknown(tie.key, known, "tie"))
        elif "*" in tie.key and not any(to in free for _, to in pairs):
            problems.append(Problem(f"is tied to {tie.to}, which matches no free parameter", key=tie.key, code="tie"))
        for key, to in pairs:
            if to not in known:
                problems.append(_unknown(to, known, "tie"))
            elif "*" not in tie.key or to in free:
                ties.append(Tie(key=key, to=to, factor=tie.factor))
    # A tied parameter is not free, even if a pattern matches it.
    for tie in ties:
        free.pop(tie.key, None)
    problems += _tie_faults(ties, free)
    if not free and not problems:
        hint = "Name some: --free 'joint_1.spring_*'"
        problems.append(Problem("no parameter is free", key="free", hint=hint, choices=_roots(known), code="free"))
    if problems:
        raise InputError(problems)
    return list(free.values()), ties


def _wished(known: Parameter, wish: Wish) -> Parameter:
    start = known.start if wish.start is None else wish.start
    ratio = start / known.start if known.logarithmic and start > 0.0 else 1.0
    low = known.low * ratio if wish.low is None else wish.low
    high = known.high * ratio if wish.high is None else wish.high
    if wish.start is None and wish.low is not None and wish.high is not None and not low <= start <= high:
        start = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
    own = known.own if wish.own is None else wish.own
    logarithmic = (known.logarithmic or (known.start == 0.0 and known.low == 0.0 and low > 0.0)) and start > 0.0 and low > 0.0
    return replace(known, start=start, low=low, high=high, own=own, logarithmic=logarithmic)


def _faults(parameter: Parameter) -> Iterator[Problem]:
    key = parameter.key
    if not parameter.low < parameter.high:
        yield Problem("its lower bound is not below its upper bound", key=key, value=parameter.low, code="bounds")
    elif not math.isnan(parameter.start) and not parameter.low <= parameter.start <= parameter.high:
        message = f"its start is out of range, {parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip()
        yield Problem(message, key=key, value=f"{parameter.start:g}", code="start-range")
    elif math.isinf(parameter.start):
        yield Problem("has no finite start", key=key, hint=f"Give one: {key}=START", code="start-range")


def _tied(tie: Tie, known: Mapping[str, Parameter]) -> Iterator[tuple[str, str]]:
    """Keys that a pattern matches, each with the key to which it is tied; the text matched by `*` replaces `*` in that key."""
    pattern = re.compile("([^.]*)".join(map(re.escape, tie.key.split("*"))))
    for key in known:
        if (match := pattern.fullmatch(key)) is not None:
            to = tie.to
            for part in match.groups():
                to = to.replace("*", part, 1)
            yield key, to


def _tie_faults(ties: Sequence[Tie], free: Mapping[str, Parameter]) -> Iterator[Problem]:
    tied: set[str] = set()
    for tie in ties:
        if tie.key in tied:
            yield Problem("is tied twice", key=tie.key, code="tie")
        elif tie.to not in free:
            yield Problem(f"is tied to {tie.to}, which is not free", key=tie.key, hint=f"Free it: --free {tie.to}", code="tie")
        tied.add(tie.key)


def _unknown(pattern: str, known: Mapping[str, Parameter], where: str) -> Problem:
    owner = pattern.partition(".")[0]
    same = tuple(key for key in known if key.partition(".")[0] == owner)
    same = tuple(key for key in same if key.rpartition(".")[2] == pattern.rpartition(".")[2]) or same
    message = "no parameter has this key" if "*" not in pattern and "?" not in pattern else "no key matches this pattern"
    return Problem(
        f"{message} ({where})", key=pattern, hint=did_you_mean(pattern, tuple(known)), choices=same or _roots(known),
        code="unknown-key",
    )  # fmt: skip


def _roots(known: Mapping[str, Parameter]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"{key.rpartition('.')[0]}.*" if "." in key else key for key in known))
