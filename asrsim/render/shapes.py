"""Shapes of every link for pictures: the visuals of the link, else its collision shapes, else a rod and a ball."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from asrsim.errors import listed
from asrsim.robot import Robot
from asrsim.robot.meshes import usable_shapes
from asrsim.robot.model import Shape
from asrsim.robot.shapes import Rgba
from asrsim.samples import Array

_BODY_COLOURS: tuple[Rgba, ...] = ((0.38, 0.42, 0.47, 1.0), (0.62, 0.66, 0.70, 1.0))
_ROD_COLOURS: tuple[Rgba, ...] = ((0.84, 0.37, 0.0, 1.0), (0.0, 0.45, 0.70, 1.0))
_BALL_COLOUR: Rgba = (0.15, 0.15, 0.17, 1.0)


def drawable(robot: Robot, package_paths: Mapping[str, Path | str] | None = None) -> tuple[Robot, tuple[str, ...]]:
    """The robot with visuals for links without visuals, and notes for the user about meshes and links.

    A link without visuals gets its collision shapes as visuals. A link without any shapes gets rods, which lead from its frame
    to each joint attached to it, or to its centre of mass. The thickness of the rods follows from their lengths. Fixed links
    without children get no visuals.
    """
    robot, warnings = usable_shapes(robot, visuals=True, package_paths=package_paths)
    ends = _rod_ends(robot)
    lengths = [float(np.linalg.norm(end)) for each in ends.values() for end in each]
    # For the thickness, ignore short rods between frames at nearly the same point.
    long = [length for length in lengths if length > 0.1 * max(lengths)]
    radius = min(0.03 * max(lengths, default=0.1), 0.08 * float(np.median(long)) if long else 0.01) or 0.01
    collisions, rods, links = [], [], []
    for number, link in enumerate(robot.links):
        visuals = link.visuals
        if not visuals and link.collisions:
            collisions.append(link.name)
            visuals = tuple(replace(shape, colour=_BODY_COLOURS[number % 2]) for shape in link.collisions)
        elif not visuals and link.name in ends:
            rods.append(link.name)
            visuals = tuple(shape for end in ends[link.name] for shape in _rod(end, radius, _ROD_COLOURS[number % 2]))
        links.append(replace(link, visuals=visuals))
    # Leave out warnings with a key. They are about collision shapes, which pictures do not show.
    notes = [str(warning) for warning in warnings if warning.key is None]
    if collisions:
        notes.append(f"links without visuals, drawn by their collision shapes: {listed(collisions, 6)}")
    if rods:
        notes.append(f"links without shapes, drawn as rods: {listed(rods, 6)}")
    return replace(robot, links=tuple(links)), tuple(notes)


def _rod_ends(robot: Robot) -> dict[str, list[Array]]:
    """End points of the rods that show each link if it has no shapes, in the frame of the link, m."""
    ends: dict[str, list[Array]] = {}
    for joint in robot.joints:
        if np.linalg.norm(joint.origin) > 1e-9:
            ends.setdefault(joint.parent, []).append(np.array(joint.origin))
    moved = {joint.child for joint in robot.joints if joint.kind != "fixed"}
    for link in robot.links:
        # Draw a link that moves as a ball even if its centre of mass is at the origin of its frame.
        if link.name not in ends and link.mass and (np.linalg.norm(link.centre_of_mass) > 1e-9 or link.name in moved):
            ends[link.name] = [np.array(link.centre_of_mass)]
    return ends


def _rod(end: Array, radius: float, colour: Rgba) -> list[Shape]:
    """Ball at the origin of a link's frame, and a rod from there to `end` (3,), m."""
    ball = Shape(kind="sphere", size=(1.6 * radius,), colour=_BALL_COLOUR)
    length = float(np.linalg.norm(end))
    if length < 1e-9:
        return [ball]
    # Turn the axis z of the cylinder into the direction of the rod, first about y by the angle between z and the rod, and then
    # about z.
    pitch, yaw = float(np.arccos(np.clip(end[2] / length, -1.0, 1.0))), float(np.arctan2(end[1], end[0]))
    x, y, z = (0.5 * end).tolist()
    return [ball, Shape(kind="cylinder", size=(radius, length), origin=(x, y, z), rpy=(0.0, pitch, yaw), colour=colour)]
