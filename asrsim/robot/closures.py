"""Reads the joints of a robot file that close loops: `<loop_joint>`, and joints of SDF in `<gazebo>`.

A ball closes a loop at one point, a hinge at two points of its axis, a fixed joint at three points. If one point of a hinge
suffices, as in planar loops, the loop itself determines the axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from asrsim.errors import Problem, RobotError
from asrsim.robot.findings import Findings, words
from asrsim.robot.loops import Loop, assembly_of, linkages_of
from asrsim.robot.model import ZERO, Robot, Vector
from asrsim.robot.poses import HERE, Pose, link_poses
from asrsim.robot.structure import WORLD
from asrsim.robot.xmlfile import elements, name_of, text_of

SIZE = 0.1
"""Distance between the points at which a hinge or a fixed joint closes a loop, m."""
POINTS = {"spherical": 1, "ball": 1, "revolute": 2, "continuous": 2, "fixed": 3}
"""Number of points that coincide, by type of the joint."""


@dataclass(frozen=True, kw_only=True)
class Closure:
    """A joint that closes a loop."""

    element: Any
    name: str
    points: int
    links: tuple[str, str]
    poses: tuple[Pose, Pose]
    """Pose of the joint in the frame of each link."""
    axis: Vector

    def loops(self, *, points: int) -> tuple[Loop, ...]:
        """Loops that close this joint, each at one point. points: largest number of these points."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        places = [np.zeros(3), SIZE * axis, SIZE * across / np.linalg.norm(across)]
        ends = [[pose.position + pose.rotation @ place for pose in self.poses] for place in places[: min(self.points, points)]]
        return tuple(Loop(links=self.links, points=(_vector(first), _vector(second))) for first, second in ends)


def with_loops(findings: Findings, root: Any, robot: Robot) -> Robot:
    """Robot with the loops that its file states. A loop that cannot be simulated stays open, with a warning."""
    closures = [*_loop_joints(findings, root, robot), *_sdf_joints(findings, root, robot)]
    while closures:
        for points in (1, 3):
            # Only a hinge may need fewer points. A fixed joint always needs three points.
            parts = [closure.loops(points=3 if closure.points == 3 else points) for closure in closures]
            closed = replace(robot, loops=tuple(loop for part in parts for loop in part))
            found = assembly_of(closed).errors
            if not found:
                return closed
        owners = [k for k, part in enumerate(parts) for _ in part]
        bad = dict[int, Problem]()
        for fault in found:
            number = int((fault.key or "").rpartition(".")[2])
            bad |= {owners[k]: fault for k in _together(closed, number)}
        for index, fault in bad.items():
            closure = closures[index]
            message = f"the loop between the links '{closure.links[0]}' and '{closure.links[1]}' stays open: {fault.message}"
            findings.warn(
                message, closure.element, closure.name, code="loop", hint="State the loop under `loops` in the scenario"
            )
        closures = [closure for index, closure in enumerate(closures) if index not in bad]
    return robot


def _together(robot: Robot, number: int) -> Sequence[int]:
    """Indices of all loops in the linkage to which the loop with this number belongs."""
    try:
        return next((linkage.loops for linkage in linkages_of(robot) if number in linkage.loops), (number,))
    except RobotError:
        return (number,)


def _loop_joints(findings: Findings, root: Any, robot: Robot) -> Iterator[Closure]:
    """Closures by `<loop_joint>`, with the joint's pose in the frames of the two links."""
    for element in elements(root, "loop_joint"):
        ends = [tag for tag in elements(element) if tag.tag in ("link1", "link2")]
        name = name_of(element) or "loop_joint"
        if len(ends) != 2:
            findings.warn("does not have two links, so it closes no loop", element, name, code="loop")
            continue
        poses = [HERE.then(*(findings.vector(tag, key, name, default=ZERO) for key in ("xyz", "rpy"))) for tag in ends]
        axis = elements(element, "axis")
        along = findings.vector(axis[0], "xyz", f"{name}.axis", default=(1.0, 0.0, 0.0)) if axis else (1.0, 0.0, 0.0)
        links = [name_of(tag, "link") for tag in ends]
        yield from _closure(findings, robot, element, name_of(element, "type"), links, poses, along)


def _sdf_joints(findings: Findings, root: Any, robot: Robot) -> Iterator[Closure]:
    """Closures by joints of SDF in `<gazebo>`. Their pose is stated in the frame of the child link, at the zero posture."""
    places = link_poses(robot)
    for gazebo in elements(root, "gazebo"):
        for element in elements(gazebo, "joint"):
            tags = {tag.tag: tag for tag in elements(element)}
            name = name_of(element) or "joint"
            if not {"parent", "child"} <= set(tags):
                message = "<gazebo> changes it by elements of SDF; this has no effect in asrsim"
                findings.warn(message, element, name, code="left-out")
                continue
            parent, child = (text_of(tags[key]) or name_of(tags[key], "link") for key in ("parent", "child"))
            # A joint to the world only carries the root of the robot. The scenario states whether the base is fixed.
            links = [robot.root.name if link == WORLD and link not in places else link for link in (parent, child)]
            if links[1] == robot.root.name and parent == WORLD:
                continue
            x, y, z, *angles = _numbers(findings, tags.get("pose"), name, (0.0,) * 6)
            pose = HERE.then((x, y, z), (angles[0], angles[1], angles[2]))
            axis = elements(tags["axis"], "xyz") if "axis" in tags else []
            along = _numbers(findings, axis[0] if axis else None, name, (0.0, 0.0, 1.0))
            poses = [HERE, pose]
            if all(link in places for link in links):
                first, second = (places[link] for link in links)
                there = second.position + second.rotation @ pose.position
                poses[0] = Pose(
                    position=first.rotation.T @ (there - first.position),
                    rotation=first.rotation.T @ second.rotation @ pose.rotation,
                )
            yield from _closure(findings, robot, element, name_of(element, "type"), links, poses, along)


def _closure(
    findings: Findings,
    robot: Robot,
    element: Any,
    kind: str,
    links: Sequence[str],
    poses: Sequence[Pose],
    axis: Sequence[float],
) -> Iterator[Closure]:
    """The closure that an element states, if its links exist and its type can be simulated."""
    name, names = name_of(element) or "loop", {link.name for link in robot.links}
    missing = [link for link in links if link not in names]
    reason = f"there is no link '{missing[0]}'" if missing else f"a joint of type '{kind}' cannot close a loop"
    if missing or kind not in POINTS:
        findings.warn(f"the loop stays open: {reason}", element, name, code="loop", choices=() if missing else tuple(POINTS))
    elif not any(axis):
        findings.error("the axis of the joint is zero", element, name, code="zero-axis")
    else:
        x, y, z = axis
        yield Closure(
            element=element,
            name=name,
            points=POINTS[kind],
            links=(links[0], links[1]),
            poses=(poses[0], poses[1]),
            axis=(x, y, z),
        )


def _numbers(findings: Findings, tag: Any, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """Numbers in the text of a tag; the default without a tag."""
    parts = words(text_of(tag)) if tag is not None else []
    if tag is not None and len(parts) != len(default):
        findings.error(f"must be {len(default)} numbers", tag, f"{key}.{tag.tag}", code="not-a-number", value=text_of(tag))
    if len(parts) != len(default):
        return default
    return tuple(findings.value(part, text_of(tag), tag, f"{key}.{tag.tag}") for part in parts)


def _vector(array: Any) -> Vector:
    x, y, z = array.tolist()
    return x, y, z
