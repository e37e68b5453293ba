"""Known payloads of recordings. A payload is a body with known mass, centre and inertia that is fixed to a link."""

from __future__ import annotations

from dataclasses import replace

from asrsim.errors import Problem
from asrsim.identification.task import Payload
from asrsim.robot.inertia import principal_moments
from asrsim.robot.model import Joint, Link, Robot

BODY, MOUNT = "_payload", "_payload_mount"
"""BODY: ending of the name of the payload's body.
MOUNT: ending of the name of the fixed joint between link and payload.
"""


def carrying(robot: Robot, payload: Payload | None) -> Robot:
    """Robot with a payload. The payload is a separate body, so that the parameters of the link do not contain it."""
    if payload is None:
        return robot
    body = Link(name=f"{payload.link}{BODY}", mass=payload.mass, centre_of_mass=payload.centre, inertia=payload.inertia)
    mount = Joint(name=f"{payload.link}{MOUNT}", kind="fixed", parent=payload.link, child=body.name)
    return replace(robot, links=(*robot.links, body), joints=(*robot.joints, mount))


def fault_of(robot: Robot, payload: Payload) -> Problem | None:
    """Problem of a payload; None if the robot can carry it."""
    names = tuple(link.name for link in robot.links)
    if payload.link not in names:
        return Problem("no link has this name", key="payload.link", meant=payload.link, choices=names, code="unknown-link")
    if f"{payload.link}{BODY}" in names:
        message = f"the robot has a link {payload.link}{BODY} already"
        return Problem(message, key="payload.link", hint="Rename this link in the robot file", code="payload")
    moments = principal_moments(payload.inertia)
    if moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        message = "its inertia is physically impossible: no principal moment may be negative or exceed the sum of the other two"
        return Problem(message, key="payload.inertia", value=str([*payload.inertia]), code="inertia")
    return None
