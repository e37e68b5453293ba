"""Makes one trimesh scene of a robot and its world, by yourdfpy.

yourdfpy gets the robot as asrsim has read it: expanded, checked, and with the mesh files that asrsim allows. As in ROS, a
COLLADA file's `<up_axis>` is ignored, so that the z axis of the file is the z axis of the link.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.robot.meshes import mesh_unit
from asrsim.robot.model import Robot, Shape, Vector
from asrsim.robot.poses import frame, rotation_matrix
from asrsim.samples import Array

if TYPE_CHECKING:
    import yourdfpy


def urdf_of(robot: Robot, objects: Mapping[str, Shape] | None = None) -> yourdfpy.URDF:
    """Robot as an object of yourdfpy, whose `scene` contains all shapes of robot and objects.

    robot: robot from `asrsim.render.shapes.drawable`. objects: shapes of the objects of the world, by name. Objects are links
    with a floating joint, at the root link.
    """
    import yourdfpy
    from yourdfpy import urdf

    links = [urdf.Link(name=link.name, visuals=_visuals(link.visuals)) for link in robot.links]
    joints = [
        urdf.Joint(
            name=joint.name,
            type=joint.kind,
            parent=joint.parent,
            child=joint.child,
            origin=origin_frame(joint.origin, joint.rpy),
            axis=np.array(joint.axis),
        )
        for joint in robot.joints
    ]
    for name, shape in (objects or {}).items():
        links.append(urdf.Link(name=name, visuals=_visuals([shape])))
        joints.append(urdf.Joint(name=f"{name} in the world", type="floating", parent=robot.root.name, child=name))
    # Let yourdfpy use the names of mesh files unchanged, since `usable_shapes` has resolved them.
    return yourdfpy.URDF(robot=urdf.Robot(robot.name, links, joints), filename_handler=lambda fname: fname)


def origin_frame(position: Vector, rpy: Vector) -> Array:
    """Frame (4, 4) of a URDF `<origin xyz rpy>`, m and rad."""
    return frame(np.array(position), rotation_matrix(rpy))


def _visuals(shapes: Sequence[Shape]) -> list[Any]:
    from yourdfpy import urdf

    found = []
    for shape in shapes:
        colour = None if shape.colour is None else urdf.Material(color=urdf.Color(np.array(shape.colour)))
        place = origin_frame(shape.origin, shape.rpy)
        found += [urdf.Visual(origin=place @ inner, geometry=one, material=colour) for inner, one in _geometries(shape)]
    return found


def _geometries(shape: Shape) -> Iterator[tuple[Array, Any]]:
    """Solids of yourdfpy that together make a shape, each with its frame (4, 4) in the frame of the shape."""
    from yourdfpy import urdf

    if shape.kind == "mesh":
        scale = mesh_unit(Path(shape.mesh)) * np.array(shape.scale)
        yield np.eye(4), urdf.Geometry(mesh=urdf.Mesh(shape.mesh, scale))
    elif shape.kind == "box":
        yield np.eye(4), urdf.Geometry(box=urdf.Box(np.array(shape.size)))
    elif shape.kind == "sphere":
        yield np.eye(4), urdf.Geometry(sphere=urdf.Sphere(*shape.size))
    else:
        radius, length = shape.size
        yield np.eye(4), urdf.Geometry(cylinder=urdf.Cylinder(radius, length))
        # Make a capsule of a cylinder with a ball at each end, since URDF has no capsules.
        for end in (-0.5 * length, 0.5 * length) if shape.kind == "capsule" else ():
            yield origin_frame((0.0, 0.0, end), (0.0, 0.0, 0.0)), urdf.Geometry(sphere=urdf.Sphere(radius))
