"""Warnings for a valid scenario: values that are probably mistakes, and keys without effect.

To add a warning, write a generator and list it in `DOUBTS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import Problem, listed
from asrsim.joint_units import reference_unit
from asrsim.quantities import linear_unit
from asrsim.robot import Robot
from asrsim.robot.findings import beyond_a_turn
from asrsim.robot.mounting import reference_names
from asrsim.scenario.data import Scenario, for_joint
from asrsim.scenario.kinds import prescribes_motion, released_order
from asrsim.scenario.names import shadowed_entries
from asrsim.scenario.signal_checks import ROUNDING, extremes, hidden_jump, over_run, reference_key, signals_of, wanted_positions
from asrsim.scenario.starts import start_positions, start_velocities
from asrsim.signals.base import Signal
from asrsim.signals.combine import Delay, Sum
from asrsim.signals.playback import Playback

STRONGEST = 30.0
"""Largest plausible gravity, m/s^2; Jupiter's gravity is 24.8 m/s^2."""
LATEST = 1.0
"""Largest plausible delay, s."""
STEPS = (1e-6, 0.05)
"""Range of plausible time steps, s: from motor electronics to slow robot controllers."""
_CONTRADICTS = 1e-3
"""Difference of initial values above which they contradict each other, rad and rad/s (m and m/s)."""
UNSTABLE = 2.0
"""Largest product of decay rate and time step for which explicit damping is stable. Above it, the motion changes its sign in
every step and grows."""


def doubts(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about a scenario. `asrsim.robot.doubts.warnings_of` gives the warnings about its actuators.

    robot: robot with the scenario's changes.
    """
    for check in DOUBTS:
        yield from map(scenario.placed, check(scenario, robot))


# -- numbers -----------------------------------------------------------------------------------------------------------


def _gravity_and_step(scenario: Scenario, _robot: Robot) -> Iterator[Problem]:
    if math.hypot(*scenario.gravity) > STRONGEST:
        yield Problem("is stronger than on any planet (in m/s^2)", key="gravity", value=scenario.gravity[2], code="gravity")
    elif scenario.gravity[2] > 0.0:
        message = "points upwards: z points up, so weight is negative in z"
        yield Problem(message, key="gravity", value=f"{scenario.gravity[2]:g}", code="gravity")
    if not STEPS[0] <= scenario.step <= STEPS[1]:
        message = f"is unusual: time steps of robot simulations are {STEPS[0]:g} to {STEPS[1]:g} s"
        yield Problem(message, key="step", value=f"{scenario.step:g} s", code="odd-step")


def _orientations(scenario: Scenario, _robot: Robot) -> Iterator[Problem]:
    poses = scenario.task.poses if scenario.task is not None else ()
    given = {f"world.objects.{one.name}.rpy": one.rpy for one in scenario.world.objects}
    given |= {f"task.poses.{index}.rpy": pose.rpy for index, pose in enumerate(poses) if pose.rpy is not None}
    for key, angles in {"base.rpy": scenario.base_rpy, **given}.items():
        if beyond_a_turn(angles):
            message = "turns by more than one revolution; angles are in rad"
            yield Problem(message, key=key, value=_shown(angles), hint="90 degrees are 1.5708 rad", code="rpy-in-degrees")


def _delays(scenario: Scenario, _robot: Robot) -> Iterator[Problem]:
    """Warnings about delays that are probably in ms."""
    for section, table in (("commands", scenario.command_imperfections), ("sensors", scenario.sensor_imperfections)):
        for joint, imperfections in table.items():
            if imperfections.delay >= min(LATEST, scenario.duration):
                message = f"is {LATEST:g} s or more, or as long as the run (delays are in s)"
                yield Problem(
                    message, key=f"imperfections.{section}.{joint}.delay", value=imperfections.delay, code="long-delay"
                )


def _shown(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


# -- the start ---------------------------------------------------------------------------------------------------------


def _default_start(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about joints that start at 0 by default, but whose limits exclude 0."""
    if scenario.initial_equilibrium or "*" in scenario.initial_positions or prescribes_motion(scenario.engine):
        return
    for joint in robot.moving_joints:
        low, high = joint.stops
        if joint.name not in scenario.initial_positions and not low <= 0.0 <= high:
            message = f"starts at 0, outside its limits, {low:g} to {high:g}: its stop pushes it back"
            hint = f"Set its initial position under `initial`, for example to {low if low > 0.0 else high:g}"
            yield Problem(message, key=f"initial.{joint.name}", hint=hint, code="default-start")


def _start_without_effect(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about initial values that do not act: those of coupled joints that contradict their masters, and those of motors
    that have no motion of their own."""
    if scenario.initial_equilibrium:
        if prescribes_motion(scenario.engine):
            yield Problem("has no effect: the motion of the links is prescribed", key="initial", code="prescribed-start")
        return
    for joint in robot.moving_joints if prescribes_motion(scenario.engine) else ():
        key = joint.name if joint.name in scenario.initial_positions else "*"
        start, motion = scenario.initial_positions.get(key), for_joint(scenario.motion, joint.name)
        first = None if motion is None else float(motion.values(np.zeros(1))[0])
        if start is not None and first is not None and abs(start - first) > _CONTRADICTS:
            message = f"only motors start there: the prescribed motion of '{joint.name}' starts at {first:g}"
            yield Problem(message, key=f"initial.{key}", value=start, code="prescribed-start")
    positions = start_positions(scenario, robot)
    tables = (
        (scenario.initial_positions, positions),
        (scenario.initial_velocities, start_velocities(scenario, robot, positions)),
    )
    for stated, found in tables:
        for name in stated.keys() & found.keys():
            if abs(stated[name] - found[name]) > _CONTRADICTS:
                what = "position" if found is positions else "velocity"
                message = f"has no effect: '{name}' follows another joint, and its initial {what} is {found[name]:.6g}"
                yield Problem(message, key=f"initial.{name}", value=stated[name], code="coupled-start")
    for block in robot.actuators:
        mode = MODES[block.mode]
        for key in (block.joint, "*"):
            if not mode.motor and (key in scenario.initial_motor_positions or key in scenario.initial_motor_velocities):
                why = "motors stand at their references" if mode.spring else "no motor moves"
                message = f"initial values of motors have no effect: in mode {mode.number}, {why}"
                yield Problem(message, key=f"initial.{key}", code="motorless-start")


# -- references --------------------------------------------------------------------------------------------------------


def _late(scenario: Scenario, _robot: Robot) -> Iterator[Problem]:
    """Warnings about signals that are constant during the run and change only after its end."""
    end = scenario.duration
    # A change later than a hundred times the duration of the run is assumed to be intended, and not a typing error.
    later = np.linspace(end, 100.0 * end, 2001)
    for key, signal in signals_of(scenario):
        least, largest = extremes(scenario, signal)
        with suppress(Exception):  # errors after the end of the run do not concern the run
            if least == largest and not signal.jumps(0.0, end).size and (signal.values(later) != least).any():
                message = f"is constant during the whole run of {end:g} s and changes only after its end"
                yield Problem(message, key=key, code="late-reference")


def _played_outside(scenario: Scenario, _robot: Robot) -> Iterator[Problem]:
    """Warnings: played recordings that end before the run begins, or begin after its end."""
    for key, signal in signals_of(scenario):
        for played in _playbacks(signal):
            first, last = (float(played.samples[0][place]) for place in (0, -1))
            if first >= scenario.duration or last <= 0.0:
                message = (
                    f"plays nothing of {played.file.name}: its samples lie from {first:g} to {last:g} s, and the run lasts "
                    f"from 0 to {scenario.duration:g} s"
                )
                start = f"`start: {played.earliest - first:.9g}`"
                hint = f"{start} in all playbacks of the file shifts the first sample of this column to the start of the run"
                yield Problem(message, key=key, hint=hint, code="playback-outside")


def _played_units(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings: recorded columns whose unit differs from the unit of the driven quantity, such as a velocity played as a
    position.
    """
    driven: dict[str, tuple[Signal, set[str]]] = {}
    for key, signal, unit in _units(scenario, robot):
        driven.setdefault(key, (signal, set()))[1].add(unit)
    for key, (signal, units) in driven.items():
        for played in _unchanged(signal):
            if played.units and not units.intersection(played.units):
                unit = "a pure number" if played.units[0] == "1" else f"in {played.units[0]}"
                message = f"plays '{played.column}' of {played.file.name}, which is {unit}"
                message += f", as a quantity in {' or '.join(sorted(units))}"
                hint = "Play another column, or state under `scale` the factor that converts it"
                yield Problem(message, key=key, hint=hint, code="played-unit")


def _units(scenario: Scenario, robot: Robot) -> Iterator[tuple[str, Signal, str]]:
    """Key, signal and unit of each quantity that a signal drives; an entry for several joints occurs once for each joint."""
    for block in robot.actuators:
        mode, actuator, given = MODES[block.mode], ACTUATORS.get(block.actuator), scenario.references_of(block.joint)
        for place, name in enumerate(mode.references_of(actuator.motors)):
            if name in given:
                unit = reference_unit(actuator, mode, place + 1)
                yield reference_key(scenario, block, name), given[name], _unit_at(robot, block.joint, unit)
    tables = {"external_torques": (scenario.external_torques, "N m")}
    tables |= {section: (table, "rad") for section, table in wanted_positions(scenario).items()}
    for section, (table, unit) in tables.items():
        for joint in robot.moving_joints:
            signal = for_joint(table, joint.name)
            if signal is not None:
                key = f"{section}.{joint.name if joint.name in table else '*'}"
                yield key, signal, _unit_at(robot, joint.name, unit)
    for index, wrench in enumerate(scenario.wrenches):
        for kind, axes, unit in (("force", wrench.force, "N"), ("torque", wrench.torque, "N m")):
            yield from ((f"wrenches.{index}.{kind}.{axis}", one, unit) for axis, one in enumerate(axes) if one is not None)


def _unit_at(robot: Robot, joint: str, unit: str) -> str:
    """Unit of a joint's quantity, from its unit for a revolute joint."""
    return linear_unit(unit) if robot.joint(joint).kind == "prismatic" else unit


def _unchanged(signal: Signal) -> Iterator[Playback]:
    """Playbacks in a signal whose numbers act without a factor."""
    if isinstance(signal, Playback) and abs(signal.scale) == 1.0:
        yield signal
    elif isinstance(signal, Delay):
        yield from _unchanged(signal.of)
    elif isinstance(signal, Sum):
        for term in signal.terms:
            yield from _unchanged(term)


def _playbacks(signal: Signal) -> Iterator[Playback]:
    """Playbacks in a signal, except those that a `delay` shifts."""
    if isinstance(signal, Playback):
        yield signal
    parts: Iterable[Any] = vars(signal).values() if is_dataclass(signal) and not isinstance(signal, Delay) else ()
    for value in parts:
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, Signal):
                yield from _playbacks(part)


def _beyond_limits(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about references beyond the limits of joints, motors and springs."""
    # Evaluate each signal once, since joints may share it.
    known: dict[int, tuple[float, float]] = {}

    def ends(signal: Signal) -> tuple[float, float]:
        if id(signal) not in known:
            known[id(signal)] = extremes(scenario, signal)
        return known[id(signal)]

    for block in robot.actuators:
        mode, actuator, joint = MODES[block.mode], ACTUATORS.get(block.actuator), robot.joint(block.joint)
        given, values = scenario.references_of(block.joint), block.values()
        names = [name for name in mode.references_of(actuator.motors) if name in given]
        key = {name: reference_key(scenario, block, name) for name in names}
        motors = "reference_1" in mode.references and actuator.motors > 1
        if mode.units[0] == "rad" and motors and len(names) == actuator.motors:
            time = np.linspace(0.0, scenario.duration, 501)
            positions = zip(*(given[name].values(time) for name in names), strict=True)
            equilibria = [actuator.equilibrium_position(*position) for position in positions]
            yield from _outside(robot, key[names[0]], block.joint, (min(equilibria), max(equilibria)))
        elif mode.units[0] == "rad" and not motors and mode.references[0] in key:
            first = mode.references[0]
            yield from _outside(robot, key[first], block.joint, ends(given[first]))
        for motor, name in enumerate(mode.references_of(actuator.motors) if mode.units[0] == "N m" else (), start=1):
            if name not in given:
                continue
            limited, limit = "the joint's effort limit", joint.effort
            if mode.motor:
                limited, limit = f"motor {motor}'s largest torque", values.get(f"motor_{motor}_max_torque")
            low, high = ends(given[name])
            if limit and max(-low, high) > limit * (1.0 + ROUNDING):
                message = f"is clipped to {limited}, {limit:g} N m"
                yield Problem(message, key=key[name], value=f"{low:g} to {high:g} N m", code="reference-limits")
        limit = values.get("max_deflection", math.inf)
        if "stiffness_preset" in key and actuator.motors > 1 and not actuator.adjuster:
            largest = max(map(abs, ends(given["stiffness_preset"])))
            if largest > limit:
                message = f"is beyond the deflection limit of the springs, {limit:g} rad: larger deflections are clipped"
                yield Problem(message, key=key["stiffness_preset"], value=largest, code="large-preset")
    for section, table in wanted_positions(scenario).items():
        for joint in robot.moving_joints:
            signal = for_joint(table, joint.name)
            if signal is not None:
                where = f"{section}.{joint.name if joint.name in table else '*'}"
                yield from _outside(robot, where, joint.name, ends(signal))


def _outside(robot: Robot, key: str, name: str, ends: tuple[float, float]) -> Iterator[Problem]:
    low, high = robot.joint(name).stops
    if math.isfinite(low) and math.isfinite(high) and (ends[0] < low or ends[1] > high):
        message = f"leaves the limits of '{name}', {low:g} to {high:g}"
        reached = f"{ends[0]:g}" if ends[0] == ends[1] else f"{ends[0]:g} to {ends[1]:g}"
        yield Problem(message, key=key, value=reached, code="reference-limits")


def _sudden_turns(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about positions of joints without limits that jump by more than a turn, since such positions are probably in
    degrees."""
    found: dict[str, tuple[str, Signal]] = {}
    for block in robot.actuators:
        mode, actuator, given = MODES[block.mode], ACTUATORS.get(block.actuator), scenario.references_of(block.joint)
        several = "reference_1" in mode.references and actuator.motors > 1
        names = mode.references_of(actuator.motors)[: actuator.motors if several else 1]
        for name in names if mode.units[0] == "rad" else ():
            if name in given:
                found[reference_key(scenario, block, name)] = block.joint, given[name]
    for section, table in wanted_positions(scenario).items():
        found |= {f"{section}.{name}": (name, signal) for name, signal in table.items() if name != "*"}
    for key, (name, signal) in found.items():
        joint = robot.joint(name)
        if joint.kind == "prismatic" or all(map(math.isfinite, joint.stops)):
            continue
        _, values = over_run(scenario, signal)
        jump = float(np.abs(np.diff(values, prepend=for_joint(scenario.initial_positions, name, 0.0))).max())
        if jump > math.tau + ROUNDING:
            message = f"jumps by {jump / math.tau:.3g} turns of '{name}'; positions are in rad"
            hint = f"{jump:.4g} degrees are {math.radians(jump):.4g} rad" if jump < 1e4 else None
            yield Problem(message, key=key, value=f"{jump:g} rad", hint=hint, code="reference-turns")


def _hidden_jumps(scenario: Scenario, _robot: Robot) -> Iterator[Problem]:
    for key, signal in signals_of(scenario):
        time = hidden_jump(scenario, signal)
        if time is not None:
            message = "jumps at a time that its `jumps` does not return: errors of the run are of first order in the step there"
            hint = "Return this time from `jumps(start, end)` of the class; for a playback, choose linear or hold"
            yield Problem(message, key=key, value=f"{time:.9g} s", hint=hint, code="hidden-jump")


def _missing_references(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about references without effect, and missing references."""
    common = scenario.references.get("*", {})
    for block in robot.actuators:
        names, own = reference_names(block), scenario.references.get(block.joint, {})
        unused = set(MODES[block.mode].references_of(ACTUATORS.get(block.actuator).motors)).difference(names)
        for name in unused.intersection(own):
            message = f"has no effect: an actuator of type {block.actuator} has no second reference"
            yield Problem(message, key=f"references.{block.joint}.{name}", code="unused-reference")
        for name in names:
            if name not in own and name not in common and not scenario.computes_reference(block.joint):
                message = f"joint '{block.joint}' has no {name}, so this reference keeps its initial value"
                yield Problem(message, key=f"references.{block.joint}", code="missing-reference")


def _planned(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings about references and inverse dynamics that a Cartesian task replaces."""
    if scenario.task is None:
        return
    for block in robot.actuators:
        mode, given = MODES[block.mode], scenario.references_of(block.joint)
        moved = "" if scenario.computes_reference(block.joint) else ", in which this joint stays at its initial position"
        # The task takes the presets from the references.
        for name in mode.references[: 1 if mode.mapped else None]:
            if name in given:
                message = f"has no effect on '{block.joint}': the Cartesian task computes this reference{moved}"
                yield Problem(message, key=reference_key(scenario, block, name), code="planned-reference")
    if any(scenario.inverse_dynamics.values()):
        yield Problem(
            "has no effect: the Cartesian task computes all references", key="inverse_dynamics", code="planned-reference"
        )


# -- no effect ---------------------------------------------------------------------------------------------------------


def _without_effect(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    for key in shadowed_entries(scenario, robot):
        message = "has no effect: every joint that it could apply to has a separate entry"
        yield Problem(message, key=key, code="unused-entry")
    driven = {block.joint for block in robot.actuators}
    passive = [joint.name for joint in robot.moving_joints if joint.name not in driven and not joint.mimic]
    if "*" in scenario.link_damping and passive:
        message = f"acts on joints with actuators only, not on {listed(passive, 4)}"
        hint = "Passive joints have the damping of the robot's file: <dynamics damping='...'/>"
        yield Problem(message, key="link_damping.*", hint=hint, code="passive-damping")
    for name, damping in scenario.link_damping.items():
        if damping.ratio and not damping.inertia:
            message = "a ratio without 'inertia' has no effect: damping is 2 ratio sqrt(inertia stiffness)"
            yield Problem(message, key=f"link_damping.{name}", value=damping.ratio, code="ratio-without-inertia")
    for name, imperfections in scenario.sensor_imperfections.items():
        modes = {block.mode for block in robot.actuators if name in ("*", block.joint)}
        if imperfections.active and modes and not any(MODES[mode].controller for mode in modes):
            message = f"has no effect: no controller reads this sensor in mode {', '.join(map(str, sorted(modes)))}"
            yield Problem(message, key=f"imperfections.sensors.{name}", code="unused-effect")


def _contact_words(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    if robot.contact_words and not scenario.world.empty:
        message = "words of the robot's file that act in contacts are not read; robots have a friction coefficient of 1"
        yield Problem(message, key="world", value=listed(robot.contact_words, 6), code="contact-words")


# -- toolbox stepping --------------------------------------------------------------------------------------------------


def _released(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Warnings in toolbox stepping about motor controllers that diverge at the time step, and about parameters and keys that
    the toolbox ignores."""
    if released_order(scenario.stepping):
        for name, imperfections in scenario.sensor_imperfections.items():
            if imperfections.active:
                key = f"imperfections.sensors.{name}"
                yield Problem("toolbox stepping ignores imperfections of sensors", key=key, code="released-model")
        for key, count in (("substeps", scenario.substeps), ("motor_substeps", scenario.motor_substeps)):
            if count not in (None, 1):
                yield Problem("toolbox stepping takes no substeps", key=key, value=count, code="released-model")
    for block in robot.actuators if released_order(scenario.stepping) else ():
        mode, actuator, values = MODES[block.mode], ACTUATORS.get(block.actuator), block.values()
        ignored = [one.name for one in actuator.all_parameters() if one.optional and values[one.name] != one.default]
        if ignored:
            message = f"toolbox stepping ignores {', '.join(ignored)} of '{block.joint}'"
            yield Problem(message, key="stepping", value=scenario.stepping, code="released-model")
        for i in range(1, actuator.motors + 1) if mode.motor and mode.controller else ():
            damping = values[f"controller_{i}_derivative"] + values[f"motor_{i}_damping"]
            gain = scenario.step * damping / values[f"motor_{i}_inertia"]
            if gain > UNSTABLE:
                message = f"the controller of motor {i} of '{block.joint}' diverges: step * (ctrl_D + mot_D) / mot_J is above 2"
                yield Problem(message, key="step", value=f"{gain:.3g} at {scenario.step * 1e3:g} ms", code="motor-gains")


DOUBTS: tuple[Callable[[Scenario, Robot], Iterator[Problem]], ...] = (
    _default_start,
    _start_without_effect,
    _gravity_and_step,
    _orientations,
    _delays,
    _without_effect,
    _late,
    _played_outside,
    _played_units,
    _beyond_limits,
    _sudden_turns,
    _hidden_jumps,
    _missing_references,
    _planned,
    _contact_words,
    _released,
)
