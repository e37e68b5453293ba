"""The logged motion as pictures, from the log alone."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from asrsim.errors import InputError, LogError, Problem
from asrsim.log import open_log
from asrsim.render.camera import Camera, fit_camera, fitting_aspect, main_axis, viewpoint
from asrsim.render.shapes import drawable
from asrsim.samples import RunInfo, Samples

if TYPE_CHECKING:
    from asrsim.engines.bullet_view import BulletView

Image = NDArray[np.uint8]
"""(height, width, 3)."""
KEPT = 6000
"""Samples kept of a long log: more than any film has frames."""
LOOKS = 40
"""Instants at which the camera looks where things are."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One picture of the motion."""

    time: float
    """s."""
    image: Image


class Film:
    """A log's motion, ready to be drawn; a context that holds the renderer.

    Robot, world and poses come from the log; meshes, which a log does not hold, from where they were when it was written: a
    missing one is replaced as :func:`asrsim.render.shapes.drawable` says.

    size: pixels, root of a picture's area; its shape follows from the motion. sharpness: the renderer's pixels are so many
    times finer, and averaged.

    Raises LogError for a log without positions, RobotError and ScenarioError where robot or world cannot be built.
    """

    def __init__(self, path: str | os.PathLike[str], *, size: int = 550, sharpness: int = 2) -> None:
        self.path = Path(path)
        self._size = size
        self._sharpness = sharpness
        reader = open_log(self.path)
        self.info: RunInfo = reader.info
        count = reader.duration / (self.info.step * max(self.info.log_every, 1)) + 1
        if not any("link_position" in joint.quantities for joint in self.info.joints):
            raise LogError(Problem(message="the log holds no link positions", file=self.path, code="no-motion"))
        stride = max(1, math.ceil(count / KEPT))
        self._samples: Samples = reader.read(quantities=["link_position"], stride=stride).samples
        if not len(self._samples.time):
            raise LogError(Problem(message="the log holds no samples", file=self.path, code="empty-log"))
        self.width, self.height = size, size
        """Pixels of a picture."""
        self._stack = ExitStack()
        try:
            self._view, self.notes = self._open()
            self.camera = self._aim()
        except BaseException:
            self._stack.close()
            raise

    def __enter__(self) -> Film:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Release the renderer."""
        self._stack.close()

    @property
    def start(self) -> float:
        """s."""
        return float(self._samples.time[0])

    @property
    def end(self) -> float:
        """s."""
        return float(self._samples.time[-1])

    def frame(self, time: float) -> Frame:
        """The picture at a time in s, of the sample nearest to it."""
        row = self._place(time)
        factor = self._sharpness
        camera = self.camera
        image = self._view.image(
            eye=camera.eye.tolist(), target=camera.target.tolist(), up=camera.up.tolist(), field=camera.field,
            width=self.width * factor, height=self.height * factor,
        )  # fmt: skip
        return Frame(time=float(self._samples.time[row]), image=_reduce(image, self.width, self.height))

    def frames(self, times: Sequence[float]) -> Iterator[Frame]:
        """Pictures at the times in s, one after the other."""
        return (self.frame(time) for time in times)

    def _open(self) -> tuple[BulletView, tuple[str, ...]]:
        from asrsim.engines.bullet_view import BulletView
        from asrsim.robot import engine_urdf
        from asrsim.runs.repeat import restore

        folder = Path(self._stack.enter_context(TemporaryDirectory(prefix="asrsim-render-")))
        if not self.info.urdf or "scenario" not in self.info.resolved:
            raise LogError(Problem(message="the log does not hold its robot and scenario", file=self.path, code="no-scenario"))
        scenario, robot = restore(self.info, folder)
        text, warnings = engine_urdf(robot, visuals=True, package_paths=scenario.package_paths)
        shapes = drawable(text)
        view = BulletView(
            robot, shapes.urdf, base_position=scenario.base_position, base_rpy=scenario.base_rpy, world=scenario.world,
            initial=scenario.initial_positions,
        )  # fmt: skip
        self._stack.callback(view.close)
        notes = [str(warning) for warning in warnings if warning.code == "missing-visual-mesh"]
        return view, (*notes, *shapes.notes)

    def _aim(self) -> Camera:
        positions = self._samples.values["link_position"]
        travel = {
            name: float(np.ptp(column[np.isfinite(column)])) if np.isfinite(column).any() else 0.0
            for name, column in zip(self._samples.joints, positions.T, strict=True)
        }
        points = []
        for time in np.linspace(self.start, self.end, min(LOOKS, len(self._samples.time))):
            self._place(float(time))
            points.append(self._view.points())
        cloud = np.concatenate(points)
        towards = viewpoint(main_axis(self._view.axes(), travel))
        aspect = fitting_aspect(cloud, towards)
        # Even numbers: video needs them.
        self.width, self.height = 2 * round(0.5 * self._size * aspect**0.5), 2 * round(0.5 * self._size / aspect**0.5)
        camera = fit_camera(cloud, towards, aspect=self.width / self.height)
        middle = 0.5 * (cloud.min(axis=0) + cloud.max(axis=0))
        self._view.lay_floor(middle.tolist(), 2.5 * float(np.linalg.norm(np.ptp(cloud, axis=0))))
        return camera

    def _place(self, time: float) -> int:
        samples = self._samples
        row = int(np.argmin(np.abs(samples.time - time)))
        values = samples.values["link_position"][row]
        self._view.place(
            {name: float(value) for name, value in zip(samples.joints, values, strict=True) if math.isfinite(value)},
            {name: poses[row].tolist() for name, poses in samples.bodies.items() if np.isfinite(poses[row]).all()},
        )
        return row


def even_times(film: Film, count: int) -> list[float]:
    """So many times in s over the whole film, both ends included. Raises InputError for less than one."""
    if count < 1:
        raise InputError(Problem(message="must be 1 or more", key="frames", value=count, code="bad-frames"))
    return [film.end] if count == 1 else np.linspace(film.start, film.end, count).tolist()


def _reduce(image: Image, width: int, height: int) -> Image:
    """Smaller by averaging: the renderer has jagged edges."""
    if image.shape[:2] == (height, width):
        return image
    factor = image.shape[0] // height
    blocks = image.reshape(height, factor, width, factor, 3).astype(np.uint16)
    return np.asarray(blocks.mean(axis=(1, 3)).round(), dtype=np.uint8)
