"""Pictures of a running simulation, without a display."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from asrsim.render.camera import fit_camera, main_axis, viewpoint
from asrsim.render.draw import Image, Painter
from asrsim.render.scene import Part, Scene
from asrsim.render.shapes import drawable
from asrsim.render.solids import sphere
from asrsim.samples import Array
from asrsim.simulation.simulation import Simulation

LOOKS = 3
"""Positions of each joint at which the camera looks, at most for :data:`MOST` of all."""
MOST = 81
"""Poses of the robot that the camera looks at to find its place."""
_GOAL = "the goal of the task"
"""Body that stands for it; no link has a name with blanks."""
_BALL = 0.02
"""Radius of the ball that marks a goal, as a share of the robot's reach."""
_RED = (0.85, 0.15, 0.1)
"""Its colour: red, green, blue from 0 to 1."""


def goal_of(tip: Array | None, goals: Mapping[str, float]) -> Array | None:
    """(3,) m where a goal of x, y, z stands, beside the tip in what it does not name; None where it is no place of a tip."""
    if tip is None or not goals or not set(goals) <= {"x", "y", "z"}:
        return None
    return np.array([goals.get(axis, at) for axis, at in zip("xyz", tip[:3].tolist(), strict=True)])


class Picture:
    """Draws the simulation's robot and world from one place, from which all of the joints' ranges is seen."""

    def __init__(self, simulation: Simulation, size: int, goal: Array | None = None) -> None:
        """size: pixels of an edge; goal: (3,) m, a place that is drawn as a ball, here and in every picture."""
        self._simulation, self._size = simulation, size
        scenario, robot = simulation.prepared.scenario, simulation.prepared.robot
        self._scene = Scene(drawable(robot, scenario.package_paths).robot, scenario)
        self._painter = Painter(self._scene)
        joints = [drive.joint for drive in simulation.prepared.drives]
        ranges = {joint.name: np.linspace(max(joint.stops[0], -np.pi), min(joint.stops[1], np.pi), LOOKS) for joint in joints}
        reach = [
            self._scene.frames(dict(zip(ranges, pose, strict=True)), {})
            for pose, _ in zip(product(*ranges.values()), range(MOST), strict=False)
        ]
        cloud = np.concatenate([self._painter.outer_points(frames) for frames in (*reach, self._frames())])
        if goal is not None:
            ball = sphere(_BALL * float(np.linalg.norm(np.ptp(cloud, axis=0))))
            self._scene.parts.append(Part(body=_GOAL, mesh=ball, colours=np.tile(_RED, (len(ball.triangles), 1))))
            self._painter = Painter(self._scene)
            cloud = np.concatenate([cloud, ball.points + goal])
        axis = main_axis(self._scene.axes(self._frames()), {name: float(np.ptp(values)) for name, values in ranges.items()})
        self._camera = fit_camera(cloud, viewpoint(axis), aspect=1.0)

    def image(self, goal: Array | None = None) -> Image:
        """(size, size, 3) of the present state; goal: (3,) m, if there was one at the start."""
        frames = self._frames()
        if goal is not None:
            frames[_GOAL] = np.eye(4)
            frames[_GOAL][:3, 3] = goal
        return self._painter.image(frames, self._camera, self._size, self._size)

    def _frames(self) -> dict[str, Array]:
        positions = self._simulation.observe().link_position.tolist()
        poses = {name: np.array(pose) for name, pose in self._simulation.look().scene().bodies.items()}
        return self._scene.frames(dict(zip(self._simulation.joints, positions, strict=True)), poses)
