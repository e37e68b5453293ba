"""The text of a fit file for a robot and a recording: what could be free, and what is better left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.detailed_motor import NEEDED
from asrsim.robot.model import ActuatorBlock, Robot
from asrsim.scenario.starter import word
from asrsim.scenario.starter_playback import Plan

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
    lines = [
        "# Fit for `asrsim identify`: what the recording tells of the robot's numbers.",
        f"#   asrsim identify {scenario.rpartition('.')[0]}.fit.yaml --check    # what can be known, within seconds",
        f"#   asrsim identify {scenario.rpartition('.')[0]}.fit.yaml",
        f"scenario: {word(scenario)}",
        "experiments:",
        f"  - {{{', '.join(keys)}}}" if len(keys) > 1 else f"  - {word(recording)}",
        *([f"plugins: [{', '.join(map(word, plugins))}]"] if plugins else []),
        "# validate: [another.csv]     # without one, the last quarter of each recording is held out",
        "free:                         # key: start, or {start: 1, low: 0.5, high: 2}; nothing: the robot's",
        *_free(plan),
        *_ties(plan.robot),
    ]
    return "\n".join(lines) + "\n"


def _free(plan: Plan) -> Iterator[str]:
    for block in plan.robot.actuators:
        mode, joint = MODES[block.mode], plan.robot.joint(block.joint)
        yield f"  # {block.joint}: {ACTUATORS.get(block.actuator).title}, mode {mode.number} ({mode.name})"
        for name in _of_spring(block) if mode.spring else ():
            yield f"  {word(f'{block.joint}.{name}')}:"
        for name in ("inertia", "damping", "friction_torque") if mode.motor else ():
            yield f"  {word(f'{block.joint}.motor_1_{name}')}:"
        for name in NEEDED[mode.command]:
            key = word(f"{block.joint}.motor_1_{name}")
            yield f"  # {key}:    # scales all torques: free it where an inertia or gravity is known"
        gain = word(f"{block.joint}.controller_1_proportional")
        if mode.controller:
            # That of a rigid servo is seldom known, those of motors mostly are.
            yield f"  {gain}:" if not mode.motor else f"  # {gain}:    # where the controller's gains are not known"
        yield f"  {word(f'{block.joint}.damping')}:"
        yield f"  {word(f'{block.joint}.friction')}:"
        link = joint.child
        if joint.kind == "prismatic":
            yield f"  {word(f'{link}.mass')}:"
        else:
            strongest = max(range(3), key=lambda i: abs(joint.axis[i]))
            yield f"  {word(f'{link}.{INERTIA[strongest]}')}:"
            yield f"  # {word(f'{link}.mass')}:            # with gravity; without it only the inertia shows"
        if not mode.spring:
            yield f"  # {word(f'{block.joint}.passive_stiffness')}: 100    # a spring of the joint's own, as where it is locked"
        if mode.spring:
            yield f"  # {word(f'{block.joint}.hysteresis_torque')}: 0.05   # N m, springs that lag; with hysteresis_deflection"
        yield f"  # {word(f'{block.joint}.stribeck_friction')}: 0.05   # N m, static above Coulomb's; with stribeck_velocity"
    for one in plan.played:
        if one.slot == 0:
            yield f"  # {one.joint}.reference_1.delay:    # s, of the command on its way to the motor"
    for joint_name, column in plan.compared:
        if str(column.quantity).endswith("position"):
            yield f"  # {joint_name}.{column.quantity}.offset:    # what the sensor reads at zero"


def _of_spring(block: ActuatorBlock) -> Iterator[str]:
    for parameter in ACTUATORS.get(block.actuator).parameters:
        if parameter.name not in NOT_FITTED and not parameter.name.endswith("_2") and not parameter.unused:
            yield parameter.name


def _ties(robot: Robot) -> Iterator[str]:
    """Both sides of an antagonistic actuator are alike."""
    found = []
    for block in robot.actuators:
        actuator, mode = ACTUATORS.get(block.actuator), MODES[block.mode]
        names = {parameter.name for parameter in actuator.parameters}
        pairs = [name[:-2] for name in names if name.endswith("_2") and f"{name[:-2]}_1" in names] if mode.spring else []
        found += [f"  {word(f'{block.joint}.{name}_2')}: {block.joint}.{name}_1" for name in pairs]
        if mode.motor and actuator.motors > 1:
            found.append(f"  {word(f'{block.joint}.motor_2_*')}: {block.joint}.motor_1_*")
    if found:
        yield "ties:                         # key: other key, or 0.5 * other key; here: both motors and springs are alike"
        yield from sorted(found)
