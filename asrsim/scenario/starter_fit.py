"""The text of a fit file for a robot and a recording: which parameters to free, and which are equal to each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.user import command_line
from asrsim.robot.model import ActuatorBlock, Robot
from asrsim.scenario.starter import word
from asrsim.scenario.starter_recording import Plan

NOT_FITTED = ("max_deflection", "spring_rest_length")
"""Spring parameters that are not freed: limits that a recording seldom reaches, and numbers without effect."""
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
    ties = sorted(_ties(plan))
    lines = [
        "# Fit for `asrsim identify`: the robot's parameters from the recording. docs/identify.md has more that may be free.",
        f"#   {command} --check    # what can be identified, within seconds",
        f"#   {command}",
        f"scenario: {word(scenario)}",
        "experiments:",
        f"  - {{{', '.join(keys)}}}" if len(keys) > 1 else f"  - {word(recording)}",
        *([f"plugins: [{', '.join(map(word, plugins))}]"] if plugins else []),
        "# validate: [another.csv]     # without one, the last quarter of each recording is held out",
        "free:                         # key: start, or {start: 1, low: 0.5, high: 2}; nothing: the robot's",
        *(f"  {word(key)}:" for block in plan.robot.actuators for key in _free(plan, block)),
        *(f"  {word(key)}:    # s, of commands on their way to the motors" for key in _delays(plan)[:1]),
        *(["ties:                         # key: other key, or 0.5 * other key; parts of one make are equal"] if ties else []),
        *ties,
    ]
    return "\n".join(lines) + "\n"


def _free(plan: Plan, block: ActuatorBlock) -> Iterator[str]:
    mode, joint = MODES[block.mode], plan.robot.joint(block.joint)
    for parameter in ACTUATORS.get(block.actuator).parameters if mode.spring else ():
        if parameter.name not in NOT_FITTED and not parameter.name.endswith("_2") and not parameter.unused:
            yield f"{block.joint}.{parameter.name}"
    if mode.motor and block.joint not in _twins(plan.robot):
        yield from (f"{block.joint}.motor_1_{name}" for name in ("inertia", "damping", "friction_torque"))
    # The gains of a rigid servo are seldom known, those of motors are where the robot's file states them.
    if mode.controller and not (mode.motor and any(value.origin == "tag" for value in block.parameters.values())):
        yield f"{block.joint}.controller_1_proportional"
    if not plan.on_bench:
        strongest = max(range(3), key=lambda i: abs(joint.axis[i]))
        yield f"{joint.name}.damping"
        yield f"{joint.name}.friction"
        yield f"{joint.child}.{'mass' if joint.kind == 'prismatic' else INERTIA[strongest]}"


def _delays(plan: Plan) -> list[str]:
    """Keys of commands to controllers and motors; torques on links, and motors that are played, are measured."""
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    return [
        f"{one.joint}.{one.column.quantity}.delay"
        for one in plan.played
        if str(one.column.quantity).startswith("reference") and (modes[one.joint].motor or modes[one.joint].controller)
    ]


def _twins(robot: Robot) -> dict[str, str]:
    """Joint -> an earlier one whose motors have the same numbers in the robot's file: of the same make."""
    first: dict[object, str] = {}
    twins = {}
    for block in robot.actuators:
        motors = {name: p.value for name, p in block.parameters.items() if name.startswith("motor_") and p.origin == "tag"}
        made = first.setdefault((block.actuator, block.mode, tuple(sorted(motors.items()))), block.joint)
        if motors and made != block.joint:
            twins[block.joint] = made
    return twins


def _ties(plan: Plan) -> Iterator[str]:
    """Both springs of an antagonistic actuator are equal, motors of one make are, and so are the delays of all commands."""
    twins = _twins(plan.robot)
    for block in plan.robot.actuators:
        actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
        names = {parameter.name for parameter in actuator.parameters} if mode.spring else set()
        for name in names:
            if name.endswith("_2") and f"{name[:-2]}_1" in names:
                yield f"  {word(f'{block.joint}.{name}')}: {block.joint}.{name[:-2]}_1"
        twin = twins.get(block.joint, block.joint)
        for i in range(1, actuator.motors + 1) if mode.motor else ():
            if (block.joint, i) != (twin, 1):
                yield f"  {word(f'{block.joint}.motor_{i}_*')}: {twin}.motor_1_*"
    first, *others = _delays(plan) or [""]
    yield from (f"  {word(key)}: {first}" for key in others)
