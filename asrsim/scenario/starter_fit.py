"""The text of a fit file for a robot and a recording: which parameters to free, and which are equal to each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.user import command_line
from asrsim.robot.model import ActuatorBlock, Robot
from asrsim.scenario.starter import Lines, yaml_text
from asrsim.scenario.starter_recording import Files, RecordingPlan

NOT_FITTED = ("max_deflection", "spring_rest_length")
"""Spring parameters that are not freed: limits that recordings seldom reach, and parameters without effect."""
INERTIA = ("ixx", "iyy", "izz")


def fit_text(plan: RecordingPlan, files: Files) -> str:
    """YAML of a fit file for `asrsim identify`."""
    command = command_line("identify", f"{files.scenario.rpartition('.')[0]}.fit.yaml", files.plugins)
    heading = [
        "Fit for `asrsim identify`: the robot's parameters from the recording. docs/identify.md lists further parameters.",
        f"  {command} --check    # which parameters can be identified, within seconds",
        f"  {command}",
        "The last quarter of each recording is held out; `validate: [another.csv]` names a recording instead.",
    ]
    delays = _delays(plan)
    data: dict[str, Any] = {
        "scenario": files.scenario,
        "experiments": [{"file": files.recording, **files.reading}],
        **({"plugins": list(files.plugins)} if files.plugins else {}),
        "free": Lines.fromkeys([*(key for block in plan.robot.actuators for key in _free(plan, block)), *delays[:1]]),
    }
    ties = sorted(_ties(plan))
    if ties:
        data["ties"] = Lines(ties)
    comments = {
        ("free",): "key: start, or {start: 1, low: 0.5, high: 2}; null: the robot's value",
        ("ties",): "key: other key, or 0.5 * other key; equal springs, motors and delays",
    }
    return yaml_text(data, {path: text for path, text in comments.items() if path[0] in data}, heading)


def _free(plan: RecordingPlan, block: ActuatorBlock) -> Iterator[str]:
    mode, joint = MODES[block.mode], plan.robot.joint(block.joint)
    for parameter in ACTUATORS.get(block.actuator).parameters if mode.spring else ():
        if parameter.name not in NOT_FITTED and not parameter.name.endswith("_2") and not parameter.unused:
            yield f"{block.joint}.{parameter.name}"
    if mode.motor and block.joint not in _twins(plan.robot):
        yield from (f"{block.joint}.motor_1_{name}" for name in ("inertia", "damping", "friction_torque"))
    # The gains of a rigid servo are seldom known; the gains of motors are known if the robot's file states them.
    if mode.controller and not (mode.motor and any(value.origin == "tag" for value in block.parameters.values())):
        yield f"{block.joint}.controller_1_proportional"
    if not plan.on_bench:
        strongest = max(range(3), key=lambda i: abs(joint.axis[i]))
        yield f"{joint.name}.damping"
        yield f"{joint.name}.friction"
        yield f"{joint.child}.{'mass' if joint.kind == 'prismatic' else INERTIA[strongest]}"


def _delays(plan: RecordingPlan) -> list[str]:
    """Keys for the delays of commands to controllers and motors. Torques on links and positions of motors are measured."""
    modes = {block.joint: MODES[block.mode] for block in plan.robot.actuators}
    return [
        f"{one.joint}.{one.column.quantity}.delay"
        for one in plan.played
        if str(one.column.quantity).startswith("reference") and (modes[one.joint].motor or modes[one.joint].controller)
    ]


def _twins(robot: Robot) -> dict[str, str]:
    """Map from a joint to an earlier joint whose motors have equal parameters in the robot's file, and so are of one type."""
    first: dict[object, str] = {}
    twins = {}
    for block in robot.actuators:
        motors = {name: p.value for name, p in block.parameters.items() if name.startswith("motor_") and p.origin == "tag"}
        made = first.setdefault((block.actuator, block.mode, tuple(sorted(motors.items()))), block.joint)
        if motors and made != block.joint:
            twins[block.joint] = made
    return twins


def _ties(plan: RecordingPlan) -> Iterator[tuple[str, str]]:
    """Pairs (key, equal key) for both springs of an antagonistic actuator, motors of one type, and the delays of commands."""
    twins = _twins(plan.robot)
    for block in plan.robot.actuators:
        actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
        names = {parameter.name for parameter in actuator.parameters} if mode.spring else set()
        for name in names:
            if name.endswith("_2") and f"{name[:-2]}_1" in names:
                yield f"{block.joint}.{name}", f"{block.joint}.{name[:-2]}_1"
        twin = twins.get(block.joint, block.joint)
        for i in range(1, actuator.motors + 1) if mode.motor else ():
            if (block.joint, i) != (twin, 1):
                yield f"{block.joint}.motor_{i}_*", f"{twin}.motor_1_*"
    first, *others = _delays(plan) or [""]
    yield from ((key, first) for key in others)
