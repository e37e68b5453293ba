"""What joints have beside actuators: Gazebo's passive springs, and joints that are to follow others (`<mimic>`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from asrsim.errors import did_you_mean
from asrsim.robot.attributes import AttributeReader
from asrsim.robot.model import ActuatorBlock, Joint, Mimic
from asrsim.robot.numbers import plain_number
from asrsim.robot.tags import JOINT_TAGS
from asrsim.robot.xmlfile import elements, name_of, text_of

STIFFNESS, REFERENCE, EXCESS, PACE, SHARE = JOINT_TAGS.values()
FRICTION = {tag: field for field, tag in JOINT_TAGS.items() if tag in (EXCESS, PACE, SHARE)}
"""Tag -> field of a joint: friction that depends on speed and load."""


class PassiveReader(AttributeReader):
    """Reads springs of `<gazebo reference="JOINT">`; problems go to `findings`."""

    def springs(self, root: Any, joints: Sequence[Joint]) -> tuple[Joint, ...]:
        """The joints, each with its spring. A tag that stands twice counts the last time, as in Gazebo."""
        found = {joint.name: joint for joint in joints}
        lines: dict[str, int | None] = {}
        for tag, name in self._tags(root, joints, (STIFFNESS, REFERENCE), "passive spring", "misplaced-spring"):
            value = self._value(tag, name)
            if tag.tag == STIFFNESS:
                lines[name] = self.line(tag)
                found[name] = replace(found[name], spring_stiffness=value)
            else:
                lines.setdefault(name, self.line(tag))
                found[name] = replace(found[name], spring_reference=value)
        for name, line in lines.items():
            self._judge(found[name], line)
        return tuple(found[joint.name] for joint in joints)

    def frictions(self, root: Any, joints: Sequence[Joint]) -> tuple[Joint, ...]:
        """The joints, each with its friction beside the Coulomb level."""
        found = {joint.name: joint for joint in joints}
        last_tags: dict[str, Any] = {}
        for tag, name in self._tags(root, joints, FRICTION, "friction", "misplaced-friction"):
            value = self._value(tag, name)
            if value < 0.0 or (value == 0.0 and tag.tag == PACE):
                self.error(
                    f"must be {'larger than' if tag.tag == PACE else 'at least'} 0", tag, f"{name}.{tag.tag}",
                    code="out-of-range", value=f"{value:g}",
                    hint="It is what static friction has above the Coulomb level" if tag.tag == EXCESS else None,
                )  # fmt: skip
                continue
            changed: dict[str, Any] = {FRICTION[tag.tag]: value}
            found[name] = replace(found[name], **changed)
            last_tags[name] = tag
        for name, tag in last_tags.items():
            if not found[name].friction_varies:
                self.warn(
                    f"has no effect: the joint has neither <{EXCESS}> nor <{SHARE}>", tag, f"{name}.{tag.tag}",
                    code="no-friction",
                )  # fmt: skip
            elif found[name].load_friction >= 1.0:
                self.warn(
                    "friction grows by more than the torque that drives the joint: nothing moves it", tag, f"{name}.{SHARE}",
                    code="self-locking", value=f"{found[name].load_friction:g}",
                )  # fmt: skip
        return tuple(found[joint.name] for joint in joints)

    def _tags(self, root: Any, joints: Sequence[Joint], tags: Iterable[str], what: str, code: str) -> Iterator[tuple[Any, str]]:
        """Tags of these names in blocks of moving joints, with the joint's name; a warning for each of another block."""
        kinds = {joint.name: joint.kind for joint in joints}
        moving = tuple(joint.name for joint in joints if joint.moves)
        for gazebo in elements(root, "gazebo"):
            name = name_of(gazebo, "reference")
            for tag in (tag for key in tags for tag in elements(gazebo, key)):
                if name in moving:
                    yield tag, name
                    continue
                why = f"a {kinds[name]} joint does not move" if name in kinds else "the robot has no such joint"
                hint = None if name in kinds else did_you_mean(name, moving)
                self.warn(f"{what} without effect: {why}", tag, f"{name}.{tag.tag}", code=code, hint=hint)

    def _value(self, tag: Any, name: str) -> float:
        text, key = text_of(tag), f"{name}.{tag.tag}"
        try:
            value = plain_number(text)
        except ValueError as error:
            self.error(str(error), tag, key, code="not-a-number", value=text)
            return 0.0
        return self.bounded(value, text, tag, key, finite=True)

    def _judge(self, joint: Joint, line: int | None) -> None:
        key = f"{joint.name}.{STIFFNESS}"
        if joint.spring_stiffness < 0.0:
            self.findings.warn(
                "the passive spring pushes the joint away from its reference: its stiffness is negative",
                code="negative-spring", line=line, key=key, value=f"{joint.spring_stiffness:g}",
            )  # fmt: skip
        elif joint.spring_stiffness == 0.0:
            self.findings.warn("the passive spring has no stiffness: it does nothing", code="no-spring", line=line, key=key)

    def judge(self, joints: Sequence[Joint], blocks: Sequence[ActuatorBlock]) -> None:
        """Warn of springs on joints that an actuator drives, and of joints that should follow others."""
        driven = {block.joint for block in blocks}
        names = tuple(joint.name for joint in joints)
        for joint in joints:
            if joint.spring_stiffness and joint.name in driven:
                self.findings.warn(
                    "the joint has an actuator and a passive spring: both act on it",
                    code="two-springs", line=joint.line, key=joint.name, value=f"{joint.spring_stiffness:g}",
                )  # fmt: skip
            if joint.mimic is not None and joint.moves:
                self._judge_mimic(joint, joint.mimic, names, joint.name in driven)

    def _judge_mimic(self, joint: Joint, mimic: Mimic, names: tuple[str, ...], driven: bool) -> None:
        if mimic.joint not in names or mimic.joint == joint.name:
            self.findings.warn(
                "<mimic> follows itself" if mimic.joint == joint.name else "<mimic> follows a joint that is not there",
                code="mimic-of-nothing", line=joint.line, key=joint.name, value=mimic.joint,
                hint=None if mimic.joint == joint.name else did_you_mean(mimic.joint, names),
            )  # fmt: skip
        elif not driven:
            self.findings.warn(
                "<mimic> is not simulated: nothing couples the joint to the one that it should follow; it moves freely under "
                "gravity, its damping and friction",
                code="mimic-joint", line=joint.line, key=joint.name, value=str(mimic),
                hint="Give both joints actuators with references that go together, or make this one fixed",
            )  # fmt: skip
