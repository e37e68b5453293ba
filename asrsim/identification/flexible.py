"""A robot with an elastic link. The link is cut into two bodies, which a torsional spring about the joint's axis connects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asrsim.robot.model import INERTIAS, Link, Robot

SHARE = 0.3
"""Fraction of the link's mass and inertia that belongs to the second body at the start of a search, in which the inertia of
this body is free. The modal mass of the first mode of a uniform beam is a quarter of the beam's mass.
"""
RATIO = 0.02
"""Damping ratio of the second mode. It is typical of lightly damped structures."""
TIP, BEND = "_tip", "_bend"
"""TIP: ending of the name of the second body.
BEND: ending of the name of the joint with the spring.
"""


def axis_inertia(robot: Robot, joint: str) -> str:
    """Name of the moment of inertia of a joint's link about the coordinate axis that is closest to the joint's axis: ixx, iyy
    or izz.
    """
    return ("ixx", "iyy", "izz")[int(np.argmax(np.abs(robot.joint(joint).axis)))]


def with_elastic_link(robot: Robot, joint: str, frequency: float) -> Robot | None:
    """Robot whose link behind a joint is elastic; None if the link has no inertia about the axis, or if the joint slides.

    The first body keeps the name of the link, and its joint keeps the sensor. The second body, behind the spring, carries the
    next joints. frequency: natural frequency of the second body on its spring, rad/s.
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
