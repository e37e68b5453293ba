"""What the signals of a scenario cannot be, and hardly mean: changes after the run's end, places and torques beyond limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import Problem
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.findings import LARGEST
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals.base import Signal
from asrsim.signals.combine import Sum

ROUNDING = 1e-9
"""Share of a limit by which a number is not beyond it."""
LOOKS = 2000
"""Points of the run at which a signal is looked at."""
FARTHEST = 1e6
"""rad or m: a wanted position beyond it has lost the digits in which a motion differs from rest."""
MOST_JUMPS = 100
"""Jumps a step that are still worked through."""


def signal_faults(scenario: Scenario) -> Iterator[Problem]:
    """Errors: signals that fail, that are not finite or absurdly large, or that jump more often than anybody would wait for."""
    steps = scenario.duration / scenario.step
    wanted = _wanted(scenario)
    for key, signal in _signals(scenario):
        section = key.rpartition(".")[0]
        try:
            with np.errstate(all="ignore"):
                time = _grid(scenario, signal)
                values = signal.values(time)
                bad = np.flatnonzero(~np.isfinite(values))
        except Exception as error:  # a user's own signal may raise anything
            yield Problem(f"the signal fails: {type(error).__name__}: {error}", key=key, code="signal")
            continue
        jumps = len(time) - LOOKS - 1
        if bad.size:
            yield Problem(f"is not finite at {time[bad[0]]:g} s", key=key, code="signal")
        elif (largest := float(np.abs(values).max())) > (bound := LARGEST if section not in wanted else FARTHEST):
            message = f"is larger than {bound:g}, {'where no joint goes' if section in wanted else 'which no robot has'}"
            yield Problem(message, key=key, value=largest, code="signal")
        elif jumps > MOST_JUMPS * max(steps, LOOKS):
            message = f"jumps {jumps} times in {steps:.0f} steps, too often to follow"
            yield Problem(message, key=key, code="signal")


def signal_doubts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about the signals of a scenario on its robot, as the scenario changes it; none of them is at fault."""
    for key, signal in _signals(scenario):
        for part, one in _parts(key, signal):
            yield from _late(scenario, part, one)
    yield from _presets(scenario, robot)
    yield from _beyond_limits(scenario, robot)
    yield from _beyond_torques(scenario, robot)


def _signals(scenario: Scenario) -> Iterator[tuple[str, Signal]]:
    """Every signal of the scenario, with its key."""
    tables: dict[str, Mapping[str, Signal]] = {f"references.{joint}": own for joint, own in scenario.references.items()}
    tables |= {"external_torques": scenario.external_torques, **_wanted(scenario)}
    for section, table in tables.items():
        for name, signal in table.items():
            yield f"{section}.{name}", signal
    for key, signal, _ in _wrenches(scenario):
        yield key, signal


def _wanted(scenario: Scenario) -> dict[str, Mapping[str, Signal]]:
    """Link positions that are wanted or prescribed, by section and joint."""
    return {"desired": scenario.desired, "motion": scenario.motion, **scenario.trajectories}


def _wrenches(scenario: Scenario) -> Iterator[tuple[str, Signal, str]]:
    """Key, signal and kind (force or torque) of each axis of a wrench."""
    for index, wrench in enumerate(scenario.wrenches):
        for kind, axes in (("force", wrench.force), ("torque", wrench.torque)):
            for axis, signal in enumerate(axes):
                if signal is not None:
                    yield f"wrenches.{index}.{kind}.{axis}", signal, kind


def _parts(key: str, signal: Signal) -> Iterator[tuple[str, Signal]]:
    """A signal, or the terms of a sum."""
    if not isinstance(signal, Sum):
        yield key, signal
        return
    for index, term in enumerate(signal.terms):
        yield from _parts(f"{key}.sum.{index}", term)


def _grid(scenario: Scenario, signal: Signal) -> Array:
    """Times of the run in order, the signal's jumps among them."""
    end = scenario.duration
    return np.sort(np.concatenate([np.linspace(0.0, end, LOOKS + 1), signal.jumps(0.0, end)]))


def over_run(scenario: Scenario, signal: Signal) -> tuple[Array, Array]:
    """Times of `_grid`, and values there."""
    time = _grid(scenario, signal)
    return time, signal.values(time)


def _extremes(scenario: Scenario, signal: Signal) -> tuple[float, float]:
    """The least and the largest value over the run."""
    _, values = over_run(scenario, signal)
    return float(values.min()), float(values.max())


def _late(scenario: Scenario, key: str, signal: Signal) -> Iterator[Problem]:
    """A signal that rests for the whole run and changes after its end."""
    end = scenario.duration
    least, largest = _extremes(scenario, signal)
    if largest > least or signal.jumps(0.0, end).size:
        return
    try:
        # Changes later than a hundred times the run are no slip of a digit.
        later = np.sort(np.concatenate([signal.jumps(end, 100.0 * end), np.linspace(end, 100.0 * end, 2001)]))
        changed = np.flatnonzero(signal.values(later) != least)
    except Exception:
        return  # what a signal is after the run's end is no fault of the run
    if changed.size:
        message = f"rests for the whole run of {end:g} s and changes only after its end"
        yield Problem(message, key=key, value=f"{later[changed[0]]:.4g} s", code="late-reference")


def _presets(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Stiffness presets beyond the springs' deflection limit: there the springs are clipped, not stiffer."""
    for block in robot.actuators:
        actuator, names = ACTUATORS.get(block.actuator), MODES[block.mode].references
        signal = scenario.references_of(block.joint).get("stiffness_preset")
        limit = block.values().get("max_deflection", math.inf)
        if signal is None or actuator.adjuster or actuator.motors < 2 or "stiffness_preset" not in names:
            continue
        largest = max(map(abs, _extremes(scenario, signal)))
        if largest > limit:
            key = reference_key(scenario, block, "stiffness_preset")
            message = f"is beyond the deflection limit of the springs of '{block.joint}', {limit:g} rad: they are clipped there"
            yield Problem(message, key=key, value=largest, code="large-preset")


def reference_key(scenario: Scenario, block: ActuatorBlock, name: str) -> str:
    """Where the reference of a joint stands in the scenario."""
    return f"references.{block.joint if name in scenario.references.get(block.joint, {}) else '*'}.{name}"


def _beyond_limits(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Places at which a link is wanted, and which its joint's limits do not let it reach."""
    for key, name, least, largest in _places(scenario, robot):
        joint = robot.joint(name)
        if joint.lower is None or joint.upper is None:
            continue
        if least < joint.lower or largest > joint.upper:
            message = f"leaves the limits of '{name}', {joint.lower:g} to {joint.upper:g}"
            value = f"{least:g} to {largest:g}"
            yield Problem(message, key=key, value=value, code="reference-limits")


def _beyond_torques(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Torques, asked for or declared as a range, that the joint's effort limit or the motor's largest torque cuts."""
    for block in robot.actuators:
        mode, given = MODES[block.mode], scenario.references_of(block.joint)
        names = mode.references_of(ACTUATORS.get(block.actuator).motors) if mode.units[0] == "N m" else ()
        for motor, name in enumerate(names, start=1):
            what, limit = "the joint's effort limit", robot.joint(block.joint).effort
            if mode.motor:
                what, limit = f"motor {motor}'s largest torque", block.values().get(f"motor_{motor}_max_torque")
            asked = {reference_key(scenario, block, name): _extremes(scenario, given[name])} if name in given else {}
            for key, bounds in asked.items():
                if limit and max(map(abs, bounds)) > limit * (1.0 + ROUNDING):
                    message = f"is cut at {what}, {limit:g} N m"
                    shown = " to ".join(dict.fromkeys(f"{bound:g}" for bound in bounds))
                    yield Problem(message, key=key, value=f"{shown} N m", code="reference-limits")


def _places(scenario: Scenario, robot: Robot) -> Iterator[tuple[str, str, float, float]]:
    """Key, joint, and the extremes of the link's positions that references ask for, and `desired` and the like."""
    time = np.linspace(0.0, scenario.duration, 501)
    for block in robot.actuators:
        mode, actuator, given = MODES[block.mode], ACTUATORS.get(block.actuator), scenario.references_of(block.joint)
        names = mode.references_of(actuator.motors)
        first = names[0]
        if mode.units[0] != "rad" or first not in given:
            continue
        if first != "reference_1" or actuator.motors < 2:
            yield reference_key(scenario, block, first), block.joint, *_extremes(scenario, given[first])
        elif all(name in given for name in names):
            motors = zip(*(given[name].values(time) for name in names), strict=True)
            places = [actuator.equilibrium_position(*positions) for positions in motors]
            yield reference_key(scenario, block, first), block.joint, min(places), max(places)
    for section, table in _wanted(scenario).items():
        for joint in robot.moving_joints:
            signal = for_joint(table, joint.name)
            if signal is not None:
                key = f"{section}.{joint.name if joint.name in table else '*'}"
                yield key, joint.name, *_extremes(scenario, signal)
