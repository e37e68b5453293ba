"""The 3-D scene of a page: the robot in its world, ghosts, arrows for forces and torques, and the trace of the tip."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.render.camera import fit_camera, main_axis, viewpoint
from asrsim.render.scene import RenderScene
from asrsim.samples import TIP, Array, Samples
from asrsim.viewer.colours import ColourScale
from asrsim.viewer.figure import Figure, Rgb, frames_of
from asrsim.viewer.history import values_of
from asrsim.viewer.subject import Companion, Subject

if TYPE_CHECKING:
    import viser

EQUILIBRIUM: Rgb = (0, 114, 178)
"""Colour of the ghost at the equilibrium. The equilibrium has the same colour in the plots."""
GHOSTS: tuple[Rgb, ...] = ((26, 26, 26), (0, 158, 115), (179, 89, 154), (230, 159, 0), (86, 180, 233))
"""Colours of the ghosts and of the curves of companions."""
ROOM = 1.9
"""Size of the camera's first view, as a multiple of the size of the robot's motion. It is larger than 1, since panels cover the
edges of the view."""
POSES = 12
"""Number of poses, evenly spread over a known motion, that the camera's first view contains."""
FAINT = 0.25
"""Opacity of a ghost."""
SEEN = 0.45
"""Opacity of the robot while its collision shapes are shown."""
APART = 0.02
"""Distance of all joints from their references, rad (m), up to which the ghost at the references is hidden, since the robot
would cover it.
"""
FORCE, TORQUE, PULL = (194, 24, 91), (86, 180, 233), (213, 94, 0)
"""FORCE: colour of contact forces; TORQUE: colour of external torques; PULL: colour of pulls."""
LONGEST = 0.5
"""Length of the longest arrow, as a fraction of the robot's size."""
TRACE = 5.0
"""Time for which the trace shows the path of the tip, s."""
TRACED = 300
"""Approximate largest number of points of a trace."""
LEAST = 1e-6
"""Smallest force (N) or torque (N m) that is drawn."""


@dataclass
class Look:
    """Parts of the scene that the user has chosen to see."""

    equilibrium: bool = True
    forces: bool = True
    trace: bool = False
    collisions: bool = False
    colour: str = ""
    """Quantity that the colours of the links show; empty: the links have their original colours."""


@dataclass(frozen=True)
class Pull:
    """Spring with which the user pulls a point of a body."""

    point: Array
    """Pulled point of the body in the world (3,), m."""
    target: Array
    """Other end of the spring, at the user's hand in the world (3,), m."""
    force: Array
    """Force on the body (3,), N, in the world frame."""


class ViewerStage:
    """3-D scene of one subject."""

    def __init__(self, server: viser.ViserServer, subject: Subject) -> None:
        self._server, self.subject, self.look = server, subject, Look()
        self.figure = Figure(server, subject.scene)
        self._equilibrium = Figure(server, subject.scene, colour=EQUILIBRIUM, opacity=FAINT, objects=False)
        self._equilibrium.visible = False
        self._collisions: Figure | None = None
        self.ghosts: dict[str, tuple[Companion, Figure]] = {}
        self._scale: ColourScale | None = None
        self._arrows: dict[str, Any] = {}
        self._label: Any = None
        self._lines: dict[str, Any] = {}
        self._largest: dict[str, float] = {}
        """Largest contact force and largest external torque drawn so far; an arrow of this size has the length `LONGEST`."""
        self.tip = subject.scene.tip()
        self.size = self._fit()
        if subject.path is not None:
            self._line("path", subject.path, (0, 158, 115))

    def _fit(self) -> float:
        """Place the camera and the ground; returns the size of the robot, m."""
        scene, server = self.subject.scene, self._server
        history = self.subject.history
        # If the motion is known, choose a view that contains the complete motion.
        poses = [one for time in np.linspace(*history.span, POSES) if (one := history.at(float(time))) is not None]
        placed = [frames_of(scene, pose) for pose in poses] or [scene.frames({}, {})]
        frames = placed[-1]
        clouds = [_cloud(scene, one) for one in placed]
        cloud, size = np.concatenate(clouds), float(np.linalg.norm(np.ptp(clouds[-1], axis=0)))
        middle = 0.5 * (cloud.min(axis=0) + cloud.max(axis=0))
        camera = fit_camera(middle + ROOM * (cloud - middle), viewpoint(main_axis(scene.axes(frames), {})), aspect=1.0)
        start = server.initial_camera
        start.position, start.look_at, start.up = camera.eye, camera.target, np.array([0.0, 0.0, 1.0])
        start.fov = math.radians(1.3 * camera.field)
        server.scene.set_up_direction("+z")
        cell = 10.0 ** math.floor(math.log10(max(size, 1e-6)) - 0.3)
        # Draw a grid even if there is no ground, since it shows scale and direction. It is then fainter and has no shadows.
        level, shadow, fine, coarse = scene.ground, 0.2, 200, 140
        if level is None:
            level, shadow, fine, coarse = float(cloud[:, 2].min()), 0.0, 232, 210
        server.scene.add_grid(
            "/ground",
            cell_size=cell,
            section_size=5 * cell,
            plane="xy",
            position=(0.0, 0.0, level),
            infinite_grid=True,
            fade_distance=15 * size,
            shadow_opacity=shadow,
            cell_color=(fine,) * 3,
            section_color=(coarse,) * 3,
        )
        return size

    # -- ghosts -----------------------------------------------------------------------------------------------------

    def add(self, companion: Companion) -> None:
        """Add the ghost of a companion; it replaces a ghost with the same label."""
        self.drop(companion.label)
        if companion.history is not None:
            colour = GHOSTS[len(self.ghosts) % len(GHOSTS)]
            figure = Figure(self._server, companion.scene or self.subject.scene, colour=colour, opacity=FAINT, objects=False)
            figure.visible = companion.shown
            self.ghosts[companion.label] = companion, figure

    def drop(self, label: str) -> None:
        """Remove the ghost with this label, if there is one."""
        if label in self.ghosts:
            self.ghosts.pop(label)[1].remove()

    # -- drawing ----------------------------------------------------------------------------------------------------

    def draw(self, samples: Samples, *, pull: Pull | None = None) -> None:
        """Show robot, ghosts, forces and the pull at the time of the last sample."""
        time, look = float(samples.time[-1]), self.look
        frames = self.figure.place(samples)
        error = values_of(samples, "position_error", self.subject.joints)
        away = np.zeros(1) if error is None else np.nan_to_num(error[-1])
        self._equilibrium.visible = look.equilibrium and bool(np.abs(away).max(initial=0.0) > APART)
        if self._equilibrium.visible:
            self._equilibrium.place(samples, samples.values["link_position"][-1] + away)
        if look.collisions and self._collisions is None:
            self._collisions = Figure(self._server, self.subject.scene.of_collisions(), opacity=0.8)
        if self._collisions is not None:
            self._collisions.visible = look.collisions
            self._collisions.place(samples)
        for companion, figure in self.ghosts.values():
            there = companion.history.at(time) if figure.visible and companion.history is not None else None
            if there is not None:
                figure.place(there)
        self._tint(samples)
        arrows = self._contacts(samples, frames), self._torques(samples, frames)
        for name, colour, drawn in zip(("contact", "torque"), (FORCE, TORQUE), arrows, strict=True):
            self._draw_forces(name, drawn if look.forces else [], colour)
        self._draw_pull(pull)

    def draw_trace(self, time: float) -> None:
        """Show the path of the tip in the `TRACE` seconds before a time in s."""
        points = self._trace(time) if self.look.trace else np.empty((0, 3))
        self._line("trace", points, PULL)

    def legend(self) -> str:
        """HTML of the colour scale; empty if the links have their original colours."""
        return self._scale.legend() if self._scale is not None else ""

    def _tint(self, samples: Samples) -> None:
        wanted = self.look.colour
        if (self._scale.quantity if self._scale else "") != wanted:
            self._scale = ColourScale(wanted) if wanted else None
        colours: dict[str, Rgb] = {}
        values = values_of(samples, wanted, self.subject.joints) if self._scale else None
        if self._scale is not None and values is not None:
            children = {joint.name: joint.child for joint in self.subject.scene.model.robot.joints}
            for name, colour in zip(samples.joints, self._scale.colours(values[-1]), strict=True):
                if colour is not None and name in children:
                    colours[children[name]] = colour
        self.figure.tint(colours)

    def _contacts(self, samples: Samples, frames: Mapping[str, Array]) -> list[tuple[Array, Array]]:
        """Point (3,) in m at which the force of each contact is drawn, and the force (3,) in N, both in the world."""
        root, found = self.subject.scene.model.robot.root.name, []
        for pair, force in samples.contacts.items():
            body = pair.partition("/")[0]
            place = frames.get(body, frames.get(root))
            if place is not None and np.isfinite(force[-1]).all():
                found.append((place[:3, 3], force[-1]))
        return found

    def _torques(self, samples: Samples, frames: Mapping[str, Array]) -> list[tuple[Array, Array]]:
        """Point (3,) in m at which each external torque is drawn, and the torque as a vector (3,) along the joint's axis."""
        torques = samples.values.get("external_torque")
        joints = {joint.name: joint for joint in self.subject.scene.model.robot.joints}
        if torques is None:
            return []
        return [
            (frames[joint.child][:3, 3], frames[joint.child][:3, :3] @ np.array(joint.axis) * torque)
            for name, torque in zip(samples.joints, torques[-1].tolist(), strict=True)
            if (joint := joints.get(name)) is not None and math.isfinite(torque)
        ]

    def _draw_forces(self, name: str, forces: Sequence[tuple[Array, Array]], colour: Rgb) -> None:
        """Draw forces or torques at their points. The lengths of the arrows are relative to the largest force or torque so far,
        since a force has no natural length in the scene. forces: point (3,) and vector (3,) of each force or torque.
        """
        shown = [(point, vector) for point, vector in forces if np.linalg.norm(vector) > LEAST]
        sizes = [float(np.linalg.norm(vector)) for _, vector in shown]
        most = self._largest[name] = max([self._largest.get(name, LEAST), *sizes])
        scale = LONGEST * self.size / most
        self._draw_arrows(name, [(point, point + scale * vector) for point, vector in shown], colour)

    def _draw_arrows(self, name: str, ends: Sequence[tuple[Array, Array]], colour: Rgb) -> None:
        """Draw arrows, each from its first to its second point (3,), m."""
        points = np.array(ends, dtype=np.float32).reshape(-1, 2, 3)
        if name not in self._arrows:
            if not len(points):
                return
            self._arrows[name] = self._server.scene.add_arrows(
                f"/arrows_{name}",
                points,
                colour,
                shaft_radius=0.006 * self.size,
                head_radius=0.015 * self.size,
                head_length=0.04 * self.size,
            )
        elif len(points):
            self._arrows[name].points = points
        self._arrows[name].visible = bool(len(points))

    def _draw_pull(self, pull: Pull | None) -> None:
        """Draw the spring of a pull as an arrow, and write the force beside the arrow; None: hide the arrow and the text."""
        self._draw_arrows("pull", [] if pull is None else [(pull.point, pull.target)], PULL)
        if pull is None:
            if self._label is not None:
                self._label.visible = False
            return
        if self._label is None:
            self._label = self._server.scene.add_label("/pull", "", anchor="bottom-center")
        self._label.text = f"{np.linalg.norm(pull.force):.3g} N"
        self._label.position, self._label.visible = pull.target, True

    def _trace(self, time: float) -> Array:
        """Positions (n, 3) of the tip in the `TRACE` seconds before a time in s, m."""
        history, (link, point) = self.subject.history, self.tip
        way = history.path(TIP, time - TRACE, time)
        if not len(way):
            rows = history.rows(time - TRACE, time)
            if rows is None or self.subject.scene.model.robot.root.name in rows.bodies:
                return np.empty((0, 3))
            order = [rows.joints.index(name) for name in self.subject.scene.model.joints if name in rows.joints]
            positions = rows.values["link_position"][:, order]
            way, _ = self.subject.scene.model.pose(positions[:: max(1, len(positions) // TRACED)], link, point)
        return way[:: max(1, len(way) // TRACED)]

    def _line(self, name: str, points: Array, colour: Rgb) -> None:
        segments = np.stack([points[:-1], points[1:]], axis=1) if len(points) > 1 else np.empty((0, 2, 3))
        if name in self._lines:
            self._lines[name].remove()
            del self._lines[name]
        if len(segments):
            self._lines[name] = self._server.scene.add_line_segments(
                f"/{name}", segments, colour, thickness=2.5, thickness_units="screen"
            )

    def on_drag(self, report: Callable[[str, Any], None]) -> None:
        """Call `report` with a body and viser's event while a user drags the body."""
        self.figure.on_drag(report)


def _cloud(scene: RenderScene, frames: Mapping[str, Array]) -> Array:
    """Corners (n, 3) in the world of the boxes around all parts of the scene, m; if the scene has no parts, two corners of a
    cube of 1 m."""
    boxes = [part.mesh.bounding_box.vertices @ frames[part.body][:3, :3].T + frames[part.body][:3, 3] for part in scene.parts]
    return np.concatenate(boxes) if boxes else np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])
