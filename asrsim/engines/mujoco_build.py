"""A MuJoCo model of a scenario's robot and world, made from asrsim's data about robot and world."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.engines.base import GROUND
from asrsim.engines.mujoco_library import load
from asrsim.errors import RobotError
from asrsim.robot.meshes import convex_hull
from asrsim.robot.model import Robot, Shape, Vector
from asrsim.robot.poses import quaternion, rotation_matrix
from asrsim.scenario.data import Scenario, World

ROBOT_BIT, WORLD_BIT = 1, 2
"""ROBOT_BIT: collision class of the robot; WORLD_BIT: collision class of the world. The robot collides only with the world;
objects of the world also collide with each other."""
IMPEDANCE_RATIO = 1000.0
"""Ratio of a contact's stiffness against slip to its stiffness against penetration, called `impratio` in MuJoCo."""
HIDDEN_GROUP = 4
"""Group of the sites in the model; MuJoCo's viewers hide this group."""
HARD = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Impedance of constraints. It is the hardest impedance that MuJoCo accepts."""


def build(scenario: Scenario, robot: Robot, origin: Vector) -> Any:
    """The compiled model (MjModel) of a robot without fixed joints. Raises RobotError with MuJoCo's reason.

    Every body gets 1 kg and 1 kg m^2 for now, since MuJoCo rejects massless bodies here; the engine sets the true values later.
    """
    mujoco, contacts = load(), not scenario.world.empty
    flags = mujoco.mjtDisableBit
    off = [flags.mjDSBL_EULERDAMP, flags.mjDSBL_REFSAFE, flags.mjDSBL_AUTORESET, flags.mjDSBL_ISLAND]
    try:
        spec = assemble(scenario, robot, origin, shapes=contacts)
        if contacts:
            couple(spec, robot, HARD)
        spec.option.disableflags = sum(int(flag) for flag in (off if contacts else [*off, flags.mjDSBL_CONTACT]))
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        for link in robot.links:
            spec.body(link_body(link.name)).simple = mujoco.mjtLimited.mjLIMITED_FALSE
        for mesh in spec.meshes:
            mesh.uservert = convex_hull(Path(mesh.file), mesh.scale).vertices.ravel()
            mesh.file, mesh.scale = "", [1.0, 1.0, 1.0]
        # Let MuJoCo merge a fixed base into the world, since the base needs no body if there are no contacts. This saves a
        # tenth of the time of a step with one joint.
        spec.compiler.fusestatic = not contacts
        return spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())[:200]
        raise RobotError(f"MuJoCo cannot load this robot ({reason})", file=robot.path, code="engine-load") from error


def assemble(scenario: Scenario, robot: Robot, origin: Vector, *, shapes: bool) -> Any:
    """Editable model (MjSpec) of a robot without fixed joints in its world. Its joints have no limits, and each body has a mass
    of 1 kg.

    origin: origin of the base's frame in the frame of the root link, m. shapes: whether the links have their collision
    shapes.
    """
    mujoco = load()
    spec = mujoco.MjSpec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPEDANCE_RATIO
    spec.option.gravity = list(scenario.gravity)
    spec.option.timestep = scenario.step
    _bodies(spec, scenario, robot, origin, shapes)
    if not scenario.world.empty:
        _furnish(spec, scenario.world)
        _pair(spec, scenario)
    return spec


def link_body(name: str) -> str:
    """Name of the MuJoCo body of a link; the names of bodies of the world's objects have another prefix."""
    return f"link.{name}"


def _bodies(spec: Any, scenario: Scenario, robot: Robot, origin: Vector, shapes: bool) -> None:
    links = {link.name: link for link in robot.links}
    kinds = load().mjtJoint
    start = np.array(scenario.base_position) + rotation_matrix(scenario.base_rpy) @ origin
    root = spec.worldbody.add_body(name=link_body(robot.root.name), pos=start.tolist(), quat=quaternion_wxyz(scenario.base_rpy))
    if not scenario.fixed_base:
        root.add_freejoint()
    waiting = [(root, robot.root.name)]
    while waiting:
        body, name = waiting.pop()
        body.mass, body.inertia, body.ipos, body.explicitinertial = 1.0, [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], True
        for index, shape in enumerate(links[name].collisions if shapes else ()):
            geom = add_shape(spec, body, f"link.{name}.{index}", shape)
            geom.contype, geom.conaffinity = ROBOT_BIT, WORLD_BIT
        for joint in robot.carried.get(name, ()):
            child = body.add_body(name=link_body(joint.child), pos=list(joint.origin), quat=quaternion_wxyz(joint.rpy))
            kind = kinds.mjJNT_SLIDE if joint.kind == "prismatic" else kinds.mjJNT_HINGE
            child.add_joint(name=joint.name, type=kind, axis=list(joint.axis))
            waiting.append((child, joint.child))


def add_shape(spec: Any, body: Any, name: str, shape: Shape) -> Any:
    """Add a shape to a body as a geom, and return the geom."""
    form: dict[str, Any] = {"pos": list(shape.origin), "quat": quaternion_wxyz(shape.rpy)}
    if shape.kind == "mesh":
        spec.add_mesh(name=name, file=shape.mesh, scale=list(shape.scale))
        form["meshname"] = name
    else:
        # MuJoCo's sizes are radii and half lengths.
        halves = [0.5 * length for length in shape.size]
        form["size"] = halves if shape.kind == "box" else [shape.size[0], *halves[1:], 0.0, 0.0][:3]
    return body.add_geom(name=name, type=getattr(load().mjtGeom, f"mjGEOM_{shape.kind.upper()}"), **form)


def _furnish(spec: Any, world: World) -> None:
    for item in world.solids:
        name = f"object.{item.name}"
        body = spec.worldbody.add_body(name=name, pos=list(item.position), quat=quaternion_wxyz(item.rpy))
        if item.mass:
            body.add_freejoint(name=name)
        geom = add_shape(spec, body, name, item.solid)
        geom.mass, geom.contype, geom.conaffinity = item.mass, WORLD_BIT, ROBOT_BIT | WORLD_BIT
        if item.mass and item.inertia is not None:
            body.mass, body.ipos, body.explicitinertial = item.mass, [0.0, 0.0, 0.0], True
            body.inertia = list(item.inertia)


def couple(spec: Any, robot: Robot, impedance: Sequence[float], lag: float | None = None) -> None:
    """Couple joints, and close loops, by equality constraints with the given impedance. lag: time constant of these constraints
    in s, for a model that MuJoCo steps itself; None: MuJoCo's default."""
    kinds, objects, equalities = load().mjtEq, load().mjtObj, []
    for joint in robot.moving_joints:
        if joint.mimic:
            equality = spec.add_equality(
                type=kinds.mjEQ_JOINT, objtype=objects.mjOBJ_JOINT, name1=joint.name, name2=joint.mimic
            )
            equality.data[:5] = [joint.offset, joint.multiplier, 0.0, 0.0, 0.0]
            equalities.append(equality)
    for number, loop in enumerate(robot.loops):
        names = [f"loop.{number}.{end}" for end in (1, 2)]
        for name, link, point in zip(names, loop.links, loop.points, strict=True):
            spec.body(link_body(link)).add_site(name=name, pos=list(point), group=HIDDEN_GROUP)
        equality = spec.add_equality(type=kinds.mjEQ_CONNECT, objtype=objects.mjOBJ_SITE, name1=names[0], name2=names[1])
        equalities.append(equality)
    for equality in equalities:
        equality.solimp = list(impedance)
        if lag is not None:
            equality.solref = [lag, 1.0]


def _pair(spec: Any, scenario: Scenario) -> None:
    """Set the friction coefficient of each contact to the product of the coefficients of the two bodies, as in PyBullet.
    MuJoCo's default is the larger of the two coefficients."""
    frictions = {f"object.{item.name}": item.friction for item in scenario.world.solids}
    base = spec.worldbody.bodies[0].name if scenario.fixed_base else ""
    shapes = [(shape.name, body.name == base) for body in spec.bodies for shape in body.geoms if shape.name not in frictions]
    named = list(frictions)
    pairs = [(a, b) for index, a in enumerate(named) for b in named[index + 1 :]]
    # A fixed base may stand on the ground. Leave out this pair, so that it has no contact forces.
    pairs += [(shape, other) for shape, fixed in shapes for other in named if not (fixed and other == f"object.{GROUND}")]
    for a, b in pairs:
        mu = frictions.get(a, 1.0) * frictions.get(b, 1.0)
        pair = spec.add_pair(geomname1=a, geomname2=b, condim=3)
        pair.friction = [mu, mu, 0.0, 0.0, 0.0]
        pair.solimp = list(HARD)


def quaternion_wxyz(rpy: Vector) -> list[float]:
    """Quaternion (w, x, y, z), in MuJoCo's order, of roll, pitch, yaw about fixed axes in rad."""
    x, y, z, w = quaternion(rpy)
    return [w, x, y, z]
