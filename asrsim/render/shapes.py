"""Something to look at for every link: its own visuals, else its collision shapes, else a rod and a ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from lxml import etree

from asrsim.samples import Array

_BODY_COLOURS = ("0.38 0.42 0.47 1", "0.62 0.66 0.70 1")
_ROD_COLOURS = ("0.84 0.37 0.0 1", "0.0 0.45 0.70 1")


@dataclass(frozen=True, kw_only=True)
class Drawable:
    """A URDF whose every moving part can be seen."""

    urdf: str
    collisions: tuple[str, ...]
    """Links drawn by their collision shapes."""
    rods: tuple[str, ...]
    """Links drawn as a rod and a ball."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What to tell the user."""
        said = []
        if self.collisions:
            said.append(f"drawn by their collision shapes, for want of visuals: {_names(self.collisions)}")
        if self.rods:
            said.append(f"drawn as rods, for want of shapes: {_names(self.rods)}")
        return tuple(said)


def drawable(urdf: str) -> Drawable:
    """The text of a URDF with a `<visual>` for every link that lacks one.

    urdf: as for an engine (:func:`asrsim.robot.engine_urdf` with visuals): meshes that are not there are out already. Links
    that carry nothing and stand still are left alone. A rod leads from a link's frame to each joint that hangs on it, or to its
    centre of mass, as thick as fits their lengths.
    """
    root = etree.fromstring(urdf.encode(), etree.XMLParser(resolve_entities=False, no_network=True))
    links = {link.get("name", ""): link for link in root.findall("link")}
    ends = _rod_ends(root, links)
    lengths = [float(np.linalg.norm(end)) for each in ends.values() for end in each]
    # Short offsets between frames on one spot are no rods to measure by.
    long = [length for length in lengths if length > 0.1 * max(lengths)]
    radius = min(0.03 * max(lengths, default=0.1), 0.08 * float(np.median(long)) if long else 0.01) or 0.01
    collisions, rods = [], []
    for number, (name, link) in enumerate(links.items()):
        if link.find("visual") is not None:
            continue
        shapes = link.findall("collision")
        if shapes:
            collisions.append(name)
            for shape in shapes:
                _copy_as_visual(link, shape, _BODY_COLOURS[number % 2])
        elif ends.get(name):
            rods.append(name)
            for end in ends[name]:
                _add_rod(link, end, radius, _ROD_COLOURS[number % 2])
    return Drawable(urdf=etree.tostring(root, encoding="unicode"), collisions=tuple(collisions), rods=tuple(rods))


def _rod_ends(root: Any, links: dict[str, Any]) -> dict[str, list[Array]]:
    """Link -> points in its frame, m, that a rod leads to."""
    ends: dict[str, list[Array]] = {}
    moved: set[str] = set()
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            continue
        end = _vector(joint.find("origin"), "xyz")
        if np.linalg.norm(end) > 1e-9:
            ends.setdefault(parent.get("link", ""), []).append(end)
        if joint.get("type") != "fixed":
            moved.add(child.get("link", ""))
    for name, link in links.items():
        inertial = link.find("inertial")
        mass = inertial.find("mass") if inertial is not None else None
        if name in ends or mass is None or not float(mass.get("value", "0")) > 0:
            continue
        centre = _vector(inertial.find("origin"), "xyz")
        # A heavy link in its own frame is still a ball.
        if np.linalg.norm(centre) > 1e-9 or name in moved:
            ends[name] = [centre]
    return ends


def _copy_as_visual(link: Any, collision: Any, colour: str) -> None:
    visual = etree.SubElement(link, "visual")
    for child in collision:
        if isinstance(child.tag, str) and child.tag in ("origin", "geometry"):
            visual.append(etree.fromstring(etree.tostring(child)))
    _paint(visual, colour)


def _add_rod(link: Any, end: Array, radius: float, colour: str) -> None:
    ball = etree.SubElement(link, "visual")
    etree.SubElement(etree.SubElement(ball, "geometry"), "sphere", radius=repr(1.6 * radius))
    _paint(ball, "0.15 0.15 0.17 1")
    length = float(np.linalg.norm(end))
    if length < 1e-9:
        return
    rod = etree.SubElement(link, "visual")
    # Turns z onto the rod: about y by the angle to z, then about z.
    pitch, yaw = float(np.arccos(np.clip(end[2] / length, -1.0, 1.0))), float(np.arctan2(end[1], end[0]))
    middle = " ".join(repr(float(x)) for x in end / 2)
    etree.SubElement(rod, "origin", xyz=middle, rpy=f"0 {pitch!r} {yaw!r}")
    etree.SubElement(etree.SubElement(rod, "geometry"), "cylinder", radius=repr(radius), length=repr(length))
    _paint(rod, colour)


def _paint(visual: Any, colour: str) -> None:
    material = etree.SubElement(visual, "material", name=f"asrsim {colour}")
    etree.SubElement(material, "color", rgba=colour)


def _vector(element: Any, key: str) -> Array:
    text = element.get(key, "0 0 0") if element is not None else "0 0 0"
    values = np.array([float(part) for part in text.split()] or [0.0, 0.0, 0.0], dtype=np.float64)
    return values if len(values) == 3 else np.zeros(3)


def _names(names: tuple[str, ...], most: int = 6) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
