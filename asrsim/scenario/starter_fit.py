"""The text of a fit file for a robot and a recording: what could be free, and what is better left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.electric import NEEDED
from asrsim.actuators.user import command_line
from asrsim.robot.model import ActuatorBlock, Joint, Robot
from asrsim.scenario.starter import word
from asrsim.scenario.starter_recording import Plan

NOT_FITTED = ("max_deflection", "spring_rest_length")
"""Of springs: limits that a recording seldom reaches, and numbers without effect."""
INERTIA = ("ixx", "iyy", "izz")


def fit_text(
    plan: Plan, scenario: str, recording: str, *, mapping: Sequence[str] = (), rate: float | None = None,
    plugins: Sequence[str] = (),
) -> str:  # fmt: skip
    """YAML for `asrsim identify`; scenario, recording, plugins: as the file names them from its folder."""
    keys = [f"file: {word(recording)}"]
    keys += [f"map: [{', '.join(word(text) for text in mapping)}]"] if mapping else []
    keys += [f"rate: {rate:g}"] if rate else []
    command = command_line("identify", f"{scenario.rpartition('.')[0]}.fit.yaml", plugins)
    lines = [
        "# Fit for `asrsim identify`: what the recording tells of the robot's numbers.",
        f"#   {command} --check    # what can be known, within seconds",
        f"#   {command}",
        f"scenario: {word(scenario)}",
        "experiments:",
        f"  - {{{', '.join(keys)}}}" if len(keys) > 1 else f"  - {word(recording)}",
        *([f"plugins: [{', '.join(map(word, plugins))}]"] if plugins else []),
        "# validate: [another.csv]     # without one, the last quarter of each recording is held out",
        "free:                         # key: start, or {start: 1, low: 0.5, high: 2}; nothing: the robot's",
        *_free(plan),
        *_ties(plan),
    ]
    return "\n".join(lines) + "\n"


def _free(plan: Plan) -> Iterator[str]:
    twins = _twins(plan.robot)
    for block in plan.robot.actuators:
        mode, joint = MODES[block.mode], plan.robot.joint(block.joint)
        yield f"  # {block.joint}: {ACTUATORS.get(block.actuator).title}, mode {mode.number} ({mode.name})"
        for name in _of_spring(block) if mode.spring else ():
            yield f"  {word(f'{block.joint}.{name}')}:"
        if mode.motor and block.joint not in twins:
            for name in ("inertia", "damping", "friction_torque"):
                yield f"  {word(f'{block.joint}.motor_1_{name}')}:"
            key = word(f"{block.joint}.motor_1_friction_stiffness")
            yield f"  # {key}:    # N m/rad, by which a motor gives way before it slides"
        for name in NEEDED[mode.command]:
            key = word(f"{block.joint}.motor_1_{name}")
            yield f"  # {key}:    # scales all torques: free it where an inertia or gravity is known"
        gain = word(f"{block.joint}.controller_1_proportional")
        if mode.controller:
            # That of a rigid servo is seldom known, those of motors are where the robot's file speaks of them.
            told = mode.motor and any(p.origin == "tag" for p in block.parameters.values())
            yield f"  # {gain}:    # where the controller's gains are not known" if told else f"  {gain}:"
        if not plan.on_bench:
            yield from _of_link(joint)
        if not mode.spring:
            yield f"  # {word(f'{block.joint}.passive_stiffness')}: 100    # a spring of the joint's own, as where it is locked"
        if mode.spring:
            yield f"  # {word(f'{block.joint}.hysteresis_torque')}: 0.05   # N m, springs that lag; with hysteresis_deflection"
        if not plan.on_bench:
            key = word(f"{block.joint}.stribeck_friction")
            yield f"  # {key}: 0.05   # N m, static above Coulomb's; with stribeck_velocity"
    for key in _delays(plan)[:1]:
        yield f"  {key}:    # s, of commands on their way to the motors"
    for joint_name, column in plan.compared:
        if str(column.quantity).endswith("position"):
            yield f"  # {joint_name}.{column.quantity}.offset:    # what the sensor reads at zero"


def _of_link(joint: Joint) -> Iterator[str]:
    """Of a joint and the link that it moves."""
    yield f"  {word(f'{joint.name}.damping')}:"
    yield f"  {word(f'{joint.name}.friction')}:"
    link = joint.child
    if joint.kind == "prismatic":
        yield f"  {word(f'{link}.mass')}:"
    else:
        strongest = max(range(3), key=lambda i: abs(joint.axis[i]))
        yield f"  {word(f'{link}.{INERTIA[strongest]}')}:"
        yield f"  # {word(f'{link}.mass')}:            # with gravity; without it only the inertia shows"


def _of_spring(block: ActuatorBlock) -> Iterator[str]:
    for parameter in ACTUATORS.get(block.actuator).parameters:
        if parameter.name not in NOT_FITTED and not parameter.name.endswith("_2") and not parameter.unused:
            yield parameter.name


def _delays(plan: Plan) -> list[str]:
    """Keys of what is sent to controllers and motors; torques on links, and motors that are played, are measured."""
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    return [
        word(f"{one.joint}.{one.column.quantity}.delay")
        for one in plan.played
        if str(one.column.quantity).startswith("reference") and (modes[one.joint].motor or modes[one.joint].controller)
    ]


def _twins(robot: Robot) -> dict[str, str]:
    """Joint -> an earlier one whose motors have the same numbers in the robot's file: of the same make."""
    first: dict[object, str] = {}
    twins = {}
    for block in robot.actuators:
        motors = {name: p.value for name, p in block.parameters.items() if name.startswith("motor_") and p.origin == "tag"}
        if not motors:
            continue
        made = first.setdefault((block.actuator, block.mode, tuple(sorted(motors.items()))), block.joint)
        if made != block.joint:
            twins[block.joint] = made
    return twins


def _ties(plan: Plan) -> Iterator[str]:
    """Both sides of an antagonistic actuator are alike, motors of one make are, and all commands are as late."""
    found, twins = [], _twins(plan.robot)
    for block in plan.robot.actuators:
        actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
        names = {parameter.name for parameter in actuator.parameters}
        pairs = [name[:-2] for name in names if name.endswith("_2") and f"{name[:-2]}_1" in names] if mode.spring else []
        found += [f"  {word(f'{block.joint}.{name}_2')}: {block.joint}.{name}_1" for name in pairs]
        twin = twins.get(block.joint, block.joint)
        for i in range(1, actuator.motors + 1) if mode.motor else ():
            if (block.joint, i) != (twin, 1):
                found.append(f"  {word(f'{block.joint}.motor_{i}_*')}: {twin}.motor_1_*")
    first, *others = _delays(plan) or [""]
    found += [f"  {key}: {first}" for key in others]
    if found:
        yield "ties:                         # key: other key, or 0.5 * other key; here: what is of one make is alike"
        yield from sorted(found)
