"""What a scenario may say and hardly means: warnings, each with the value that looks wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem
from asrsim.robot import Robot
from asrsim.robot.attributes import beyond_a_turn
from asrsim.robot.sanity import block_doubts, most_damping
from asrsim.scenario.choices import released_order
from asrsim.scenario.data import Effects, Scenario, for_joint
from asrsim.scenario.shadowed import shadowed_entries
from asrsim.scenario.world_doubts import world_doubts

STRONGEST = 30.0
"""m/s^2; Jupiter's gravity is 24.8."""
LATEST = 1.0
"""s of delay."""
LOUDEST = {"commands": 5.0, "sensors": 1.0}
"""Standard deviation of noise, and quantisation steps, in the signal's unit (most often rad)."""
FARTHEST = 1.0
"""rad or m in a step."""
MOST_RATIO = 100.0
"""Damping ratio of a link beyond which it is doubted: 1 is critical."""
STEPS = (1e-6, 0.05)
"""s: of a motor's electronics, and what no controller of a robot takes."""
HANDFUL = 5
"""Samples between which a log shows nothing."""
LOOSE, FAR = 100.0, 1e6
"""Tolerances and bounds of claims, in the measure's SI unit, that no run reaches."""


def doubts(scenario: Scenario, robot: Robot, changed: Robot) -> Iterator[Problem]:
    """Warnings about a scenario on its robot, as the file has it and as the scenario changes it."""
    yield from _gravity(scenario)
    yield from _orientations(scenario)
    yield from _effects(scenario)
    yield from _damping(scenario, changed)
    yield from _start(scenario, changed)
    yield from _samples(scenario)
    yield from _claims(scenario)
    yield from world_doubts(scenario, changed)
    for key in shadowed_entries(scenario, changed):
        yield Problem("does nothing: every joint that it could be for has an entry of its own", key=key, code="unused-entry")
    for block in changed.actuators:
        for doubt in block_doubts(block, changed.joint(block.joint)) if block not in robot.actuators else ():
            if doubt.parameter is None or doubt.parameter.origin == "scenario":
                yield Problem(doubt.message, key=f"parameters.{block.joint}", value=doubt.value, code=doubt.code)
    yield from _not_released(scenario, changed)


def _gravity(scenario: Scenario) -> Iterator[Problem]:
    strength = math.hypot(*scenario.gravity)
    shown = f"{strength:g} m/s^2"
    if strength > STRONGEST:
        yield Problem("is stronger than on any planet (in m/s^2)", key="gravity", value=shown, code="gravity")
    elif scenario.gravity[2] > 0.0:
        message = "points upwards: z points up, so weight is negative in z"
        yield Problem(message, key="gravity", value=f"{scenario.gravity[2]:g}", code="gravity")


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
            yield Problem(message, key=key, value=shown, hint="90 degrees are 1.5708 rad", code="rpy-in-degrees")


def _effects(scenario: Scenario) -> Iterator[Problem]:
    for section, table in (("commands", scenario.command_effects), ("sensors", scenario.sensor_effects)):
        for joint, effects in table.items():
            yield from _beyond_reason(scenario, f"effects.{section}.{joint}", effects, LOUDEST[section])


def _beyond_reason(scenario: Scenario, key: str, effects: Effects, loudest: float) -> Iterator[Problem]:
    if effects.delay > LATEST or effects.delay >= scenario.duration:
        late = "as long as the run" if effects.delay >= scenario.duration else f"longer than {LATEST:g} s"
        yield Problem(f"is {late} (in s)", key=f"{key}.delay", value=effects.delay, code="long-delay")
    if effects.rate is not None and effects.rate * scenario.duration < 1.0:
        message = "has one tick in the whole run: the first value is held to the end (in Hz)"
        yield Problem(message, key=f"{key}.rate", value=effects.rate, code="slow-rate")
    for name, value in (("noise", effects.noise), ("quantum", effects.quantum)):
        if value > loudest:
            message = "is larger than what it disturbs is likely to be (in the signal's SI unit)"
            yield Problem(message, key=f"{key}.{name}", value=value, code=f"large-{name}")


def _start(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    """Starts at which a link or motor is past where a step ends, or a motor where its spring cannot follow."""
    motors = scenario.initial_motor_velocities
    links = {name: (speed,) for name, speed in scenario.initial_velocities.items()}
    for joint in robot.moving_joints:
        for table, part in ((links, "velocity"), (motors, "motor_velocities")):
            fastest = max(map(abs, for_joint(table, joint.name, ())), default=0.0)
            if fastest * scenario.step > FARTHEST:
                key = f"initial.{joint.name if joint.name in table else '*'}.{part}"
                message = f"is more than {FARTHEST:g} a step of {scenario.step:g} s (in rad/s or m/s)"
                yield Problem(message, key=key, value=fastest, code="fast-start")
    for block in robot.actuators:
        table, position = scenario.initial_motor_positions, for_joint(scenario.initial_positions, block.joint, 0.0)
        positions = for_joint(table, block.joint, ())[: ACTUATORS.get(block.actuator).motors]
        farthest = max((abs(one - position) for one in positions), default=0.0)
        limit = min(block.values().get("max_deflection", math.inf), math.tau)
        if farthest > limit:
            key = f"initial.{block.joint if block.joint in table else '*'}.motor_positions"
            message = f"is further from the link than its spring reaches, {limit:.4g} rad"
            yield Problem(message, key=key, value=f"{farthest:g} rad", code="far-motor")


def _damping(scenario: Scenario, robot: Robot) -> Iterator[Problem]:
    for name, damping in scenario.link_damping.items():
        key = f"link_damping.{name}"
        if damping.ratio and not damping.inertia:
            message = "a ratio without 'inertia' does nothing: damping is 2 ratio sqrt(inertia stiffness)"
            yield Problem(message, key=key, value=damping.ratio, code="ratio-without-inertia")
        elif damping.ratio > MOST_RATIO:
            message = "is no damping ratio; at 1 nothing swings"
            yield Problem(message, key=f"{key}.ratio", value=damping.ratio, code="large-damping")
        bounds = most_damping(robot)
        if 0.0 < min((bounds[joint] for joint in bounds if name in (joint, "*")), default=0.0) < damping.constant:
            message = "so much damping holds the link still, whatever drives it"
            yield Problem(message, key=f"{key}.constant", value=damping.constant, code="large-damping")


def _samples(scenario: Scenario) -> Iterator[Problem]:
    """Steps that are no steps of a robot's controllers, and a log that shows next to nothing of the run."""
    if not STEPS[0] <= scenario.step <= STEPS[1]:
        message = f"is no step of a simulated robot, {STEPS[0]:g} to {STEPS[1]:g} s"
        yield Problem(message, key="step", value=f"{scenario.step:g} s", code="odd-step")
    apart = scenario.log_every * scenario.step
    if scenario.log_every > 1 and scenario.duration < HANDFUL * apart:
        message = f"leaves {int(scenario.duration / apart + 1e-9) + 1} samples of a run of {scenario.duration:g} s"
        yield Problem(message, key="log_rate", value=f"{1.0 / apart:g} Hz", code="few-samples")


def _claims(scenario: Scenario) -> Iterator[Problem]:
    """Claims that hold whatever happens."""
    for index, claim in enumerate(scenario.expect):
        loose = claim.comparison == "==" and claim.tolerance > max(LOOSE, 10.0 * abs(claim.value))
        empty = claim.comparison != "==" and abs(claim.value) > FAR
        if loose or empty:
            key, value = ("tolerance", claim.tolerance) if loose else ("value", claim.value)
            message = "so far off that the claim holds, or fails, whatever happens"
            yield Problem(message, key=f"expect.{index}.{key}", value=value, code="empty-claim")
        elif claim.tolerance and claim.comparison != "==":
            message = f"does nothing beside {claim.comparison}: it belongs to =="
            yield Problem(message, key=f"expect.{index}.tolerance", value=claim.tolerance, code="unused-tolerance")


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
            yield Problem(message, key="stepping", value=scenario.stepping, code="released-model")
