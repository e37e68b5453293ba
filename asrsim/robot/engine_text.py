"""URDF text for a physics engine, written from the robot's data. Engines never read a user's file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from lxml import etree

from asrsim.errors import Problem, RobotError
from asrsim.robot.inertia import principal_axes
from asrsim.robot.meshes import MESH_FORMATS, mesh_fault
from asrsim.robot.model import Joint, Link, Robot, Shape
from asrsim.robot.packages import Packages, package_name, packages_of
from asrsim.robot.shapes import SIZES

LONGEST_LINE = 1000
"""Longest line, bytes: PyBullet reads longer lines in pieces, and a break inside a tag makes the document invalid."""
NO_LIMIT = 1e9
"""Number in place of a missing limit, where the format requires a number (rad, m, N m, N, rad/s, m/s)."""


def usable_shapes(
    robot: Robot, *, visuals: bool = False, package_paths: Mapping[str, Path | str] | None = None
) -> tuple[Robot, tuple[Problem, ...]]:
    """Robot with the paths of its mesh files, without unusable meshes, and warnings.

    Meshes must exist in the robot's folder, its package or a known package. Each collision that is left out has a warning with
    its link; all visuals share one warning. `visuals=False` leaves out all visuals.
    """
    packages = packages_of(robot.path, package_paths)
    warnings: list[Problem] = []
    missing: list[tuple[str, str]] = []
    links = []
    for link in robot.links:
        readable: dict[str, list[Shape]] = {"collisions": [], "visuals": []}
        for name, shapes in (("collisions", link.collisions), ("visuals", link.visuals if visuals else ())):
            for shape in shapes:
                found = _mesh_file(shape, packages) if shape.kind == "mesh" else None
                if not isinstance(found, str):
                    readable[name].append(shape if found is None else replace(shape, mesh=str(found)))
                elif name == "visuals":
                    missing.append((shape.mesh, found))
                else:
                    message = f"collision mesh {found}; the link does not collide with it"
                    warnings.append(
                        Problem(
                            message, file=robot.path, line=shape.line, key=link.name, value=shape.mesh,
                            hint=_cure(shape.mesh, found), code="missing-collision-mesh",
                        )
                    )  # fmt: skip
        links.append(replace(link, collisions=tuple(readable["collisions"]), visuals=tuple(readable["visuals"])))
    if missing:
        first, fault = missing[0]
        message = f"{len(missing)} visual meshes are not drawn; the first {fault}"
        hint = _cure(first, fault)
        warnings.append(Problem(message, file=robot.path, value=first, hint=hint, code="missing-visual-mesh"))
    return replace(robot, links=tuple(links)), tuple(warnings)


def _mesh_file(shape: Shape, packages: Packages) -> Path | str:
    """File of a mesh, or the reason why it cannot be used."""
    if Path(shape.mesh).suffix.lower() not in MESH_FORMATS:
        return f"is none of {', '.join(MESH_FORMATS)}"
    found = packages.resolve(shape.mesh)
    return found if isinstance(found, str) else mesh_fault(found) or found


def engine_urdf(robot: Robot, *, package_paths: Mapping[str, Path | str] | None = None) -> tuple[str, tuple[Problem, ...]]:
    """URDF text of the robot that PyBullet can load, without visuals, and the warnings of `usable_shapes`.

    Everything is written from the robot's data with all digits, so that an engine reads the very numbers that were checked:
    links with mass, principal moments and shapes, joints with unit axes and limits. Damping and friction are
    omitted: asrsim applies them, so an engine must not apply them again. Links without `<inertial>`, except the root, get a
    massless `<inertial>`, since engines assume a mass where the text has none (PyBullet: 1 kg). A revolute joint without
    limits is written as continuous; a prismatic joint without limits has lower > upper, which engines read as no limits.

    Each element is on a separate line. Raises RobotError for an element too long for an engine.
    """
    robot, warnings = usable_shapes(robot, package_paths=package_paths)
    root = etree.Element("robot", name=robot.name)
    children = {joint.child for joint in robot.joints}
    for link in robot.links:
        element = etree.SubElement(root, "link", name=link.name)
        if link.mass is not None or link.inertia is not None or link.name in children:
            _inertial(element, link)
        for shape in link.collisions:
            _collision(element, shape)
    for joint in robot.joints:
        _joint(root, joint)
    return _in_short_lines(root, robot), warnings


def _cure(mesh: str, fault: str) -> str | None:
    """Hint to state the folder of a package whose folder is unknown."""
    name = package_name(mesh)
    if name is None or not fault.endswith("is not known"):
        return None
    return f"Say where it is: --package {name}=FOLDER, in a scenario robot: {{file: ..., packages: {{{name}: FOLDER}}}}"


def _inertial(parent: Any, link: Link) -> None:
    moments, rpy = principal_axes(link)
    inertial = etree.SubElement(parent, "inertial")
    _origin(inertial, link.centre_of_mass, rpy)
    etree.SubElement(inertial, "mass", value=repr(link.mass or 0.0))
    xx, yy, zz = map(repr, moments)
    etree.SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)


def _collision(parent: Any, shape: Shape) -> None:
    if shape.kind == "mesh":
        attributes = {"filename": shape.mesh, "scale": _numbers(shape.scale)}
    elif shape.kind == "box":
        attributes = {"size": _numbers(shape.size)}
    else:
        attributes = dict(zip(SIZES[shape.kind], map(repr, shape.size), strict=True))
    element = etree.SubElement(parent, "collision")
    _origin(element, shape.origin, shape.rpy)
    etree.SubElement(etree.SubElement(element, "geometry"), shape.kind, attributes)


def _joint(parent: Any, joint: Joint) -> None:
    limited = joint.lower is not None or joint.upper is not None
    kind = "continuous" if joint.kind == "revolute" and not limited else joint.kind
    element = etree.SubElement(parent, "joint", name=joint.name, type=kind)
    etree.SubElement(element, "parent", link=joint.parent)
    etree.SubElement(element, "child", link=joint.child)
    _origin(element, joint.origin, joint.rpy)
    if not joint.moves:
        return
    etree.SubElement(element, "axis", xyz=_numbers(joint.axis))
    lower, upper = joint.stops if limited else (1.0, -1.0)
    values = {"lower": lower, "upper": upper, "effort": joint.most_effort, "velocity": joint.velocity}
    if kind == "continuous":
        del values["lower"], values["upper"]
    finite = {key: repr(NO_LIMIT if value is None else min(max(value, -NO_LIMIT), NO_LIMIT)) for key, value in values.items()}
    etree.SubElement(element, "limit", finite)


def _origin(parent: Any, position: Sequence[float], rpy: Sequence[float]) -> None:
    etree.SubElement(parent, "origin", xyz=_numbers(position), rpy=_numbers(rpy))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(repr, values))


def _in_short_lines(root: Any, robot: Robot) -> str:
    """Document as text, with one element per line."""
    etree.indent(root, "")
    text: str = etree.tostring(root, encoding="unicode")
    for line in text.splitlines():
        if len(line.encode()) > LONGEST_LINE:
            message = f"an element is longer than {LONGEST_LINE} bytes, which PyBullet cannot read"
            raise RobotError(message, file=robot.path, value=line, code="long-element")
    return text
