"""What a user of the toolbox should know about a block that can be simulated: warnings, never errors."""

from __future__ import annotations

import math

from asrsim.actuators import MODES, Actuator
from asrsim.robot.findings import EMPTY_LIMIT, Findings
from asrsim.robot.model import ActuatorBlock, Joint, ParameterValue

TOOLBOX_MODES = range(7)
TEMPLATE_VALUES = {"damping": 0.0019, "friction_torque": 0.5}
"""Motor parameters whose value in the toolbox's templates differs from the released code's default."""


def advise(actuator: type[Actuator], block: ActuatorBlock, joint: Joint, findings: Findings) -> None:
    """Add the warnings of one block. Tags of equal standing (motor 1 and 2) share a warning."""
    given = {name: value for name, value in block.parameters.items() if value.origin == "tag"}
    key = block.plugin_name or block.joint
    _template_values(actuator, given, key, findings)
    _without_effect(actuator, given, key, findings)
    _infinite_limits(given, key, findings)
    _second_controller(block, given, key, findings)
    if joint.kind == "prismatic":
        findings.warn(
            "the joint is prismatic: the actuator's rad and N m are taken as m and N",
            code="prismatic-joint", line=block.line, key=key,
        )  # fmt: skip
    if block.mode in (1,) and any(name.startswith("controller_1") for name in given):
        findings.warn(
            f"mode 1: <{given_tags(given, 'controller_1')}> set the link's controller; spring and motors are not simulated",
            code="link-controller", line=block.line, key=key,
        )  # fmt: skip
    if block.mode not in TOOLBOX_MODES:
        findings.warn(
            f"mode {block.mode} ({MODES[block.mode].name}) is asrsim's: the toolbox's plugin has none of this number",
            code="own-mode", line=block.line, key=key,
        )  # fmt: skip
    if joint.effort is None:
        findings.warn(
            "the joint has no effort limit: torques are not clipped", code="no-effort-limit", line=joint.line, key=joint.name
        )
    elif joint.effort == 0.0:
        findings.warn(
            "the joint's effort limit is 0: every torque is clipped to nothing", code="zero-effort-limit", line=joint.line,
            key=joint.name, hint=EMPTY_LIMIT,
        )  # fmt: skip


def given_tags(given: dict[str, ParameterValue], prefix: str) -> str:
    """Tags of the given parameters with that prefix, for a message."""
    return ">, <".join(value.tag for name, value in given.items() if name.startswith(prefix))


def _template_values(actuator: type[Actuator], given: dict[str, ParameterValue], key: str, findings: Findings) -> None:
    for ending, shown in TEMPLATE_VALUES.items():
        found = [value for name, value in given.items() if name.endswith(ending) and value.value == shown]
        if not found:
            continue
        default = next(parameter.default for parameter in actuator.all_parameters() if parameter.name == found[0].name)
        findings.warn(
            f"{shown:g} is what the toolbox's template shows; its code's default, used where the tag is absent, is {default:g}",
            code="template-value", line=found[0].line, key=f"{key}.{', '.join(value.tag for value in found)}",
        )  # fmt: skip


def _without_effect(actuator: type[Actuator], given: dict[str, ParameterValue], key: str, findings: Findings) -> None:
    for parameter in actuator.parameters:
        if parameter.unused and parameter.name in given:
            value = given[parameter.name]
            findings.warn(f"has no effect: {parameter.unused}", code="unused-tag", line=value.line, key=f"{key}.{value.tag}")
    limits = [value for name, value in given.items() if name.endswith("max_velocity")]
    if limits:
        findings.warn(
            "the toolbox reads this limit and never enforces it; asrsim does",
            code="ignored-by-toolbox", line=limits[0].line, key=f"{key}.{', '.join(value.tag for value in limits)}",
        )  # fmt: skip


def _infinite_limits(given: dict[str, ParameterValue], key: str, findings: Findings) -> None:
    infinite = [value for value in given.values() if math.isinf(value.value)]
    if infinite:
        findings.warn(
            "infinite, taken as no limit; some Gazebo versions read it as 0",
            code="misread-value", line=infinite[0].line, key=f"{key}.{', '.join(value.tag for value in infinite)}",
        )  # fmt: skip


def _second_controller(block: ActuatorBlock, given: dict[str, ParameterValue], key: str, findings: Findings) -> None:
    """A block that sets controller 1 alone leaves motor 2 on defaults: worth a word where the two then differ."""
    if not MODES[block.mode].motor or not MODES[block.mode].controller:
        return
    differing = []
    for name, value in given.items():
        if name.startswith("controller_1"):
            other = block.parameters.get(name.replace("controller_1", "controller_2"))
            if other is not None and other.origin != "tag" and other.value != value.value:
                differing.append(f"<{value.tag}> {value.value:g} but {other.tag} {other.value:g}")
    if differing:
        findings.warn(
            f"motor 2 keeps the default gains: {'; '.join(differing)}",
            code="one-controller-set", line=block.line, key=key,
        )  # fmt: skip
