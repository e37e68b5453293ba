"""A robot with an elastic link: a link is cut into two bodies, with a spring between them that bends about the joint's axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asrsim.robot.model import INERTIAS, Link, Robot

SHARE = 0.3
"""Fraction of the link's mass and inertia that lies beyond the spring at the start of a search; the search then frees the
inertia. In the first mode of a uniform beam, the fraction is a quarter.
"""
RATIO = 0.02
"""Damping ratio of the second mode: that of a lightly damped structure."""
TIP, BEND = "_tip", "_bend"
"""Endings of the names of the second body and of the joint with the spring."""


def axis_inertia(robot: Robot, joint: str) -> str:
    """Name of the moment of inertia of a joint's link nearest to the joint's axis: ixx, iyy or izz."""
    return ("ixx", "iyy", "izz")[int(np.argmax(np.abs(robot.joint(joint).axis)))]


def with_elastic_link(robot: Robot, joint: str, frequency: float) -> Robot | None:
    """Robot whose link behind a joint is elastic; None if the link has no inertia about the axis, or if the joint slides.

    The body before the spring has the joint's name and carries the sensor; the body behind the spring carries the next joints.
    frequency: frequency of the second body on its spring, rad/s.
    """
    own = robot.joint(joint)
    links = {link.name: link for link in robot.links}
    link = links[own.child]
    if own.kind == "prismatic" or link.mass is None or link.inertia is None:
        return None
    moment = link.inertia[INERTIAS.index(axis_inertia(robot, joint))]
    away = np.cross(own.axis, link.centre_of_mass)
    inertia = SHARE * (moment + link.mass * float(away @ away))
    if not inertia > 0.0:
        return None

    def part(share: float, name: str) -> Link:
        xx, xy, xz, yy, yz, zz = (share * one for one in link.inertia or (0.0,) * 6)
        moments = xx, xy, xz, yy, yz, zz
        return replace(link, name=name, mass=share * (link.mass or 0.0), inertia=moments, visuals=(), collisions=())

    tip, bend = f"{link.name}{TIP}", f"{joint}{BEND}"
    bodies = [one if one is not link else part(1.0 - SHARE, link.name) for one in robot.links]
    spring = replace(
        own, name=bend, kind="continuous", parent=link.name, child=tip, origin=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0),
        lower=None, upper=None, effort=None, velocity=None, friction=0.0, stribeck_friction=0.0, load_friction=0.0,
        spring_stiffness=inertia * frequency**2, spring_reference=0.0, damping=2.0 * RATIO * inertia * frequency, mimic="",
        rotor_inertia=0.0, armature=0.0, start=None,
    )  # fmt: skip
    joints = [replace(one, parent=tip) if one.parent == link.name else one for one in robot.joints]
    return replace(robot, links=(*bodies, part(SHARE, tip)), joints=(*joints, spring))
