"""PyBullet's software renderer: a robot and its world in given poses, from a given camera. Nothing is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.engines.bullet import BulletEngine
from asrsim.robot.model import Robot
from asrsim.samples import Array
from asrsim.scenario.data import Vector, World

_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


class BulletView(BulletEngine):
    """A world to look at. `urdf` has a visual for every link that is to be seen."""

    def __init__(
        self, robot: Robot, urdf: str, *, base_position: Vector, base_rpy: Vector, world: World, initial: Mapping[str, float]
    ) -> None:
        super().__init__(
            robot, urdf, step=1e-3, gravity=(0.0, 0.0, 0.0), base_position=base_position, base_rpy=base_rpy, fixed_base=True,
            initial_positions=initial, world=replace(world, ground=False), visuals=True,
        )  # fmt: skip
        self._floor: float | None = world.ground_height if world.ground else None
        for item in world.objects:
            self._p.changeVisualShape(self._world.objects[item.name], -1, rgbaColor=item.colour, physicsClientId=self._client)

    def place(self, positions: Mapping[str, float], poses: Mapping[str, Sequence[float]]) -> None:
        """Joint positions (rad, m) and poses (x y z, quaternion x y z w) of the world's objects and of a floating base."""
        p, client = self._p, self._client
        for name, index in zip(self.joints, self._indices, strict=True):
            if name in positions:
                p.resetJointState(self._body, index, float(positions[name]), 0.0, physicsClientId=client)
        for name, pose in poses.items():
            if name in self._world.objects:
                item = self._world.objects[name]
                p.resetBasePositionAndOrientation(item, list(pose[:3]), list(pose[3:7]), physicsClientId=client)
            elif name == self.base:
                local = p.getDynamicsInfo(self._body, -1, client)[3:5]
                centre = p.multiplyTransforms(list(pose[:3]), list(pose[3:7]), *local)
                p.resetBasePositionAndOrientation(self._body, *centre, physicsClientId=client)

    def points(self) -> Array:
        """(k, 3) m: corners of boxes around everything that is seen, in the present pose."""
        p, client = self._p, self._client
        found: list[Array] = []
        for shape in p.getVisualShapeData(self._body, physicsClientId=client):
            index, kind, size, local = shape[1], shape[2], shape[3], shape[5:7]
            if index == -1:
                state = p.getBasePositionAndOrientation(self._body, client)
                inertial = p.getDynamicsInfo(self._body, -1, client)
                frame = p.multiplyTransforms(*state, *p.invertTransform(inertial[3], inertial[4]))
            else:
                frame = p.getLinkState(self._body, index, 0, 1, client)[4:6]
            half = _half_extents(p, kind, size)
            if half is None:
                # A mesh: the engine's box around its collision shape.
                low, high = p.getAABB(self._body, index, client)
                found += [np.array([low, high], dtype=float)]
            else:
                centre, turn = p.multiplyTransforms(*frame, *local)
                rotation = np.array(p.getMatrixFromQuaternion(turn), dtype=float).reshape(3, 3)
                found += [np.array(centre, dtype=float) + (_CORNERS * half) @ rotation.T]
        for body in self._world.objects.values():
            low, high = p.getAABB(body, -1, client)
            found += [np.array(list(product(*zip(low, high, strict=True))), dtype=float)]
        if not found:
            found = [np.array(p.getAABB(self._body, -1, client), dtype=float)]
        return np.concatenate(found)

    def axes(self) -> dict[str, Array]:
        """Joint -> (3,) its axis in the world, in the present pose."""
        p, client = self._p, self._client
        axes = {}
        for name, index in zip(self.joints, self._indices, strict=True):
            turn = np.array(p.getMatrixFromQuaternion(p.getLinkState(self._body, index, 0, 1, client)[5])).reshape(3, 3)
            axes[name] = turn @ np.array(p.getJointInfo(self._body, index, client)[13], dtype=float)
        return axes

    def lay_floor(self, centre: Sequence[float], half: float) -> None:
        """A floor of that half width (m) under the world, if the world has a ground."""
        if self._floor is None:
            return
        p, client = self._p, self._client
        tiles = 4
        edge = half / tiles
        for x in range(-tiles, tiles):
            for y in range(-tiles, tiles):
                shade = 0.99 if (x + y) % 2 else 0.94
                shape = p.createVisualShape(
                    p.GEOM_BOX, halfExtents=[edge / 2, edge / 2, 0.002], rgbaColor=[shade, shade, shade, 1],
                    physicsClientId=client,
                )  # fmt: skip
                place = [centre[0] + (x + 0.5) * edge, centre[1] + (y + 0.5) * edge, self._floor - 0.002]
                p.createMultiBody(0, -1, shape, basePosition=place, physicsClientId=client)

    def image(
        self, *, eye: Sequence[float], target: Sequence[float], up: Sequence[float], field: float, width: int, height: int
    ) -> NDArray[np.uint8]:
        """(height, width, 3) what a camera sees. eye, target: m; field: vertical angle of view in degrees."""
        p, client = self._p, self._client
        distance = float(np.linalg.norm(np.subtract(eye, target)))
        view = p.computeViewMatrix(list(eye), list(target), list(up))
        projection = p.computeProjectionMatrixFOV(field, width / height, 0.02 * distance, 20.0 * distance)
        light = np.subtract(eye, target) / distance + np.array([0.0, 0.0, 0.9])
        pixels: Any = p.getCameraImage(
            width, height, view, projection, lightDirection=light.tolist(), lightDistance=4.0 * distance, shadow=1,
            lightAmbientCoeff=0.62, lightDiffuseCoeff=0.38, lightSpecularCoeff=0.02, renderer=p.ER_TINY_RENDERER,
            physicsClientId=client,
        )  # fmt: skip
        return np.asarray(pixels[2], dtype=np.uint8).reshape(height, width, 4)[:, :, :3].copy()


def _half_extents(p: Any, kind: int, size: Sequence[float]) -> Array | None:
    """(3,) m, half edges of the box around a shape in its own frame; None for meshes."""
    if kind == p.GEOM_BOX:
        return 0.5 * np.array(size, dtype=float)
    if kind == p.GEOM_SPHERE:
        return np.full(3, float(size[0]))
    if kind in (p.GEOM_CYLINDER, p.GEOM_CAPSULE):
        ends = size[1] if kind == p.GEOM_CAPSULE else 0.0
        return np.array([size[1], size[1], 0.5 * size[0] + ends], dtype=float)
    return None
