"""Reads the plugin blocks of the toolbox from XML into `ActuatorBlock`s. All problems are reported."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Unpack

from asrsim.actuators import ACTUATORS, MODES, Actuator, Parameter
from asrsim.errors import Details, did_you_mean, nearest
from asrsim.robot.findings import Findings
from asrsim.robot.model import UNREAD, ActuatorBlock, Joint, ParameterValue, is_locked
from asrsim.robot.numbers import leading_number, read_number
from asrsim.robot.tags import BLOCK_TAGS, REQUIRED_TAGS, SPRING_TAGS, parameter_tags, tag_parameters
from asrsim.robot.values import MODE_CHOICES, default_parameter, parameter_fault
from asrsim.robot.xmlfile import elements, name_of, text_of

_FILENAME = re.compile(r"(?:.*/)?(?:lib)?(?P<name>\w+?)_plugin(?:\.so)?")
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


def read_blocks(
    root: Any, joints: Sequence[Joint], findings: Findings, locked: Sequence[str] = ()
) -> tuple[tuple[ActuatorBlock, ...], frozenset[str]]:
    """Blocks of all known actuators, and joints whose actuator or mode is invalid. Plugins of other programs, and plugins on
    locked joints, are ignored.
    """
    blocks: dict[str, ActuatorBlock] = {}
    unread: set[str] = set()
    known = {joint.name: joint for joint in joints}
    for gazebo in elements(root, "gazebo"):
        for plugin in elements(gazebo, "plugin"):
            if any(is_locked(text_of(tag), locked) for tag in elements(plugin, "joint")):
                continue
            actuator, named = _actuator_of(plugin, name_of(gazebo, "reference"), findings)
            unread |= named
            if actuator is None:
                continue
            tags = _Tags(plugin, findings)
            tags.report_unknown(actuator)
            joint = tags.joint(known, blocks)
            mode = tags.mode()
            *_, external = (tags.switch(name) for name in REQUIRED_TAGS[2:])
            block = ActuatorBlock(
                actuator=actuator.name,
                joint=joint or "",
                mode=mode or 0,
                namespace=tags.text("namespace"),
                subscribe_external_torque=external,
                parameters=tags.parameters(actuator, mode),
                plugin_name=plugin.get("name") or "",
                line=findings.line(plugin),
            )
            if joint is not None:
                blocks[joint] = block
                unread |= {joint} if mode is None else set()
    return tuple(blocks.values()), frozenset(unread)


def _actuator_of(plugin: Any, reference: str, findings: Findings) -> tuple[type[Actuator] | None, set[str]]:
    """Actuator of a plugin, or None; and the joints of a block that is meant as an actuator, but names an unknown actuator."""
    filename = name_of(plugin, "filename")
    match = _FILENAME.fullmatch(filename)
    name = match.group("name") if match else ""
    tags = elements(plugin)
    given, shown = {tag.tag for tag in tags}, plugin.get("name") or filename or "plugin"
    if name not in SPRING_TAGS and not given.intersection(BLOCK_TAGS):
        return None, set()  # before `ACTUATORS` searches for installed actuators
    if name not in ACTUATORS:
        if not {"joint", "operation_mode"} <= given:
            return None, set()
        found = ACTUATORS.unknown(name)
        close = nearest(name, found.choices)
        hint = f"Name your own actuator's file with --plugin {name or 'my_actuator'}.py"
        hint = f"Did you mean 'lib{close}_plugin.so'? {hint}" if close else hint
        choices = tuple(f"lib{actuator}_plugin.so" for actuator in found.choices)
        message = "no actuator belongs to this plugin file"
        if not choices:  # the actuator of an installed package is broken
            message, hint = found.message, found.hint or ""
        findings.error(message, plugin, shown, code="unknown-actuator", value=filename, choices=choices, hint=hint)
        return None, {text_of(tag) for tag in tags if tag.tag == "joint"}
    if reference:
        message = f"this block is inside <gazebo reference='{reference}'>, where Gazebo loads no actuator; it is not simulated"
        findings.warn(message, plugin, shown, code="plugin-in-reference", hint="Remove the reference attribute")
        return None, set()
    return ACTUATORS.get(name), set()


def is_block(plugin: Any) -> bool:
    """Whether a plugin is read as the block of an actuator, or reported as a block with an unknown actuator."""
    match = _FILENAME.fullmatch(name_of(plugin, "filename"))
    given = {tag.tag for tag in elements(plugin)}
    name = match.group("name") if match else ""
    if {"joint", "operation_mode"} <= given or name in SPRING_TAGS:
        return True
    return bool(given.intersection(BLOCK_TAGS)) and name in ACTUATORS


class _Tags:
    """Tags of one plugin block."""

    def __init__(self, plugin: Any, findings: Findings) -> None:
        self.plugin, self.findings = plugin, findings
        self.shown = plugin.get("name") or name_of(plugin, "filename")
        self.by_name: dict[str, Any] = {}
        for tag in elements(plugin):
            if tag.tag in self.by_name:
                message, key = "the block has this tag twice", f"{self.shown}.{tag.tag}"
                findings.error(message, tag, key, code="duplicate-tag", value=text_of(tag))
            self.by_name.setdefault(tag.tag, tag)

    def text(self, name: str) -> str:
        """Text of a tag; empty if the tag is absent."""
        return text_of(self.by_name[name]) if name in self.by_name else ""

    def error(self, message: str, name: str, *, code: str, **details: Unpack[Details]) -> None:
        """Add an error about a tag of the block."""
        details = {"value": self.text(name), **details}
        self.findings.error(message, self.by_name[name], f"{self.shown}.{name}", code=code, **details)

    def lacks(self, name: str, choices: tuple[str, ...]) -> bool:
        """Whether a required tag is absent. A missing tag is an error."""
        if name in self.by_name:
            return False
        message = f"required tag <{name}> is missing"
        self.findings.error(message, self.plugin, self.shown, code="missing-tag", choices=choices)
        return True

    def report_unknown(self, actuator: type[Actuator]) -> None:
        """Warn about tags that the actuator does not have, and about missing tags."""
        known = (*BLOCK_TAGS, *tag_parameters(actuator))
        for name, tag in self.by_name.items():
            if name not in known:
                # Do not suggest a known tag that the block already has.
                close = nearest(name, [one for one in known if one not in self.by_name])
                hint = f"Did you mean <{close}>?" if close else None
                message = f"unknown tag <{name}>; it has no effect"
                self.findings.warn(message, tag, f"{self.shown}.{name}", code="unknown-tag", hint=hint)
        for required in REQUIRED_TAGS[2:]:
            if required not in self.by_name:
                message = f"required tag <{required}> is missing (the toolbox crashes without it)"
                self.findings.warn(message, self.plugin, self.shown, code="missing-tag")

    def joint(self, joints: dict[str, Joint], blocks: dict[str, ActuatorBlock]) -> str | None:
        """Name of the joint; None if the joint cannot have an actuator."""
        movable = tuple(joint.name for joint in joints.values() if joint.moves)
        if self.lacks("joint", movable):
            return None
        name = self.text("joint")
        joint = joints.get(name)
        if joint is None:
            hint = did_you_mean(name, tuple(joints))
            self.error("the robot has no such joint", "joint", code="unknown-joint", choices=movable, hint=hint)
        elif not joint.moves:
            self.error(f"a {joint.kind} joint cannot have an actuator", "joint", code="joint-type", choices=movable)
        elif name in blocks:
            first = f", the other on line {blocks[name].line}" if blocks[name].line else ""
            self.error(f"two actuators on one joint{first}", "joint", code="two-actuators")
        else:
            return name
        return None

    def mode(self) -> int | None:
        """Operation mode; None if it is invalid."""
        if self.lacks("operation_mode", MODE_CHOICES):
            return None
        text = self.text("operation_mode")
        mode = int(text) if re.fullmatch("[0-9]{1,3}", text) else None
        if mode in MODES:
            return mode
        self.error("there is no such operation mode", "operation_mode", code="operation-mode", choices=MODE_CHOICES)
        return None

    def switch(self, name: str) -> bool:
        """Truth value of a tag; False if the tag is absent."""
        value = _BOOLEANS.get(self.text(name).lower())
        if value is None and name in self.by_name:
            self.error("must be true or false", name, code="not-a-boolean", choices=tuple(_BOOLEANS))
        return bool(value)

    def parameters(self, actuator: type[Actuator], mode: int | None) -> dict[str, ParameterValue]:
        """All parameters of the actuator by name, with defaults for missing tags."""
        tags = parameter_tags(actuator)
        given = {name: tag for tag, name in reversed(tag_parameters(actuator).items()) if tag in self.by_name}
        return {
            parameter.name: self.parameter(parameter, given[parameter.name])
            if parameter.name in given
            else default_parameter(parameter, mode, tags[parameter.name])
            for parameter in actuator.all_parameters()
        }

    def parameter(self, parameter: Parameter, name: str) -> ParameterValue:
        """Parameter with the value in its tag."""
        value = self.number(name)
        fault = None if value is None else parameter_fault(parameter, value)
        if fault:
            self.error(fault, name, code="out-of-range")
        return ParameterValue(
            name=parameter.name,
            value=UNREAD if value is None or fault else value,
            unit=parameter.unit,
            origin="tag",
            tag=name,
            line=self.findings.line(self.by_name[name]),
            text=self.text(name),
        )

    def number(self, name: str) -> float | None:
        """Number in a tag; None if the number is invalid."""
        text = self.text(name)
        try:
            value, arithmetic = read_number(text)
        except ValueError as error:
            hint = f"The toolbox would read {leading_number(text):g}" if text else None
            self.error(str(error), name, code="not-a-number", hint=hint)
            return None
        if arithmetic:
            leading = leading_number(text)
            message = f"the arithmetic is taken as {value:g}; the toolbox reads only the leading number {leading:g}"
            self.findings.warn(message, self.by_name[name], f"{self.shown}.{name}", code="misread-value", value=text)
        return value
