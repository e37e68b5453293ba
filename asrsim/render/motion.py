"""Draws pictures of a logged motion, from the log alone."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from asrsim.errors import InputError, LogError, RobotError
from asrsim.log import open_log
from asrsim.log.derived import DERIVED_FUNCTIONS, recorded_sources
from asrsim.render.camera import Camera, fit_camera, fitting_aspect, main_axis, viewpoint, viewpoints
from asrsim.render.draw import Image, SceneDrawer
from asrsim.render.scene import RenderScene
from asrsim.render.shapes import drawable
from asrsim.robot.xmlfile import parse_xml
from asrsim.samples import Array, RunInfo, Samples

KEPT = 6000
"""Approximate number of samples that are kept of a long log. A film has fewer frames."""
LOOKS = 40
"""Number of instants, evenly spread over the motion, at which all bodies must be in the picture."""
GLANCES, GLANCE = 4, 90
"""GLANCES: number of instants at which hidden bodies are sought; GLANCE: square root of the area of the pictures for this
search, pixels."""
HIDDEN, GAIN = 0.4, 0.05
"""HIDDEN: hidden fraction of a moving body up to which a view is accepted; GAIN: reduction of this fraction for which another
view is preferred.
"""
_KEYS = ("robot", "base", "world")
"""Keys of a scenario that pictures need."""
GHOST = 0.28
"""Opacity of the faint robot that is drawn at the equilibrium of its springs."""
_STEADY = 0.3
"""Weight of time in the choice of a film strip's instants; the rest is the weight of the distance moved."""


@dataclass(frozen=True, kw_only=True)
class FilmFrame:
    """Picture of the motion at one time."""

    time: float
    """Time of the picture, s."""
    image: Image
    touching: tuple[str, ...] = ()
    """Objects in contact with the robot or with each other."""


class Film:
    """Motion of a log, ready to be drawn.

    Robot, world and poses come from the log. Meshes are not stored in a log. They are read from their files, and a missing mesh
    is replaced as `asrsim.render.shapes.drawable` describes. Actuators do not affect a picture, so a log with a user's own
    actuator needs no plugin.

    size: square root of a picture's area, pixels; the aspect ratio follows from the motion. sharpness: factor of oversampling
    of the renderer. start, end: start and end of the part of the log that is drawn, s.

    Raises LogError for a log without positions or samples, RobotError and ScenarioError if robot or world cannot be built.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        size: int = 360,
        sharpness: int = 2,
        start: float | None = None,
        end: float | None = None,
    ) -> None:
        self.path = Path(path)
        self._size = size
        self._sharpness = sharpness
        reader = open_log(self.path)
        self.info: RunInfo = reader.info
        count = reader.duration / (self.info.step * max(self.info.log_every, 1)) + 1
        if not any("link_position" in joint.quantities for joint in self.info.joints):
            raise LogError("the log contains no link positions", file=self.path, code="no-motion")
        names = recorded_sources(("link_position", "equilibrium_position"), self.info.joints)
        self.samples: Samples = reader.read(
            quantities=names, stride=max(1, math.ceil(count / KEPT)), start=start, end=end
        ).samples
        """Logged positions, poses and contacts; the samples of a long log are thinned."""
        if not len(self.samples.time):
            raise LogError("the log contains no samples", file=self.path, code="empty-log")
        positions = self.samples.values["link_position"]
        rest = DERIVED_FUNCTIONS["equilibrium_position"](self.samples, self.info.joints)
        self._equilibria = np.where(np.isfinite(rest), rest, positions)
        """Link positions (n, joints) at which springs would rest without load; logged positions for joints without springs."""
        self.scene, self.notes = logged_scene(self.info, self.path)
        self._painter = SceneDrawer(self.scene)
        self.camera: Camera
        self.width: int
        self.height: int
        self.place: Array
        """Outermost points (k, 3) of the motion, m."""
        share_view([self])

    @property
    def start(self) -> float:
        """Start of the film, s."""
        return float(self.samples.time[0])

    @property
    def end(self) -> float:
        """End of the film, s."""
        return float(self.samples.time[-1])

    def frame(self, time: float, *, ghost: bool = False) -> FilmFrame:
        """Picture of the sample nearest to a time in s. ghost: whether a faint robot is also drawn, at the equilibrium of its
        springs."""
        row = int(np.argmin(np.abs(self.samples.time - time)))
        image = self._image(self.frames(row))
        if ghost:
            rest = self._image(self.frames(row, self._equilibria[row]))
            image = np.asarray((1.0 - GHOST) * image + GHOST * rest + 0.5, dtype=np.uint8)
        return FilmFrame(time=float(self.samples.time[row]), image=image, touching=self._touching(row))

    def _image(self, frames: dict[str, Array]) -> Image:
        return self._painter.image(frames, self.camera, self.width, self.height, sharpness=self._sharpness, place=self.place)

    def frames(self, row: int, values: Array | None = None) -> dict[str, Array]:
        """Frame (4, 4) of each body in the world at a sample. row: index of the sample; values: joint positions (joints,) that
        replace the logged positions, rad or m.
        """
        values = self.samples.values["link_position"][row] if values is None else values
        return self.scene.frames(
            {name: float(value) for name, value in zip(self.samples.joints, values, strict=True) if math.isfinite(value)},
            {name: poses[row] for name, poses in self.samples.bodies.items() if np.isfinite(poses[row]).all()},
        )

    def _touching(self, row: int) -> tuple[str, ...]:
        """Objects that touch the robot or another object at a sample. row: index of the sample."""
        pairs = [pair.split("/", 1) for pair, force in self.samples.contacts.items() if np.any(np.nan_to_num(force[row]))]
        touching = (body for pair in pairs if pair[1] != "ground" for body in pair)
        return tuple(dict.fromkeys(body for body in touching if body in self.scene.objects))

    def _sight(self) -> tuple[Array, dict[str, Array], dict[str, float]]:
        """Outermost points (k, 3) of all bodies during the motion, m; axis (3,) of each joint in the world; and range of each
        joint's motion, rad.
        """
        positions = self.samples.values["link_position"]
        travel = {
            name: float(np.ptp(column[np.isfinite(column)])) if np.isfinite(column).any() else 0.0
            for name, column in zip(self.samples.joints, positions.T, strict=True)
        }
        rows = np.unique(np.linspace(0, len(self.samples.time) - 1, LOOKS).astype(int))
        all_frames = [self.frames(int(row)) for row in rows]
        cloud = np.concatenate([self._painter.outer_points(frames) for frames in all_frames])
        return cloud, self.scene.axes(all_frames[-1]), travel

    def _hidden(self, camera: Camera, aspect: float) -> float:
        """Fraction of a moving body that other bodies hide from the camera, averaged over the motion, for the body with the
        largest fraction.
        """
        rows = np.unique(np.linspace(0, len(self.samples.time) - 1, GLANCES).astype(int))
        frames = [self.frames(int(row)) for row in rows]
        width, height = round(GLANCE * aspect**0.5), round(GLANCE / aspect**0.5)
        shares = [self._painter.hidden(one, camera, width, height) for one in frames]
        moving = [name for name in shares[0] if np.ptp([one[name] for one in frames], axis=0).max() > 1e-3]
        return max((float(np.mean([share[name] for share in shares])) for name in moving), default=0.0)

    def happening(self) -> Array:
        """Progress (n,) of the motion at each sample, from 0 to 1. It is a mean of the fractions of the distance and of the
        time that have passed, or the fraction of the time alone if nothing moves.
        """
        ways = [np.nan_to_num(self.samples.values["link_position"])]
        ways += [np.nan_to_num(poses[:, :3]) for poses in self.samples.bodies.values()]
        way = np.concatenate([[0.0], np.cumsum(sum(np.abs(np.diff(one, axis=0)).sum(axis=1) for one in ways))])
        time = self.samples.time - self.samples.time[0]
        even = time / time[-1] if len(time) > 1 else time
        return np.asarray(_STEADY * even + (1 - _STEADY) * way / way[-1] if way[-1] > 0.0 else even)


def share_view(films: Sequence[Film]) -> None:
    """Give all films the same camera, which sees all their motions, and the same size of pictures."""
    seen = [film._sight() for film in films]
    cloud = np.concatenate([points for points, _, _ in seen])
    axes = {f"{number}/{name}": axis for number, (_, mine, _) in enumerate(seen) for name, axis in mine.items()}
    travel = {f"{number}/{name}": way for number, (_, _, mine) in enumerate(seen) for name, way in mine.items()}
    for film in films:
        film.place = cloud
    least, size = math.inf, films[0]._size
    for towards in viewpoints(viewpoint(main_axis(axes, travel))):
        aspect = fitting_aspect(cloud, towards)
        # Choose even numbers of pixels, which video encoders need.
        width, height = 2 * round(0.5 * size * aspect**0.5), 2 * round(0.5 * size / aspect**0.5)
        camera = fit_camera(cloud, towards, aspect=width / height)
        hidden = max(film._hidden(camera, aspect) for film in films)
        if hidden < least - GAIN:
            least = hidden
            for film in films:
                film.camera, film.width, film.height = camera, width, height
        if least <= HIDDEN:
            break


def even_times(film: Film, count: int) -> list[float]:
    """`count` evenly spaced times in s over the film, start and end included. Raises InputError for a count below 1."""
    if count < 1:
        raise InputError("must be 1 or more", key="frames", value=count, code="bad-frames")
    return [film.end] if count == 1 else np.linspace(film.start, film.end, count).tolist()


def telling_times(films: Sequence[Film], count: int) -> list[float]:
    """`count` times in s over all films, start and end included, closer where the motion is faster. Raises InputError for a
    count below 1.
    """
    longest = max(films, key=lambda film: film.end - film.start)
    even = even_times(longest, count)
    if count < 3:
        return even
    time = np.linspace(longest.start, longest.end, 2000)
    over = np.mean([np.interp(time, film.samples.time, film.happening()) for film in films], axis=0)
    return [even[0], *np.interp(np.linspace(0.0, over[-1], count)[1:-1], over, time).tolist(), even[-1]]


def logged_scene(info: RunInfo, path: Path) -> tuple[RenderScene, tuple[str, ...]]:
    """Robot and world of a log, and notes on parts that cannot be drawn as they are. Raises the errors of `Film`."""
    from asrsim.runs.rerun import restore

    if not info.urdf or "scenario" not in info.resolved:
        raise LogError("the log does not contain its robot and scenario", file=path, code="no-scenario")
    keys = {key: value for key, value in info.resolved["scenario"].items() if key in _KEYS}
    info = replace(info, urdf=_shape_only(info.urdf), resolved={"scenario": {**keys, "duration": 1.0}})
    with TemporaryDirectory(prefix="asrsim-render-") as folder:
        try:
            scenario, robot = restore(info, Path(folder))
        except InputError as error:
            # Name the log, since the restored files are temporary.
            raise LogError(replace(problem, file=path, line=None) for problem in error.problems) from error
        shown, notes = drawable(robot, scenario.package_paths)
        scene = RenderScene(shown, scenario)
    return scene, (*notes, *scene.notes)


def _shape_only(urdf: str) -> str:
    """Robot description without the blocks for simulators, which contain actuators that pictures do not need."""
    from lxml import etree

    with suppress(RobotError):
        root = parse_xml(urdf.encode(), Path("robot.urdf"), large=True)
        for block in root.findall("gazebo"):
            root.remove(block)
        return str(etree.tostring(root, encoding="unicode"))
    return urdf
