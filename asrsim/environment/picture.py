"""Pictures of a running simulation, without a display."""

from __future__ import annotations

from itertools import product

import numpy as np

from asrsim.render.camera import fit_camera, main_axis, viewpoint
from asrsim.render.draw import Image, Painter
from asrsim.render.scene import RenderScene
from asrsim.render.shapes import drawable
from asrsim.samples import Array
from asrsim.simulation.worlds import Worlds

LOOKS = 3
"""Number of positions of each joint that must be in the camera's view."""
MOST = 81
"""Largest number of robot poses that must be in the camera's view."""


class Picture:
    """Pictures of the robot and the objects of a single world from a fixed viewpoint that shows the joints' whole ranges."""

    def __init__(self, worlds: Worlds, size: int) -> None:
        """size: edge of the pictures in pixels."""
        self._worlds, self._size = worlds, size
        scenario, robot = worlds.prepared.scenario, worlds.prepared.robot
        self._scene = RenderScene(drawable(robot, scenario.package_paths)[0], scenario)
        self._painter = Painter(self._scene)
        joints = [drive.joint for drive in worlds.prepared.drives]
        ranges = {joint.name: np.linspace(max(joint.stops[0], -np.pi), min(joint.stops[1], np.pi), LOOKS) for joint in joints}
        poses = [dict(zip(ranges, pose, strict=True)) for pose, _ in zip(product(*ranges.values()), range(MOST), strict=False)]
        frames = [*(self._scene.frames(pose, {}) for pose in poses), self._frames()]
        cloud = np.concatenate([self._painter.outer_points(one) for one in frames])
        axis = main_axis(self._scene.axes(frames[-1]), {name: float(np.ptp(values)) for name, values in ranges.items()})
        self._camera = fit_camera(cloud, viewpoint(axis), aspect=1.0)

    def image(self) -> Image:
        """Picture (size, size, 3) of the present state."""
        return self._painter.image(self._frames(), self._camera, self._size, self._size)

    def _frames(self) -> dict[str, Array]:
        positions = self._worlds.observe().link_position[0].tolist()
        poses = {name: np.array(pose) for name, pose in self._worlds.look(0).scene().bodies.items()}
        return self._scene.frames(dict(zip(self._worlds.joints, positions, strict=True)), poses)
