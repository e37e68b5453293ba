"""What the signals of a scenario hardly mean: changes that come too late or too fast, places and loads beyond the arm."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import Problem
from asrsim.robot import ActuatorBlock, Robot
from asrsim.robot.sanity import own_weight
from asrsim.samples import Array
from asrsim.scenario.data import Scenario, for_joint
from asrsim.signals.base import Signal
from asrsim.signals.combine import Sum

LOOKS = 2000
"""Points of the run at which a signal is looked at."""
BETWEEN = (0.5, 0.382)
"""Places within a step at which a signal is compared with the line between its ends; two, since one may be a node."""
ALIASED = 0.4
"""Share of a signal's range by which it leaves that line: a sinusoid does from 0.87 of half the step rate on."""
OFTEN = 0.05
"""Share of the steps that do so, from which on it is no accident."""
ABSURD = 100.0
"""Times the arm's own weight, or its moment, that no load on it is."""


def signal_doubts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about the signals of a scenario on its robot, as the scenario changes it. What fails is an error of its own."""
    with np.errstate(all="ignore"):
        for key, signal in _signals(scenario):
            for part, one in _parts(key, signal):
                yield from _late(scenario, part, one)
                yield from _fast(scenario, part, one)
        yield from _presets(scenario, robot)
        yield from _beyond_limits(scenario, robot)
        yield from _loads(scenario, robot)


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
    learned = scenario.learning
    return {
        "desired": scenario.desired,
        "motion": scenario.motion,
        "ilc.trajectory": learned.get("trajectory", {}),
        **{f"ilc.trajectories.{name}": table for name, table in learned.get("trajectories", {}).items()},
    }


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


def _values(signal: Signal, time: Array) -> Array:
    """Values at `time` (n,); none where the signal fails or is not finite."""
    try:
        values = np.asarray(signal.values(time), dtype=float)
    except Exception:  # a user's own signal may raise anything
        return np.empty(0)
    return values if np.isfinite(values).all() else np.empty(0)


def _over_run(scenario: Scenario, signal: Signal) -> Array:
    """Values over the run, its jumps among them; none where the signal fails."""
    end = scenario.duration
    try:
        jumps = signal.jumps(0.0, end)
    except Exception:
        return np.empty(0)
    return _values(signal, np.concatenate([np.linspace(0.0, end, LOOKS + 1), jumps]))


def _late(scenario: Scenario, key: str, signal: Signal) -> Iterator[Problem]:
    """A signal that rests for the whole run and changes after its end."""
    end = scenario.duration
    values = _over_run(scenario, signal)
    if not values.size or np.ptp(values) > 0.0 or signal.jumps(0.0, end).size:
        return
    # Changes later than a hundred times the run are no slip of a digit.
    later = np.sort(np.concatenate([signal.jumps(end, 100.0 * end), np.linspace(end, 100.0 * end, 2001)]))
    changed = np.flatnonzero(_values(signal, later) != values[0])
    if changed.size:
        message = f"rests for the whole run of {end:g} s and changes only after its end"
        yield Problem(message, key=key, value=f"{later[changed[0]]:.4g} s", code="late-reference")


def _fast(scenario: Scenario, key: str, signal: Signal) -> Iterator[Problem]:
    """A signal of which the steps see another one: it swings between two of them."""
    steps, step = int(scenario.duration / scenario.step), scenario.step
    first = np.unique(np.linspace(0, max(steps - 1, 0), LOOKS).astype(int))
    # The ends from within: what jumps from step to step jumps in none.
    start, end, *between = (_values(signal, (first + share) * step) for share in (1e-6, 1.0 - 1e-6, *BETWEEN))
    if not all(one.size for one in (start, end, *between)):
        return
    lines = [start + (end - start) * share for share in BETWEEN]
    off = np.max(np.abs(np.subtract(between, lines)), axis=0)
    reach = np.ptp([start, end, *between])
    # Steps hold a jump within them by its mean.
    jumps = np.diff(np.searchsorted(signal.jumps(0.0, scenario.duration), [first * step, (first + 1) * step]), axis=0)[0]
    beyond = np.flatnonzero((off > ALIASED * reach) & (jumps != 1))
    if reach > 0.0 and len(beyond) > max(OFTEN * len(first), 2):
        message = f"changes too fast for steps of {step:g} s, which see another signal"
        value = f"from {first[beyond[0]] * step:.4g} s on"
        yield Problem(message, key=key, value=value, hint="Take a shorter step, or a lower frequency", code="aliased")


def _presets(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Stiffness presets beyond the springs' deflection limit: there the springs are clipped, not stiffer."""
    for block in robot.actuators:
        actuator, names = ACTUATORS.get(block.actuator), MODES[block.mode].references
        signal = scenario.references_of(block.joint).get("stiffness_preset")
        limit = block.values().get("max_deflection", math.inf)
        if signal is None or actuator.adjuster or actuator.motors < 2 or "stiffness_preset" not in names:
            continue
        largest = float(np.abs(_over_run(scenario, signal)).max(initial=0.0))
        if largest > limit:
            key = _reference_key(scenario, block, "stiffness_preset")
            message = f"is beyond the deflection limit of the springs of '{block.joint}', {limit:g} rad: they are clipped there"
            yield Problem(message, key=key, value=largest, code="large-preset")


def _reference_key(scenario: Scenario, block: ActuatorBlock, name: str) -> str:
    return f"references.{block.joint if name in scenario.references.get(block.joint, {}) else '*'}.{name}"


def _beyond_limits(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Places at which a link is wanted, and which its joint's limits do not let it reach."""
    for key, name, values in _places(scenario, robot):
        joint = robot.joint(name)
        if joint.kind == "continuous" or joint.lower is None or joint.upper is None or not values.size:
            continue
        if values.min() < joint.lower or values.max() > joint.upper:
            message = f"leaves the limits of '{name}', {joint.lower:g} to {joint.upper:g}"
            value = f"{values.min():g} to {values.max():g}"
            yield Problem(message, key=key, value=value, code="reference-limits")


def _places(scenario: Scenario, robot: Robot) -> Iterator[tuple[str, str, Array]]:
    """Key, joint, and the link's positions that references ask for, and `desired` and the like."""
    time = np.linspace(0.0, scenario.duration, 501)
    for block in robot.actuators:
        mode, actuator, given = MODES[block.mode], ACTUATORS.get(block.actuator), scenario.references_of(block.joint)
        first, second = (*mode.references, "")[:2]
        if mode.units[0] != "rad" or first not in given:
            continue
        if first != "reference_1" or actuator.motors < 2:
            yield _reference_key(scenario, block, first), block.joint, _over_run(scenario, given[first])
        elif second in given:
            motors = zip(_values(given[first], time), _values(given[second], time), strict=False)
            places = np.array([actuator.equilibrium_position(*pair) for pair in motors])
            yield _reference_key(scenario, block, first), block.joint, places
    for section, table in _wanted(scenario).items():
        for joint in robot.moving_joints:
            signal = for_joint(table, joint.name)
            if signal is not None:
                key = f"{section}.{joint.name if joint.name in table else '*'}"
                yield key, joint.name, _over_run(scenario, signal)


def _loads(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Loads from outside that are out of all proportion to the arm."""
    force, torque = own_weight(robot)
    loads: list[tuple[str, Signal, str]] = list(_wrenches(scenario))
    for name, signal in scenario.external_torques.items():
        sliding = any(joint.kind == "prismatic" for joint in robot.moving_joints if name in (joint.name, "*"))
        loads.append((f"external_torques.{name}", signal, "force" if sliding else "torque"))
    for key, signal, kind in loads:
        bound, unit, what = (force, "N", "weight") if kind == "force" else (torque, "N m", "weight at its full length")
        largest = float(np.abs(_over_run(scenario, signal)).max(initial=0.0))
        if 0.0 < ABSURD * bound < largest:
            message = f"is {largest / bound:.2g} times the arm's own {what}, {bound:.3g} {unit}"
            value: Any = f"{largest:g} {unit}"
            yield Problem(message, key=key, value=value, code="absurd-load")
