"""Plugin blocks of the toolbox: from XML to :class:`ActuatorBlock`, every problem reported."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from asrsim.actuators import ACTUATORS, MODES, Actuator, Parameter
from asrsim.actuators.parameters import LINK_CONTROLLER_DEFAULTS
from asrsim.errors import did_you_mean, nearest
from asrsim.robot.advice import advise
from asrsim.robot.findings import Findings, Line, Reader
from asrsim.robot.model import UNREAD, ActuatorBlock, Joint, Origin, ParameterValue
from asrsim.robot.numbers import leading_number, read_number
from asrsim.robot.tags import BLOCK_TAGS, FOREIGN_QBMOVE_TAGS, REQUIRED_TAGS, SPRING_TAGS, parameter_tags, tag_parameters
from asrsim.robot.values import parameter_fault
from asrsim.robot.xmlfile import elements, name_of, text_of

_FILENAME = re.compile(r"(?:.*/)?(?:lib)?(?P<name>\w+?)_plugin(?:\.so)?")
_TRUE, _FALSE = ("true", "1"), ("false", "0")
MODE_CHOICES = tuple(f"{mode.number} ({mode.name})" for mode in MODES.values())


def read_blocks(
    root: Any, joints: Sequence[Joint], findings: Findings, line: Line
) -> tuple[tuple[ActuatorBlock, ...], frozenset[str]]:
    """All blocks of the toolbox's actuators and of registered ones, and joints whose actuator or mode could not be read; other
    plugins are left alone.
    """
    reader = _BlockReader({joint.name: joint for joint in joints}, findings, line)
    for gazebo in elements(root, "gazebo"):
        reference = name_of(gazebo, "reference")
        for plugin in elements(gazebo, "plugin"):
            reader.read(plugin, reference)
    return tuple(reader.blocks), frozenset(reader.unread)


def default_value(parameter: Parameter, mode: int | None) -> tuple[float, Origin]:
    """The parameter's default in that mode: in mode 1 controller 1 acts on the link and has other gains."""
    if mode == 1 and parameter.name in LINK_CONTROLLER_DEFAULTS:
        return LINK_CONTROLLER_DEFAULTS[parameter.name], "mode default"
    return parameter.default, "default"


def default_parameter(parameter: Parameter, mode: int | None, tag: str) -> ParameterValue:
    """The parameter where nothing sets it."""
    value, origin = default_value(parameter, mode)
    return ParameterValue(name=parameter.name, value=value, unit=parameter.unit, origin=origin, tag=tag)


class _BlockReader(Reader):
    """Keeps what was read so far, to see two blocks on one joint."""

    def __init__(self, joints: Mapping[str, Joint], findings: Findings, line: Line) -> None:
        super().__init__(findings, line)
        self.joints = joints
        self.blocks: list[ActuatorBlock] = []
        self.unread: set[str] = set()
        self._block_lines: dict[str, int | None] = {}
        """Joint -> line of the block that is on it."""

    def read(self, plugin: Any, reference: str) -> None:
        """Read one `<plugin>`; foreign ones are passed by."""
        filename = name_of(plugin, "filename")
        match = _FILENAME.fullmatch(filename)
        name = match.group("name") if match else ""
        tags = elements(plugin)
        given = {tag.tag for tag in tags}
        line, shown = self.line(plugin), plugin.get("name") or filename or "plugin"
        if name not in SPRING_TAGS and not given.intersection(BLOCK_TAGS):
            return  # nothing of ours, known without a search for installed actuators
        if name not in ACTUATORS:
            if {"joint", "operation_mode"} <= given:
                self._foreign(filename, name, line, shown)
                self.unread |= {text_of(tag) for tag in tags if tag.tag == "joint"}
            return
        if name == "qbmove" and given.intersection(FOREIGN_QBMOVE_TAGS):
            self.findings.warn(
                "this block is for another plugin of the same file name (l1va/qbmove_ros: it has <command_topic> or "
                "<pos_topic>); it is not simulated",
                code="foreign-dialect", line=line, key=shown,
            )  # fmt: skip
            return
        if reference:
            self.findings.warn(
                f"this block stands in <gazebo reference='{reference}'>, where Gazebo loads no actuator; it is not simulated",
                code="plugin-in-reference", line=line, key=shown, hint="Take the reference attribute out",
            )  # fmt: skip
            return
        self._actuator(ACTUATORS.get(name), plugin, tags, shown)

    def _foreign(self, filename: str, name: str, line: int | None, shown: str) -> None:
        """Plugins of others are no concern of ours, unless the block is plainly meant for an actuator: this one is."""
        known = ACTUATORS.names()
        close = nearest(name, known)
        own = f"Name your own actuator's file with --plugin {name or 'my_actuator'}.py"
        self.findings.error(
            "no actuator belongs to this plugin file", code="unknown-actuator", line=line, key=shown, value=filename,
            choices=tuple(f"lib{actuator}_plugin.so" for actuator in known),
            hint=f"Did you mean 'lib{close}_plugin.so'?" if close else own,
        )  # fmt: skip

    def _actuator(self, actuator: type[Actuator], plugin: Any, tags: list[Any], shown: str) -> None:
        line = self.line(plugin)
        by_tag = self._unique(tags, shown)
        self._report_unknown(actuator, by_tag, shown)
        for required in REQUIRED_TAGS[2:]:
            if required not in by_tag:
                self.findings.warn(
                    f"required tag <{required}> is missing (the toolbox crashes without it)",
                    code="missing-tag", line=line, key=shown,
                )  # fmt: skip
        joint = self._joint(by_tag, line, shown)
        mode = self._mode(by_tag, line, shown)
        switches = [
            self._switch(by_tag, tag, shown, default)
            for tag, default in (("pub_eltau", True), ("pub_state", True), ("sub_ext_tau", False))
        ]
        parameters = self._parameters(actuator, by_tag, mode, shown)
        sample_time = self._sample_time(by_tag, shown)
        if joint is None:
            return
        if mode is None:
            self.unread.add(joint.name)
        block = ActuatorBlock(
            actuator=actuator.name, joint=joint.name, mode=mode or 0,
            namespace=text_of(by_tag["namespace"]) if "namespace" in by_tag else "",
            publish_elastic_torques=switches[0], publish_state=switches[1], subscribe_external_torque=switches[2],
            sample_time=sample_time, parameters=parameters, plugin_name=plugin.get("name") or "", line=line,
        )  # fmt: skip
        advise(actuator, block, joint, self.findings)
        self.blocks.append(block)

    def _unique(self, tags: list[Any], shown: str) -> dict[str, Any]:
        by_tag: dict[str, Any] = {}
        for tag in tags:
            if tag.tag in by_tag:
                self.error("tag stands twice in one block", tag, f"{shown}.{tag.tag}", code="duplicate-tag", value=text_of(tag))
            else:
                by_tag[tag.tag] = tag
        return by_tag

    def _report_unknown(self, actuator: type[Actuator], by_tag: Mapping[str, Any], shown: str) -> None:
        known = (*BLOCK_TAGS, *tag_parameters(actuator))
        for name, tag in by_tag.items():
            if name not in known:
                close = nearest(name, known)
                self.warn(
                    f"unknown tag <{name}>; it has no effect", tag, f"{shown}.{name}", code="unknown-tag",
                    hint=f"Did you mean <{close}>?" if close else None,
                )  # fmt: skip

    def _joint(self, by_tag: Mapping[str, Any], line: int | None, shown: str) -> Joint | None:
        movable = tuple(joint.name for joint in self.joints.values() if joint.moves)
        if "joint" not in by_tag:
            self.findings.error("required tag <joint> is missing", code="missing-tag", line=line, key=shown, choices=movable)
            return None
        tag = by_tag["joint"]
        name, key = text_of(tag), f"{shown}.joint"
        joint = self.joints.get(name)
        if joint is None:
            self.error(
                "the robot has no such joint", tag, key, code="unknown-joint", value=name, choices=movable,
                hint=did_you_mean(name, tuple(self.joints)),
            )  # fmt: skip
            return None
        if not joint.moves:
            self.error(
                f"a {joint.kind} joint cannot have an actuator", tag, key, code="joint-type", value=name, choices=movable
            )
            return None
        if name in self._block_lines:
            first = f", the other on line {self._block_lines[name]}" if self._block_lines[name] else ""
            self.error(f"two actuators on one joint{first}", tag, key, code="two-actuators", value=name)
            return None
        self._block_lines[name] = line
        return joint

    def _mode(self, by_tag: Mapping[str, Any], line: int | None, shown: str) -> int | None:
        if "operation_mode" not in by_tag:
            self.findings.error(
                "required tag <operation_mode> is missing", code="missing-tag", line=line, key=shown, choices=MODE_CHOICES
            )
            return None
        tag = by_tag["operation_mode"]
        text = text_of(tag)
        mode = int(text) if re.fullmatch("[0-9]{1,3}", text) else None
        if mode not in MODES:
            self.error(
                "there is no such operation mode", tag, f"{shown}.operation_mode", code="operation-mode", value=text,
                choices=MODE_CHOICES,
            )  # fmt: skip
            return None
        return mode

    def _switch(self, by_tag: Mapping[str, Any], name: str, shown: str, default: bool) -> bool:
        if name not in by_tag:
            return default
        text = text_of(by_tag[name])
        if text.lower() not in (*_TRUE, *_FALSE):
            self.error(
                "must be true or false", by_tag[name], f"{shown}.{name}", code="not-a-boolean", value=text,
                choices=("true", "false", "1", "0"),
            )  # fmt: skip
            return default
        return text.lower() in _TRUE

    def _sample_time(self, by_tag: Mapping[str, Any], shown: str) -> float | None:
        if "t_sample" not in by_tag:
            return None
        value = self._number(by_tag["t_sample"], f"{shown}.t_sample")
        if value is not None and not (math.isfinite(value) and value > 0.0):
            self.error(
                "must be larger than 0 s", by_tag["t_sample"], f"{shown}.t_sample", code="out-of-range",
                value=text_of(by_tag["t_sample"]),
            )  # fmt: skip
            return None
        return value

    def _parameters(
        self, actuator: type[Actuator], by_tag: Mapping[str, Any], mode: int | None, shown: str
    ) -> dict[str, ParameterValue]:
        tags = parameter_tags(actuator)
        accepted: dict[str, list[str]] = {}
        for tag, name in tag_parameters(actuator).items():
            accepted.setdefault(name, []).append(tag)
        values: dict[str, ParameterValue] = {}
        for parameter in actuator.all_parameters():
            present = [tag for tag in accepted[parameter.name] if tag in by_tag]
            values[parameter.name] = (
                self._tag_value(parameter, present[0], by_tag[present[0]], shown)
                if present
                else default_parameter(parameter, mode, tags[parameter.name])
            )
        return values

    def _tag_value(self, parameter: Parameter, name: str, tag: Any, shown: str) -> ParameterValue:
        key = f"{shown}.{name}"
        value = self._number(tag, key)
        fault = None if value is None else parameter_fault(parameter, value)
        if fault:
            self.error(fault, tag, key, code="out-of-range", value=text_of(tag))
        return ParameterValue(
            name=parameter.name,
            value=UNREAD if value is None or fault else value,
            unit=parameter.unit,
            origin="tag",
            tag=name,
            line=self.line(tag),
            text=text_of(tag),
        )

    def _number(self, tag: Any, key: str) -> float | None:
        text = text_of(tag)
        try:
            number = read_number(text)
        except ValueError as error:
            self.error(
                str(error), tag, key, code="not-a-number", value=text,
                hint=f"The toolbox would read {leading_number(text):g}" if text else None,
            )  # fmt: skip
            return None
        if number.arithmetic:
            self.warn(
                f"arithmetic, taken as {number.value:g}; the toolbox reads only the leading number {leading_number(text):g}",
                tag, key, code="misread-value", value=text,
            )  # fmt: skip
        return number.value
