"""Kinematics and dynamics of a robot without its world, in NumPy, at one posture or at many postures at once.

The equations follow Legnani et al. (1996), Mechanism and Machine Theory 31(5), with matrices (4, 4):

    pose T      homogeneous matrix: rotation, and position of the origin
    twist V     velocity of a body along its own axes: T' = T V
    inertia J   pseudo-inertia of a body: the integral of x x^T over its mass, where x = (position, 1)
    load        (V' + V V) J: the integral of acceleration times x^T

The torque that a body requires from a joint is the sum of the elementwise products of its load and the twist that the joint
causes at unit velocity.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from asrsim.robot.chain_masses import Chain, work_space
from asrsim.robot.inertia import inertia_tensor
from asrsim.robot.merge import merge_fixed
from asrsim.robot.model import ZERO, Joint, Link, Robot, Vector
from asrsim.robot.poses import cross_matrix, frame, rotation_matrix

Array = NDArray[np.float64]
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BASE = 6
"""Degrees of freedom of a floating base."""


class Surroundings(Protocol):
    """Base and gravity of a robot; a `Scenario` provides them."""

    @property
    def base_position(self) -> Vector:
        """Position of the robot's root in the world, m."""

    @property
    def base_rpy(self) -> Vector:
        """Orientation of the robot's root, rad."""

    @property
    def fixed_base(self) -> bool:
        """Whether the root is fixed."""

    @property
    def gravity(self) -> Vector:
        """Gravity in the world's frame, m/s^2."""


def robot_model(surroundings: Surroundings, robot: Robot) -> RobotModel:
    """Rigid-body model of the robot with the base and gravity of a scenario, without the objects of the world."""
    return RobotModel(
        robot,
        base_position=surroundings.base_position,
        base_rpy=surroundings.base_rpy,
        gravity=surroundings.gravity,
        floating=not surroundings.fixed_base,
    )


class RobotModel:
    """Rigid-body model of a robot on its base. Arrays of joints (..., n) are in the order of `joints`; leading axes count
    postures.

    Coupled joints follow their masters; entries of the arrays for coupled joints are ignored. Torques, Jacobians and mass
    matrices refer to the masters. Entries of coupled joints are 0; in the mass matrix, their rows are rows of the identity
    matrix.
    """

    of_file: ClassVar[bool] = True
    """Whether masses and forces come from the robot's file; if not, they come from an engine."""

    def __init__(
        self,
        robot: Robot,
        *,
        base_position: Vector = ZERO,
        base_rpy: Vector = ZERO,
        gravity: Vector = ZERO,
        floating: bool = False,
    ) -> None:
        """floating: whether the base is free to accelerate, which affects the mass matrix only."""
        merged, moving = merge_fixed(robot), robot.moving_joints
        self.joints = tuple(joint.name for joint in moving)
        self.links = tuple(link.name for link in robot.links)
        self.lower, self.upper = np.array([joint.stops for joint in moving]).reshape(-1, 2).T
        """Lower and upper stops (n,), rad or m; infinite for joints without stops."""
        self._gravity = np.array(gravity)
        self._base = frame(base_position, rotation_matrix(base_rpy))
        self._free = BASE if floating else 0
        chain = with_base_joints(merged.robot) if floating else merged.robot
        joints = chain.outward_joints
        # Joint k moves body k + 1. Body 0 does not move.
        self._numbers = bodies = {chain.root.name: 0} | {joint.child: k for k, joint in enumerate(joints, 1)}
        """Number of each body, by name of its link in the merged robot."""
        self._parents = [bodies[joint.parent] for joint in joints]
        self._at = np.array([bodies[joint.child] - 1 for joint in moving], dtype=np.int64)
        """Indices (n,) of the robot's joints among all joints."""
        self._carries = np.eye(len(joints))
        """Whether joint j carries body k + 1, (joints, joints): 1 or 0."""
        for k, parent in enumerate(self._parents):
            if parent:
                self._carries[:, k] += self._carries[:, parent - 1]
        self._slides = np.array([joint.kind == "prismatic" for joint in joints])
        self._twists = np.array([_unit_twist(joint) for joint in joints]).reshape(-1, 4, 4)
        origins = [frame(joint.origin, rotation_matrix(joint.rpy)) for joint in joints]
        self._origins = np.array(origins).reshape(-1, 4, 4)
        self.couplings = robot.couplings
        self._places = {
            name: (bodies[place.body], frame(place.pose.position, place.pose.rotation)) for name, place in merged.places.items()
        }
        self._set_inertias(robot)

    def varied(self, robot: Robot) -> RobotModel:
        """Model of a robot whose links have other inertias, but the same joints and frames."""
        other = copy(self)
        other._set_inertias(robot)
        return other

    def _set_inertias(self, robot: Robot) -> None:
        """Take the robot and its inertias."""
        self.robot = robot
        self._inertias, self._floats = np.zeros((2, len(self._parents) + 1, 4, 4))
        """_inertias: pseudo-inertias of the bodies; _floats: pseudo-inertias of the masses on which gravity does not act, of
        which only mass and first moments are used."""
        for link in merge_fixed(robot).robot.links:
            (mass, centre), body = link.weightless, self._numbers[link.name]
            self._inertias[body] = _pseudo_inertia(link)
            self._floats[body] = mass * np.outer([*centre, 1.0], [*centre, 1.0])
        self._armature = np.zeros(len(self._parents))
        self._armature[self._at] = [joint.armature for joint in robot.moving_joints]

    def poses(self, positions: ArrayLike, base: Array | None = None) -> dict[str, Array]:
        """Pose (..., 4, 4) of each link in the world. base: pose (..., 4, 4) of the root link; None: the initial pose."""
        bodies = self._bodies(positions, base)
        return {name: bodies[body] @ place for name, (body, place) in self._places.items()}

    def pose(self, positions: ArrayLike, link: str, point: Vector, base: Array | None = None) -> tuple[Array, Array]:
        """Position (..., 3) in m of a point (m, in the frame of `link`) and rotation (..., 3, 3) of the link, in the world."""
        body, place = self._places[link]
        pose = self._bodies(positions, base)[body] @ place
        return (pose @ (*point, 1.0))[..., :3], pose[..., :3, :3]

    def jacobian(self, positions: ArrayLike, link: str, point: Vector, base: Array | None = None) -> Array:
        """Jacobian (..., 6, n): velocity of the point and angular velocity of the link per joint velocity, world frame."""
        bodies = self._bodies(positions, base)
        body, place = self._places[link]
        at = bodies[body] @ place @ (*point, 1.0)
        jacobian = np.zeros((*at.shape[:-1], 6, len(self._parents)))
        while body:
            # Express the twist along the axes of the world, for the point of the body that is at the origin of the world.
            twist = bodies[body] @ self._twists[body - 1] @ np.linalg.inv(bodies[body])
            jacobian[..., :3, body - 1] = (twist @ at[..., None])[..., :3, 0]
            jacobian[..., 3:, body - 1] = twist[..., (2, 0, 1), (1, 2, 0)]
            body = self._parents[body - 1]
        return self.couplings.fold(jacobian[..., self._at], self.couplings.expand(positions))

    def mass_matrix(self, positions: ArrayLike) -> Array:
        """Mass matrix (..., n, n) in kg m^2 (kg). For a floating robot, the base is free to accelerate."""
        at, free = self._at, slice(self._free)
        matrix = self._all_masses(np.stack(self._bodies(positions)[1:], axis=-3))
        own, base, cross = matrix[..., at[:, None], at], matrix[..., free, free], matrix[..., free, at]
        if self._free:
            own = own - np.swapaxes(cross, -1, -2) @ np.linalg.solve(base, cross)
        return self.couplings.fold_matrix(own, self.couplings.expand(positions))

    def chain(self) -> Chain | None:
        """The robot for `asrsim.robot.chain_masses.find_masses`; None if its base floats or if it has coupled joints."""
        if self._free or self.couplings:
            return None
        return Chain(
            parents=np.array(self._parents, dtype=np.int64),
            places=self._at,
            slides=self._slides,
            origins=self._origins,
            twists=self._twists,
            squares=self._twists @ self._twists,
            inertias=self._inertias[1:].copy(),
            armature=self._armature,
            **work_space(len(self._parents), self._base),
        )

    def inverse_dynamics(self, positions: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike) -> Array:
        """Joint torques (..., n) in N m that give the accelerations, on a fixed base."""
        q = self.couplings.expand(positions)
        v = self.couplings.expand_rates(velocities, q)
        a = self.couplings.expand_accelerations(accelerations, v, q)
        torques = self._torques(self._with_base(q), self._with_base(v), self._with_base(a), self._gravity)
        return self.couplings.fold(torques[..., self._at], q)

    def gravity_torques(self, positions: ArrayLike) -> Array:
        """Joint torques (..., n) in N m that hold the robot at rest against gravity. This is G(q) of the paper's equation 1."""
        q = self.couplings.expand(positions)
        steps = self._steps(self._with_base(q))
        backs = np.linalg.inv(steps)
        # Use the equations of `_torques`, without the terms of velocity and acceleration.
        rises = self._rises(steps, backs, self._gravity)
        loads = [rise @ (inertia - mass) for rise, inertia, mass in zip(rises, self._inertias, self._floats, strict=True)]
        return self.couplings.fold(self._gathered(steps, loads)[..., self._at], q)

    def gravity_stiffness(self, positions: Array) -> tuple[Array, Array]:
        """`gravity_torques` (..., n), and their change per displacement of each joint (..., n, n), N m/rad. This change is the
        second derivative of the potential energy. For robots without coupled joints.
        """
        bodies = np.stack(self._bodies(positions)[1:], axis=-3)
        twists = bodies @ self._twists @ np.linalg.inv(bodies)
        # A joint turns the first moment of mass of all bodies that it carries. The joints that carry it turn its axis.
        moments = bodies @ (self._inertias - self._floats)[1:, :, 3, None]
        pushes = twists @ (self._carries @ moments[..., 0])[..., None]
        down = np.append(self._gravity, 0.0)
        torques, above = -(pushes[..., 0] @ down), down @ twists
        found = -(above @ np.swapaxes(pushes[..., 0], -1, -2)) * self._carries
        whole = found + np.swapaxes(np.triu(found, 1), -1, -2)
        return torques[..., self._at], whole[..., self._at[:, None], self._at]

    def energy(self, positions: ArrayLike, velocities: ArrayLike) -> Array:
        """Kinetic and gravitational energy (...,) of the links in J, on a fixed base."""
        kinetic, potential = self.energies(positions, velocities)
        return np.asarray(kinetic + potential)

    def energies(self, positions: ArrayLike, velocities: ArrayLike) -> tuple[Array, Array]:
        """Kinetic energy (...,) and gravitational energy (...,) of the links in J, on a fixed base."""
        q = self.couplings.expand(positions)
        speeds = self._with_base(self.couplings.expand_rates(velocities, q))
        rates = np.moveaxis(speeds[..., None, None] * self._twists, -3, 0)
        steps = self._steps(self._with_base(q))
        # Pose of each body, and time derivative of the pose.
        poses, motions = [np.broadcast_to(self._base, steps.shape[1:])], [np.zeros(steps.shape[1:])]
        for parent, step, rate in zip(self._parents, steps, rates, strict=True):
            poses.append(poses[parent] @ step)
            motions.append(motions[parent] @ step + poses[-1] @ rate)
        moving, places = np.array(motions), np.array(poses)[..., :3, :]
        kinetic = 0.5 * np.einsum("b...ij,bjk,b...ik->...", moving, self._inertias, moving)
        kinetic = kinetic + 0.5 * np.square(speeds) @ self._armature
        potential = -np.einsum("b...ij,bj,i->...", places, (self._inertias - self._floats)[..., 3], self._gravity)
        return kinetic, potential

    def _all(self, values: ArrayLike) -> Array:
        """Positions (..., joints) of all joints, from positions (..., n) of the robot's joints; 0 for the base."""
        return self._with_base(self.couplings.expand(values))

    def _with_base(self, own: Array) -> Array:
        everything = np.zeros((*own.shape[:-1], len(self._parents)))
        everything[..., self._at] = own
        return everything

    def _steps(self, positions: Array) -> Array:
        """Pose of each body in the frame of the body that carries it, (joints, ..., 4, 4), by Rodrigues' formula."""
        first = np.where(self._slides, positions, np.sin(positions))[..., None, None] * self._twists
        # For a prismatic joint the second-order term is 0, since the square of its twist is 0.
        second = (1.0 - np.cos(positions))[..., None, None] * (self._twists @ self._twists)
        return np.moveaxis(self._origins @ (np.eye(4) + first + second), -3, 0)

    def _bodies(self, positions: ArrayLike, base: Array | None = None) -> list[Array]:
        """Poses (..., 4, 4) of the bodies in the world."""
        poses = [self._base if base is None else base]
        for parent, step in zip(self._parents, self._steps(self._all(positions)), strict=True):
            poses.append(poses[parent] @ step)
        return poses

    def _all_masses(self, bodies: Array) -> Array:
        """Mass matrix (..., joints, joints) of all joints, for poses (..., joints, 4, 4) of the bodies that they move. A joint
        moves all bodies that it carries as one composite body.
        """
        turned, flat = np.swapaxes(bodies, -1, -2), (*bodies.shape[:-2], 16)
        twists = bodies @ self._twists @ np.linalg.inv(bodies)
        carried = self._carries @ (bodies @ self._inertias[1:] @ turned).reshape(flat)
        pushes = (twists @ carried.reshape(bodies.shape)).reshape(flat)
        below: Array = pushes @ np.swapaxes(twists.reshape(flat), -1, -2) * self._carries.T
        return below + np.swapaxes(np.tril(below, -1), -1, -2) + np.diag(self._armature)

    def _torques(self, positions: Array, velocities: Array, accelerations: Array, gravity: Array) -> Array:
        """Torques (..., joints) of all joints. An upward acceleration of the base replaces gravity."""
        steps = self._steps(positions)
        backs = np.linalg.inv(steps)
        rates, boosts = (np.moveaxis(values[..., None, None] * self._twists, -3, 0) for values in (velocities, accelerations))
        twists, changes = [np.zeros((4, 4))], [self._lift(gravity)]
        for parent, step, back, rate, boost in zip(self._parents, steps, backs, rates, boosts, strict=True):
            twist = back @ twists[parent] @ step + rate
            twists.append(twist)
            changes.append(back @ changes[parent] @ step + boost + twist @ rate - rate @ twist)
        bodies = zip(twists, changes, self._inertias, strict=True)
        loads = [(change + twist @ twist) @ inertia for twist, change, inertia in bodies]
        if self._floats.any():
            rises = self._rises(steps, backs, gravity)
            loads = [load - rise @ mass for load, rise, mass in zip(loads, rises, self._floats, strict=True)]
        torques = self._gathered(steps, loads)
        return torques + self._armature * accelerations if self._armature.any() else torques

    def _lift(self, gravity: Array) -> Array:
        """Upward acceleration (4, 4) of the base that has the same effect as gravity."""
        lift: Array = frame(-gravity @ self._base[:3, :3], np.eye(3)) - np.eye(4)
        return lift

    def _rises(self, steps: Array, backs: NDArray[Any], gravity: Array) -> list[Array]:
        """The upward acceleration of the base that replaces gravity, along the axes of each body."""
        rises = [self._lift(gravity)]
        for parent, step, back in zip(self._parents, steps, backs, strict=True):
            rises.append(back @ rises[parent] @ step)
        return rises

    def _gathered(self, steps: Array, loads: list[Array]) -> Array:
        """Torques (..., joints) that produce the loads of the bodies."""
        torques = np.zeros((*np.broadcast_shapes(steps.shape[1:], *(load.shape for load in loads))[:-2], len(steps)))
        for k in range(len(steps) - 1, -1, -1):
            torques[..., k] = np.sum(self._twists[k] * loads[k + 1], axis=(-2, -1))
            loads[self._parents[k]] = loads[self._parents[k]] + steps[k] @ loads[k + 1] @ np.swapaxes(steps[k], -1, -2)
        return torques


def with_base_joints(robot: Robot) -> Robot:
    """Robot on a fixed base, with six joints instead of the floating base of `robot`: the root link moves along the axes
    of its frame, then turns about them.
    """
    # XML does not allow the null character, so no link of a file has these names.
    names = [f"\0base {k}" for k in range(BASE)]
    joints = (
        Joint(name=names[k], kind="revolute" if k > 2 else "prismatic", parent=names[k], child=child, axis=AXES[k % 3])
        for k, child in enumerate((*names[1:], robot.root.name))
    )
    links = (Link(name=name, mass=None, inertia=None) for name in names)
    return replace(robot, links=(*links, *robot.links), joints=(*joints, *robot.joints))


def _unit_twist(joint: Joint) -> Array:
    """Twist (4, 4) of the body that the joint moves at unit velocity."""
    twist = np.zeros((4, 4))
    if joint.kind == "prismatic":
        twist[:3, 3] = joint.axis
    else:
        twist[:3, :3] = cross_matrix(joint.axis)
    return twist


def _pseudo_inertia(link: Link) -> Array:
    """Pseudo-inertia (4, 4) of a link about the origin of its frame: kg m^2, kg m and kg."""
    mass, tensor = link.mass or 0.0, inertia_tensor(link)
    centre = np.array([*link.centre_of_mass, 1.0])
    inertia: Array = mass * np.outer(centre, centre)
    inertia[:3, :3] += 0.5 * np.trace(tensor) * np.eye(3) - tensor
    return inertia
