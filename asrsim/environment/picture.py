"""Pictures of a running simulation, without a display."""

from __future__ import annotations

import numpy as np

from asrsim.render.camera import fit_camera, main_axis, viewpoint
from asrsim.render.draw import Image, SceneDrawer
from asrsim.render.scene import RenderScene
from asrsim.render.shapes import drawable
from asrsim.samples import Array
from asrsim.simulation.worlds import Worlds

POSTURES = 40
"""Number of random postures of the robot that the camera's view must contain."""


class Picture:
    """Pictures of the robot and the objects of a world. The fixed viewpoint shows the whole ranges of the joints."""

    def __init__(self, worlds: Worlds, size: int) -> None:
        """size: edge of the pictures in pixels."""
        self._worlds, self._size = worlds, size
        scenario, robot = worlds.prepared.scenario, worlds.prepared.robot
        self._scene = RenderScene(drawable(robot, scenario.package_paths)[0], scenario)
        self._painter = SceneDrawer(self._scene)
        low, high = np.clip(np.transpose([drive.joint.stops for drive in worlds.prepared.drives]), -np.pi, np.pi)
        postures = [low, high, *np.random.default_rng(0).uniform(low, high, (POSTURES, len(low)))]
        frames = [*(self._scene.frames(dict(zip(worlds.joints, row, strict=True)), {}) for row in postures), self._frames()]
        cloud = np.concatenate([self._painter.outer_points(one) for one in frames])
        axis = main_axis(self._scene.axes(frames[-1]), dict(zip(worlds.joints, high - low, strict=True)))
        self._camera = fit_camera(cloud, viewpoint(axis), aspect=1.0)

    def image(self, world: int = 0) -> Image:
        """Picture (size, size, 3) of the present state of a world."""
        return self._painter.image(self._frames(world), self._camera, self._size, self._size)

    def _frames(self, world: int = 0) -> dict[str, Array]:
        positions = self._worlds.observe().link_position[world].tolist()
        poses = {name: np.array(pose) for name, pose in self._worlds.look(world).scene().bodies.items()}
        return self._scene.frames(dict(zip(self._worlds.joints, positions, strict=True)), poses)
