"""PyBullet's physics clients, robots and shapes in these clients, and a robot's mass matrix and bias by PyBullet's routines.

Robots and shapes are made from asrsim's data, since PyBullet's readers of files may crash. PyBullet prints to the terminal.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import BuiltinFunctionType
from typing import Any
from weakref import finalize

import numpy as np

from asrsim.engines.foreign import quiet
from asrsim.errors import RobotError, SimulationError
from asrsim.robot.dynamics import BASE, with_base_joints
from asrsim.robot.inertia import principal_axes
from asrsim.robot.meshes import convex_hull
from asrsim.robot.model import ZERO, Link, Robot, Shape
from asrsim.robot.poses import quaternion, rotation_matrix
from asrsim.samples import Array
from asrsim.scenario.data import Scenario

SYMMETRIC = 2.0**-6
"""Largest moment of inertia, in Bullet's units. The rounding errors of such a tensor, about 1e-17, pass Bullet's test of
symmetry."""


class Client:
    """PyBullet's functions on a separate physics client (28 MB of memory), and PyBullet's constants. Only this class imports
    PyBullet.

    `close` ends the client; the client ends at the latest when this object is garbage-collected.
    """

    def __init__(self) -> None:
        with quiet():
            import pybullet

            self._module: Any = pybullet
            self._number = pybullet.connect(pybullet.DIRECT)
        self.close = finalize(self, _disconnect, pybullet, self._number)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        if isinstance(value, BuiltinFunctionType):
            value = partial(value, physicsClientId=self._number)
        setattr(self, name, value)
        return value


def _disconnect(p: Any, number: int) -> None:
    with suppress(p.error):
        p.disconnect(number)


def make_body(
    p: Client,
    robot: Robot,
    *,
    unit: float = 1.0,
    lift: float = 0.0,
    mass: float = 0.0,
    shapes: Mapping[str, int] | None = None,
    **pose: Any,
) -> int:
    """Bullet's number of a new body that has the links of a robot without fixed joints. Bullet's number of a link is the index
    of its joint in `robot.outward_joints`; the base has the number -1.

    unit: mass in kg that Bullet takes as 1. lift: increase of the principal moments of inertia, kg m^2. mass: mass of the base
    in kg; 0 for a fixed base. shapes: Bullet's number of the shape of each link that has a shape. pose: arguments
    `basePosition` and `baseOrientation`.
    """
    joints, links = robot.outward_joints, {link.name: link for link in robot.links}
    carried = [links[joint.child] for joint in joints]
    numbers = {robot.root.name: 0} | {joint.child: k for k, joint in enumerate(joints, 1)}
    number_of = shapes or {}
    # Bullet's routines for mass matrix and bias use the axes of the base's inertia even if the base is fixed. Therefore leave
    # this inertia out.
    root = robot.root if mass else Link(name=robot.root.name, mass=None, inertia=None)
    moments, (turned, *axes) = zip(*map(principal_axes, (root, *carried)), strict=True)
    body: int = p.createMultiBody(
        baseMass=mass,
        baseCollisionShapeIndex=number_of.get(root.name, -1),
        baseInertialFramePosition=root.centre_of_mass,
        baseInertialFrameOrientation=quaternion(turned),
        linkMasses=[(link.mass or 0.0) / unit for link in carried],
        linkCollisionShapeIndices=[number_of.get(link.name, -1) for link in carried],
        linkVisualShapeIndices=[-1] * len(joints),
        linkPositions=[joint.origin for joint in joints],
        linkOrientations=[quaternion(joint.rpy) for joint in joints],
        linkInertialFramePositions=[link.centre_of_mass for link in carried],
        linkInertialFrameOrientations=[quaternion(rpy) for rpy in axes],
        linkParentIndices=[numbers[joint.parent] for joint in joints],
        linkJointTypes=[p.JOINT_PRISMATIC if joint.kind == "prismatic" else p.JOINT_REVOLUTE for joint in joints],
        linkJointAxis=[joint.axis for joint in joints],
        flags=p.URDF_MAINTAIN_LINK_ORDER,
        **pose,
    )
    # Replace the moments of inertia that Bullet has computed from the shapes.
    for number, principal in enumerate(moments, -1):
        p.changeDynamics(body, number, localInertiaDiagonal=[(moment + lift) / unit for moment in principal])
    return body


def make_shape(p: Client, what: str, shapes: Sequence[Shape]) -> int:
    """Bullet's number of a new shape that consists of the given shapes. Each mesh becomes its convex hull.

    what: name of the body, for the error message. Raises SimulationError.
    """
    sizes = [(*shape.size, 0.0, 0.0, 0.0) for shape in shapes]
    frames: dict[str, Any] = {}
    if any((*shape.origin, *shape.rpy) != (0.0,) * 6 for shape in shapes):
        frames = {
            "collisionFramePositions": [shape.origin for shape in shapes],
            "collisionFrameOrientations": [quaternion(shape.rpy) for shape in shapes],
        }
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        files = [str(Path(folder) / f"{number}.stl") for number in range(len(shapes))]
        for shape, file in zip(shapes, files, strict=True):
            if shape.kind == "mesh":
                convex_hull(Path(shape.mesh), shape.scale).export(file)
        try:
            return int(
                p.createCollisionShapeArray(
                    shapeTypes=[getattr(p, f"GEOM_{shape.kind.upper()}") for shape in shapes],
                    halfExtents=[[0.5 * edge for edge in size[:3]] for size in sizes],
                    radii=[size[0] for size in sizes],
                    lengths=[size[1] for size in sizes],
                    fileNames=files,
                    **frames,
                )
            )
        except p.error as error:
            raise SimulationError(f"{what}: PyBullet cannot make its shape ({error})") from error


def _lift(link: Link) -> float:
    """Increase of the principal moments of inertia that makes a link's inertia physically possible, kg m^2."""
    a, b, c = sorted(principal_axes(link)[0])
    return c - a - b + 1e-9 * c


def _weightless(link: Link) -> Link:
    """Link that replaces a link on which gravity does not act. It is a point mass with the mass of this link."""
    mass, centre = link.weightless
    return replace(link, mass=mass, centre_of_mass=centre, inertia=None, inertial_rpy=ZERO)


class BulletDynamics:
    """Mass matrix and bias of a robot without fixed joints, computed by PyBullet. Raises RobotError for a robot that PyBullet
    cannot simulate.

    The velocity (v,) of a floating base consists of the linear velocity along the axes of the world and the angular velocity
    about the axes of the base. Bullet gets a floating base as a fixed base with six joints that stand at 0.
    """

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self._p = p = Client()
        self.close = p.close
        self.free = 0 if scenario.fixed_base else BASE
        self._robot = robot if scenario.fixed_base else with_base_joints(robot)
        ours = [joint.name for joint in self._robot.moving_joints]
        self._to_bullet = [ours.index(joint.name) for joint in self._robot.outward_joints]
        """Index in asrsim's order of each joint in Bullet's order. Bullet needs parents before children; files may have another
        order."""
        order = np.argsort(self._to_bullet)
        self._same = self._to_bullet == sorted(self._to_bullet)
        # Use `...` as the index if the order is the same, since it is faster than a list of indices.
        self._from_bullet: Any = ... if self._same else order
        self._block: Any = ... if self._same else np.ix_(order, order)
        self._still = [0.0] * len(ours)
        self._gravity = np.array(scenario.gravity)
        self._set_gravity(rotation_matrix(scenario.base_rpy))
        largest = max(max(principal_axes(link)[0]) for link in self._robot.links)
        self._unit = 2.0 ** max(math.ceil(math.log2(largest / SYMMETRIC)), 0) if largest > 0.0 else 1.0
        """Mass in kg that Bullet takes as 1. Bullet rejects a tensor whose rounding errors exceed 1.1e-15, so the tensors of
        heavy links must become small numbers. The results are bitwise the same, since this unit is a power of two."""
        self._body = make_body(p, self._robot, unit=self._unit)
        self._parts: list[tuple[float, int]] = []
        """Factors and Bullet's numbers of further bodies, whose mass matrices and biases are added to the mass matrix and bias
        of `_body`."""
        if ours:
            self._set_up()
        floats = tuple(_weightless(link) for link in self._robot.links)
        self._floats = (
            make_body(p, replace(self._robot, links=floats), unit=self._unit) if any(one.mass for one in floats) else None
        )
        """Bullet's number of a body made of the masses on which gravity does not act; None if there are no such masses."""

    def _set_up(self) -> None:
        """Call Bullet's dynamics for the first time, since this call prints warnings about axes that are inexact by rounding.

        Bullet rejects physically impossible inertias, which some published robots have. Mass matrix and bias f are linear in
        the inertias, so their values for an impossible inertia I follow from two possible inertias as 2 f(I + s) - f(I + 2 s).
        """
        with quiet():
            try:
                self.matrix(self._still, None)
                return
            except SystemError:
                needs = {link: _lift(link) for link in self._robot.links}
                worst = max(needs, key=needs.__getitem__)
                make = partial(make_body, self._p, self._robot, unit=self._unit)
                self._body = make(lift=needs[worst])
                self._parts = [(1.0, self._body), (-1.0, make(lift=2.0 * needs[worst]))]
            try:
                self.matrix(self._still, None)
            except SystemError as error:
                message = "PyBullet cannot compute the dynamics of this link: its inertia is physically impossible"
                raise RobotError(
                    message,
                    file=self._robot.path,
                    line=worst.line,
                    key=worst.name,
                    hint="Correct the inertia, or use engine: mujoco, which does not test inertias",
                    code="engine-load",
                ) from error

    def ordered(self, values: Array) -> list[float]:
        """Values (v,) in Bullet's order. For values (n,) of the joints only, the values of the base are 0."""
        plain = [0.0] * (len(self._to_bullet) - len(values)) + values.tolist()
        return plain if self._same else [plain[j] for j in self._to_bullet]

    def _set_gravity(self, rotation: Array) -> None:
        """Rotate gravity instead of the base. rotation: rotation matrix (3, 3) of the base."""
        self._p.setGravity(*(self._gravity @ rotation).tolist())

    def _sum(self, routine: Any, *arguments: Sequence[float]) -> Array:
        """Sum of the results of one of Bullet's routines for the robot's body and for the further bodies of `_set_up`."""
        total = np.array(routine(self._body, *arguments))
        for part, body in self._parts:
            total += part * np.array(routine(body, *arguments))
        if self._unit != 1.0:
            total *= self._unit
        return total

    def matrix(self, positions: Sequence[float], rotation: Array | None) -> Array:
        """Mass matrix (v, v). positions: see `ordered`. rotation: rotation matrix (3, 3) of a floating base, None for a fixed
        base."""
        full = np.asarray(self._sum(self._p.calculateMassMatrix, positions)[self._block])
        if rotation is not None:
            full[:3] = rotation @ full[:3]
            full[:, :3] = full[:, :3] @ rotation.T
        return full

    def bias(self, positions: Sequence[float], velocity: Array, rotation: Array | None) -> Array:
        """Gravity, Coriolis and centrifugal forces (v,) in N m. velocity: velocities (v,)."""
        accelerations = self._still
        if rotation is not None:
            self._set_gravity(rotation)
            x, y, z = velocity[3:6].tolist()
            # Bullet's base turns about three axes one after the other. These accelerations keep its angular velocity constant.
            turning = np.array([0.0, 0.0, 0.0, -y * z, x * z, -x * y, *self._still[BASE:]])
            accelerations = self.ordered(turning)
            velocity = np.concatenate([velocity[:3] @ rotation, velocity[3:]])
        states = positions, self.ordered(velocity), accelerations
        bias = np.asarray(self._sum(self._p.calculateInverseDynamics, *states)[self._from_bullet])
        if rotation is not None:
            bias[:3] = rotation @ bias[:3]
        return bias if self._floats is None else bias - self.lift(positions, rotation)

    def lift(self, positions: Sequence[float], rotation: Array | None) -> Array:
        """Forces (v,) in N m that carry the masses on which gravity does not act, for a robot at rest."""
        if self._floats is None:
            return np.zeros(len(self._still))
        if rotation is not None:
            self._set_gravity(rotation)
        states = positions, self._still, self._still
        lift: Array = self._unit * np.array(self._p.calculateInverseDynamics(self._floats, *states))[self._from_bullet]
        if rotation is not None:
            lift[:3] = rotation @ lift[:3]
        return lift
