"""What a scenario may say and hardly means: warnings, each with the value that looks wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.errors import Problem
from asrsim.robot import Robot
from asrsim.robot.attributes import beyond_a_turn
from asrsim.robot.sanity import block_doubts
from asrsim.scenario.choices import released_order
from asrsim.scenario.data import Effects, Scenario
from asrsim.signals.base import Signal
from asrsim.signals.combine import Sum

STRONGEST = 30.0
"""m/s^2; Jupiter's gravity is 24.8."""
LATEST = 1.0
"""s of delay."""
LOUDEST = {"commands": 5.0, "sensors": 1.0}
"""Standard deviation of noise, and quantisation steps, in the signal's unit (most often rad)."""


def doubts(scenario: Scenario, robot: Robot, changed: Robot) -> Iterator[Problem]:
    """Warnings about a scenario on its robot, as the file has it and as the scenario changes it."""
    yield from _gravity(scenario)
    yield from _orientations(scenario)
    yield from _effects(scenario)
    yield from _damping(scenario)
    for block in changed.actuators:
        for doubt in block_doubts(block) if block not in robot.actuators else ():
            if doubt.parameter is None or doubt.parameter.origin == "scenario":
                yield Problem(message=doubt.message, key=f"parameters.{block.joint}", value=doubt.value, code=doubt.code)
    signals = [
        (f"references.{joint}.{name}", signal) for joint, own in scenario.references.items() for name, signal in own.items()
    ]
    signals += [(f"external_torques.{joint}", signal) for joint, signal in scenario.external_torques.items()]
    for key, signal in signals:
        for part, one in _parts(key, signal):
            yield from _late(scenario, part, one)
    yield from _presets(scenario, changed)
    yield from _not_released(scenario, changed)


def _gravity(scenario: Scenario) -> Iterator[Problem]:
    strength = math.hypot(*scenario.gravity)
    shown = f"{strength:g} m/s^2"
    if strength > STRONGEST:
        yield Problem(message="is stronger than on any planet (in m/s^2)", key="gravity", value=shown, code="gravity")
    elif scenario.gravity[2] > 0.0:
        message = "points upwards: z points up, so weight is negative in z"
        yield Problem(message=message, key="gravity", value=f"{scenario.gravity[2]:g}", code="gravity")


def _orientations(scenario: Scenario) -> Iterator[Problem]:
    poses = scenario.task.poses if scenario.task is not None else ()
    given = [
        ("base.rpy", scenario.base_rpy),
        *((f"world.objects.{one.name}.rpy", one.rpy) for one in scenario.world.objects),
    ]
    given += [(f"task.poses.{index}.rpy", pose.rpy) for index, pose in enumerate(poses) if pose.rpy is not None]
    for key, angles in given:
        if beyond_a_turn(angles):
            shown = ", ".join(f"{angle:g}" for angle in angles)
            message = "turns by more than once round; angles are in rad"
            yield Problem(message=message, key=key, value=shown, hint="90 degrees are 1.5708 rad", code="rpy-in-degrees")


def _effects(scenario: Scenario) -> Iterator[Problem]:
    for section, table in (("commands", scenario.command_effects), ("sensors", scenario.sensor_effects)):
        for joint, effects in table.items():
            yield from _beyond_reason(scenario, f"effects.{section}.{joint}", effects, LOUDEST[section])


def _beyond_reason(scenario: Scenario, key: str, effects: Effects, loudest: float) -> Iterator[Problem]:
    if effects.delay > LATEST or effects.delay >= scenario.duration:
        late = "as long as the run" if effects.delay >= scenario.duration else f"longer than {LATEST:g} s"
        yield Problem(message=f"is {late} (in s)", key=f"{key}.delay", value=effects.delay, code="long-delay")
    if effects.rate is not None and effects.rate * scenario.duration < 1.0:
        message = "has one tick in the whole run: the first value is held to the end (in Hz)"
        yield Problem(message=message, key=f"{key}.rate", value=effects.rate, code="slow-rate")
    for name, value in (("noise", effects.noise), ("quantum", effects.quantum)):
        if value > loudest:
            message = "is larger than what it disturbs is likely to be (in the signal's SI unit)"
            yield Problem(message=message, key=f"{key}.{name}", value=value, code=f"large-{name}")


def _damping(scenario: Scenario) -> Iterator[Problem]:
    for joint, damping in scenario.link_damping.items():
        if damping.ratio and not damping.inertia:
            message = "a ratio without 'inertia' does nothing: damping is 2 ratio sqrt(inertia stiffness)"
            yield Problem(message=message, key=f"link_damping.{joint}", value=damping.ratio, code="ratio-without-inertia")


def _parts(key: str, signal: Signal) -> Iterator[tuple[str, Signal]]:
    """A signal, or the terms of a sum."""
    if not isinstance(signal, Sum):
        yield key, signal
        return
    for index, term in enumerate(signal.terms):
        yield from _parts(f"{key}.sum.{index}", term)


def _late(scenario: Scenario, key: str, signal: Signal) -> Iterator[Problem]:
    """A signal that rests for the whole run and changes after its end."""
    end = scenario.duration
    try:
        times = np.concatenate([np.linspace(0.0, end, 501), signal.jumps(0.0, end)])
        if np.ptp(signal.values(times)) > 0.0 or signal.jumps(0.0, end).size:
            return
        # Changes later than a hundred times the run are no slip of a digit.
        later = np.sort(np.concatenate([signal.jumps(end, 100.0 * end), np.linspace(end, 100.0 * end, 2001)]))
        changed = np.flatnonzero(signal.values(later) != signal.values(np.array([end]))[0])
    except Exception:
        return  # what fails is an error of its own
    if changed.size:
        message = f"rests for the whole run of {end:g} s and changes only after its end"
        yield Problem(message=message, key=key, value=f"{later[changed[0]]:.4g} s", code="late-reference")


def _presets(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Stiffness presets beyond the springs' deflection limit: there the springs are clipped, not stiffer."""
    times = np.linspace(0.0, scenario.duration, 501)
    for block in robot.actuators:
        actuator, names = ACTUATORS.get(block.actuator), MODES[block.mode].references
        signal = scenario.references_of(block.joint).get("stiffness_preset")
        limit = block.values().get("max_deflection", math.inf)
        if signal is None or actuator.adjuster or actuator.motors < 2 or "stiffness_preset" not in names:
            continue
        try:
            largest = float(np.abs(signal.values(times)).max())
        except Exception:
            continue
        if largest > limit:
            own = "stiffness_preset" in scenario.references.get(block.joint, {})
            message = f"is beyond the deflection limit of the springs of '{block.joint}', {limit:g} rad: they are clipped there"
            key = f"references.{block.joint if own else '*'}.stiffness_preset"
            yield Problem(message=message, key=key, value=largest, code="large-preset")


def _not_released(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Optional models, which the toolbox's own order of a step does not have."""
    for block in robot.actuators if released_order(scenario.stepping) else ():
        given = [
            one.name
            for one in ACTUATORS.get(block.actuator).all_parameters()
            if one.optional and block.parameters[one.name].value != one.default
        ]
        if given:
            message = f"the toolbox's order of a step does not know {', '.join(given)} of '{block.joint}'"
            yield Problem(message=message, key="stepping", value=scenario.stepping, code="released-model")
