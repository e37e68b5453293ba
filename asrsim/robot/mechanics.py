"""Reads the elements of a robot file about the mechanics of its drives: couplings of joints, rotors, gravity, initial
positions.

These elements belong to several dialects: URDF, transmissions of ROS, Drake, Gazebo and ros2_control.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from asrsim.errors import did_you_mean
from asrsim.robot.findings import Findings
from asrsim.robot.model import Joint, Link, Vector
from asrsim.robot.poses import roll_pitch_yaw, rotation_about, rotation_matrix
from asrsim.robot.vocabulary import RATIO, ROTOR
from asrsim.robot.xmlfile import elements, name_of, text_of

TRUE, FALSE = ("true", "1"), ("false", "0")


def read_mechanics(
    findings: Findings, root: Any, links: Sequence[Link], joints: Sequence[Joint]
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Links with their gravity, and joints with their couplings, rotors and initial positions."""
    found = {joint.name: joint for joint in joints}
    for name, inertia in _rotors(findings, root):
        if name in found and found[name].moves:
            found[name] = replace(found[name], rotor_inertia=found[name].rotor_inertia + inertia)
    for name, start in _starts(findings, root):
        if name in found and found[name].moves:
            found[name] = replace(found[name], start=start)
    for mimic in (*_mimic_plugins(findings, root), *_mimic_parameters(findings, root)):
        joint = found.get(mimic.follower)
        if joint is None or not joint.moves:
            hint = None if joint else did_you_mean(mimic.follower, tuple(found))
            what = "does not move" if joint else "does not exist"
            message = f"couples a joint that {what}, so the coupling has no effect"
            findings.warn(message, mimic.element, mimic.follower or "mimic", code="mimic-joint", hint=hint)
        elif not joint.mimic:
            found[joint.name] = replace(joint, mimic=mimic.master, multiplier=mimic.ratio, offset=mimic.offset)
    floating = {name for name, off in _gravity(findings, root, {link.name for link in links}) if off}
    coupled = _coupled(findings, tuple(found.values()))
    return tuple(replace(link, gravity=False) if link.name in floating else link for link in links), coupled


# -- couplings ---------------------------------------------------------------------------------------------------------


class _Mimic(NamedTuple):
    element: Any
    follower: str
    master: str
    ratio: float
    offset: float


def _mimic_plugins(findings: Findings, root: Any) -> Iterator[_Mimic]:
    """Couplings by Gazebo's mimic plugins."""
    for gazebo in elements(root, "gazebo"):
        for plugin in elements(gazebo, "plugin"):
            tags = {tag.tag: tag for tag in elements(plugin)}
            if not {"joint", "mimicJoint"} <= set(tags):
                continue
            follower = text_of(tags["mimicJoint"])
            numbers = [_number(findings, tags.get(key), follower, default) for key, default in _MIMIC]
            yield _Mimic(plugin, follower, text_of(tags["joint"]), *numbers)


def _mimic_parameters(findings: Findings, root: Any) -> Iterator[_Mimic]:
    """Couplings in blocks of ros2_control."""
    for joint in _controlled(root):
        tags = {name_of(tag): tag for tag in elements(joint, "param")}
        if "mimic" in tags and text_of(tags["mimic"]).lower() not in (*TRUE, *FALSE):
            numbers = [_number(findings, tags.get(key), name_of(joint), default) for key, default in _MIMIC]
            yield _Mimic(joint, name_of(joint), text_of(tags["mimic"]), *numbers)


_MIMIC = (("multiplier", 1.0), ("offset", 0.0))


def _number(findings: Findings, tag: Any, key: str, default: float) -> float:
    """Number in a tag; the default without a tag."""
    return default if tag is None else findings.value(text_of(tag), text_of(tag), tag, f"{key}.{tag.tag}")


def _coupled(findings: Findings, joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Joints that are coupled to masters that follow no joint, with consistent limits. A joint whose master does not move is
    fixed."""
    named = {joint.name: joint for joint in joints}
    found = {joint.name: _resolved(findings, joint, named) for joint in joints}
    for joint in list(found.values()):
        if joint.mimic:
            found[joint.mimic] = _narrowed(findings, found[joint.mimic], joint)
    return tuple(_limited(joint, found[joint.mimic]) if joint.mimic else joint for joint in found.values())


def _resolved(findings: Findings, joint: Joint, named: Mapping[str, Joint]) -> Joint:
    """The joint, coupled to the last joint in its chain of masters; uncoupled if it follows no joint."""
    if not joint.mimic or not joint.moves:
        return replace(joint, mimic="")
    ratio, offset, at, seen = 1.0, 0.0, joint, {joint.name}
    while at.mimic and at.moves and ratio:
        master = named.get(at.mimic)
        if master is None:
            message = "mimics a joint that does not exist; this coupling has no effect"
            hint = did_you_mean(at.mimic, tuple(named))
            if at is joint:
                findings.warn(message, joint.line, joint.name, code="mimic-joint", value=at.mimic, hint=hint)
                return replace(joint, mimic="")
            break
        if master.name in seen:
            message = "mimics itself, directly or through other joints"
            findings.error(message, joint.line, joint.name, code="mimic-loop", value=" -> ".join([*seen, master.name]))
            return replace(joint, mimic="")
        seen.add(master.name)
        offset += ratio * at.offset
        ratio *= at.multiplier
        at = master
    if at.moves and ratio:
        return replace(joint, mimic=at.name, multiplier=ratio, offset=offset)
    why = f"joint '{at.name}' does not move" if ratio else "the multiplier is 0"
    message = f"mimics a joint but cannot move, since {why}: it is fixed at its offset"
    findings.warn(message, joint.line, joint.name, code="mimic-fixed", value=f"{offset:g}")
    return fixed_at(joint, offset)


def fixed_at(joint: Joint, position: float) -> Joint:
    """The joint, locked at a position in rad or m."""
    turned = rotation_matrix(joint.rpy)
    if joint.kind == "prismatic":
        x, y, z = (joint.origin + turned @ joint.axis * position).tolist()
        return replace(joint, kind="fixed", origin=(x, y, z), mimic="")
    rpy: Vector = roll_pitch_yaw(turned @ rotation_about(joint.axis, position)) if position else joint.rpy
    return replace(joint, kind="fixed", rpy=rpy, mimic="")


def _narrowed(findings: Findings, master: Joint, follower: Joint) -> Joint:
    """The master with limits within which the follower keeps its own limits; the unchanged master if there are no such
    limits."""
    low, high = master.stops
    ends = sorted((stop - follower.offset) / follower.multiplier for stop in follower.stops)
    least, most = max(low, ends[0]), min(high, ends[1])
    slack = 1e-6 * (1.0 + min(abs(least), abs(most)))
    if least + slack >= most:
        message = f"has limits that leave joint '{master.name}' no range: these limits are not enforced"
        value = f"{master.name} from {ends[0]:g} to {ends[1]:g}"
        findings.warn(message, follower.line, follower.name, code="mimic-limits", value=value)
        return master
    if least > low + slack or most < high - slack:
        message = f"has limits that narrow the range of joint '{master.name}'"
        findings.warn(message, follower.line, follower.name, code="mimic-limits", value=f"{least:g} to {most:g}")
        return _with_stops(master, least, most)
    return master


def _limited(follower: Joint, master: Joint) -> Joint:
    """The follower with the range that its master's range gives."""
    return _with_stops(follower, *sorted(follower.multiplier * stop + follower.offset for stop in master.stops))


def _with_stops(joint: Joint, low: float, high: float) -> Joint:
    return replace(joint, lower=low if math.isfinite(low) else None, upper=high if math.isfinite(high) else None)


# -- rotors ------------------------------------------------------------------------------------------------------------


def _rotors(findings: Findings, root: Any) -> Iterator[tuple[str, float]]:
    """Joint and inertia of each rotor, as felt at the joint in kg m^2 (kg)."""
    for joint in elements(root, "joint"):
        for dynamics in elements(joint, "dynamics")[:1]:
            value = findings.number(dynamics, "armature", f"{name_of(joint)}.dynamics.armature", required=False)
            if value < 0.0:
                message = "armature must not be negative"
                findings.error(message, dynamics, name_of(joint), code="negative-armature", value=f"{value:g}")
            elif value:
                yield name_of(joint), value
    for place in (root, *elements(root, "ros2_control")):
        for transmission in elements(place, "transmission"):
            yield from _of_transmission(findings, transmission)


def _of_transmission(findings: Findings, transmission: Any) -> Iterator[tuple[str, float]]:
    joints = elements(transmission, "joint")
    if len(joints) != 1:
        return  # for a differential, the file does not state which rotor turns with which joint
    name = name_of(joints[0]) or text_of(joints[0])
    for actuator in elements(transmission, "actuator"):
        # The reduction is in the actuator in ROS 1, in the joint in ros2_control, and in the transmission in files from before
        # ROS 1.0.
        places = (actuator, joints[0], transmission)
        inertia = _first(findings, places, ROTOR, name, 0.0)
        # Read the ratio only if there is an inertia. Without an inertia the ratio has no effect, and some files still contain
        # template text instead of the ratio.
        ratio = _first(findings, places, RATIO, name, 1.0) if inertia else 1.0
        if inertia < 0.0:
            message = "the inertia of a motor must not be negative"
            findings.error(message, actuator, name, code="negative-armature", value=f"{inertia:g}")
        elif inertia:
            yield name, inertia * ratio * ratio


def _first(findings: Findings, parents: Sequence[Any], names: tuple[str, ...], key: str, default: float) -> float:
    """Number in the first child that has one of the names, in any name space."""
    for parent in parents:
        for tag in elements(parent):
            if tag.tag.rpartition("}")[2].rpartition(":")[2] in names:
                text = tag.get("value") or text_of(tag)
                return findings.value(text, text, tag, f"{key}.{tag.tag}")
    return default


# -- gravity and start -------------------------------------------------------------------------------------------------


def _gravity(findings: Findings, root: Any, links: Container[str]) -> Iterator[tuple[str, bool]]:
    """Link, and whether its gravity is off, for each element about gravity. If a link has several such elements, the last one
    is used."""
    words: dict[str, bool] = {}
    uses = [
        (name_of(one, "reference"), tag) for one in elements(root, "gazebo") for tag in elements(one) if tag.tag in _GRAVITY
    ]
    uses += [(name_of(link), tag) for link in elements(root, "link") for tag in elements(link, "gravity")]
    for name, tag in uses:
        text = (tag.get("value") or text_of(tag)).lower()
        if text not in (*TRUE, *FALSE):
            message = f"<{tag.tag}> is neither true nor false, so it has no effect"
            findings.warn(message, tag, name or "gazebo", code="not-a-boolean", value=text)
        elif name in links:
            words[name] = (text in TRUE) == _GRAVITY[tag.tag]
        elif (text in TRUE) == _GRAVITY[tag.tag]:
            message = f"<{tag.tag}> has no effect: {'the robot has no such link' if name else 'it names no link'}"
            findings.warn(message, tag, name or "gazebo", code="misplaced-tag")
    yield from words.items()


_GRAVITY = {"turnGravityOff": True, "gravity": False}
"""Elements about gravity, and the value that switches gravity off."""


def _starts(findings: Findings, root: Any) -> Iterator[tuple[str, float]]:
    """Joint and initial position in blocks of ros2_control, rad or m."""
    for joint in _controlled(root):
        for tag in elements(joint, "param"):
            if name_of(tag) == "initial_position":  # earlier name of the parameter `initial_value`
                yield name_of(joint), _number(findings, tag, name_of(joint), 0.0)
        for interface in elements(joint, "state_interface"):
            for tag in elements(interface, "param"):
                value = _number(findings, tag, name_of(joint), 0.0) if name_of(tag) == "initial_value" else 0.0
                if name_of(interface) == "position" and name_of(tag) == "initial_value":
                    yield name_of(joint), value
                elif name_of(interface) == "velocity" and value:
                    message = "the initial velocity of ros2_control is left out: the joint starts at rest"
                    hint = f"`initial: {{{name_of(joint)}: {{velocity: {value:g}}}}}` in the scenario sets this velocity"
                    findings.warn(message, tag, name_of(joint), code="left-out", value=f"{value:g}", hint=hint)


def _controlled(root: Any) -> Iterator[Any]:
    """Joints in blocks of ros2_control."""
    for control in elements(root, "ros2_control"):
        yield from elements(control, "joint")
