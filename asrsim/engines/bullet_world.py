"""The world around PyBullet's robot: ground and objects, their poses and contact forces.

The functions receive the `pybullet` module as `p`; `asrsim.engines.bullet_loading` imports it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from asrsim.engines.contact_forces import GROUND, ROBOT, contact_forces
from asrsim.errors import SimulationError
from asrsim.samples import Array
from asrsim.scenario.data import World, WorldObject

GROUND_SIZE = 100.0
"""Edge length in m of the box that serves as the ground. With a plane, Bullet's contact forces would jump."""
PARTS = (9, 7), (10, 11), (12, 13)
"""Indices into Bullet's contact points: (force in N, direction) of the normal force and of both friction forces."""


class BulletWorld:
    """Ground and objects around the robot, which is `body` of a physics client. fixed: whether the robot's base is fixed."""

    def __init__(self, p: Any, client: int, body: int, world: World, *, fixed: bool) -> None:
        self._p, self._client, self._body = p, client, body
        self.objects: dict[str, int] = {}
        """Bullet's body number of each object, by name of the object."""
        self._moving = [item.name for item in world.objects if item.mass]
        self._ground = self._lay_ground(world, fixed) if world.ground else None
        for item in world.objects:
            self.objects[item.name] = self._add_object(item)

    def _lay_ground(self, world: World, fixed: bool) -> int:
        p, client = self._p, self._client
        half = GROUND_SIZE / 2
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[half, half, half], physicsClientId=client)
        ground = int(p.createMultiBody(0, shape, basePosition=[0, 0, world.ground_height - half], physicsClientId=client))
        p.changeDynamics(ground, -1, lateralFriction=world.ground_friction, restitution=0.0, physicsClientId=client)
        if fixed:
            # A fixed base that stands on the ground must not have contact forces.
            p.setCollisionFilterPair(ground, self._body, -1, -1, 0, physicsClientId=client)
        return ground

    def _add_object(self, item: WorldObject) -> int:
        p, client = self._p, self._client
        if item.shape == "box":
            arguments: dict[str, Any] = {"shapeType": p.GEOM_BOX, "halfExtents": [edge / 2 for edge in item.size]}
        elif item.shape == "sphere":
            arguments = {"shapeType": p.GEOM_SPHERE, "radius": item.size[0]}
        elif item.shape == "cylinder":
            arguments = {"shapeType": p.GEOM_CYLINDER, "radius": item.size[0], "height": item.size[1]}
        else:
            arguments = {"shapeType": p.GEOM_MESH, "fileName": str(item.mesh), "meshScale": list(item.size or (1, 1, 1))}
        try:
            shape = p.createCollisionShape(**arguments, physicsClientId=client)
        except p.error as error:
            raise SimulationError(f"object '{item.name}': PyBullet cannot make its shape ({error})") from error
        body = int(
            p.createMultiBody(
                item.mass, shape, basePosition=item.position, baseOrientation=p.getQuaternionFromEuler(item.rpy),
                physicsClientId=client,
            )
        )  # fmt: skip
        p.changeDynamics(
            body, -1, lateralFriction=item.friction, restitution=0.0, linearDamping=0, angularDamping=0,
            physicsClientId=client,
        )  # fmt: skip
        if item.inertia is not None:
            p.changeDynamics(body, -1, localInertiaDiagonal=item.inertia, physicsClientId=client)
        return body

    def poses(self) -> dict[str, tuple[float, ...]]:
        """Pose (x, y, z, qx, qy, qz, qw) of each object, by name; m, world frame."""
        poses = {}
        for name, body in self.objects.items():
            position, orientation = self._p.getBasePositionAndOrientation(body, self._client)
            poses[name] = (*position, *orientation)
        return poses

    def states(self) -> dict[str, Any]:
        """Poses of the objects' centres of mass, as Bullet stores them."""
        return {name: self._p.getBasePositionAndOrientation(body, self._client) for name, body in self.objects.items()}

    def set_states(self, states: dict[str, Any]) -> None:
        """Place the objects at the given poses, at rest."""
        for name, pose in states.items():
            self._p.resetBasePositionAndOrientation(self.objects[name], *pose, physicsClientId=self._client)
            self._p.resetBaseVelocity(self.objects[name], [0, 0, 0], [0, 0, 0], physicsClientId=self._client)

    def move(self, velocity: Array) -> None:
        """Give all movable objects the same linear velocity in m/s and no angular velocity."""
        for name in self._moving:
            self._p.resetBaseVelocity(self.objects[name], velocity.tolist(), [0, 0, 0], physicsClientId=self._client)

    def contacts(self) -> dict[str, tuple[float, float, float]]:
        """Contact forces in N; see `asrsim.engines.contact_forces.contact_forces`."""
        names = {body: name for name, body in self.objects.items()} | {self._body: ROBOT}
        if self._ground is not None:
            names[self._ground] = GROUND
        # All points are read in one call: when one pair of bodies is requested, Bullet reverses the normal forces but not the
        # friction.
        points = (
            (names[point[1]], names[point[2]], sum((point[i] * np.array(point[at]) for i, at in PARTS), np.zeros(3)))
            for point in self._p.getContactPoints(physicsClientId=self._client) or ()
        )
        return contact_forces([*self.objects], self._ground is not None, points)
