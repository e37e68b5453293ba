"""The subject of a page: a robot in its world, and samples of its motion from any source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from asrsim.errors import LogError
from asrsim.log import open_log
from asrsim.log.derived import recorded_sources
from asrsim.quantities import DERIVED
from asrsim.render.motion import logged_scene
from asrsim.render.scene import RenderScene
from asrsim.samples import Array, JointInfo
from asrsim.viewer.history import History

ROWS = 20_000
"""Approximate largest number of samples that are read from a log; a longer log is thinned."""


@dataclass(frozen=True, kw_only=True)
class Subject:
    """Robot, world and samples that a page shows. The page treats samples of logs, recordings and live runs alike."""

    title: str
    joints: tuple[JointInfo, ...]
    scene: RenderScene
    history: History
    path: Array | None = None
    """Positions (n, 3) of the desired path of a Cartesian task, m."""
    notes: tuple[str, ...] = ()

    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that a plot can show, logged and derived."""
        logged = dict.fromkeys(name for joint in self.joints for name in joint.quantities)
        return (*logged, *(name for name in DERIVED if recorded_sources([name], self.joints)))


@dataclass(frozen=True, kw_only=True)
class Companion:
    """A second motion that is shown beside the motion of the subject. It is the motion of another run, of another variant, or
    of a recording. Its robot is a ghost, and its curves are dashed.
    """

    label: str
    curve: Callable[[str, str, float, float], tuple[Array, Array]]
    """Function (joint, quantity, start, end) that returns times and values of this quantity between two times in s. All times
    are on the subject's clock.
    """
    history: History | None = None
    """Motion of the ghost; None if the companion has no positions and therefore no ghost."""
    scene: RenderScene | None = None
    """Robot of the ghost; None: the robot of the subject."""
    shown: bool = True
    """Whether the ghost is shown at first."""
    notes: tuple[str, ...] = ()


def logged(path: Path) -> Subject:
    """Robot, world and samples of a log; the samples of a long log are thinned. Raises the errors of `asrsim.render.Film`."""
    reader = open_log(path)
    info = reader.info
    if not any("link_position" in joint.quantities for joint in info.joints):
        raise LogError("the log contains no link positions", file=path, code="no-motion")
    scene, notes = logged_scene(info, path)
    count = reader.duration / (info.step * max(info.log_every, 1)) + 1
    samples = reader.read(stride=max(1, round(count / ROWS))).samples
    if not len(samples.time):
        raise LogError("the log contains no samples", file=path, code="empty-log")
    name = info.scenario_name or info.robot
    title = f"{name} / {info.variant}" if info.variant else name
    goal = samples.bodies.get("tip_goal")
    return Subject(
        title=title,
        joints=info.joints,
        scene=scene,
        history=History(info.joints, samples),
        notes=notes,
        path=None if goal is None else goal[:: max(1, len(goal) // 300), :3],
    )


def as_companion(subject: Subject, label: str, *, shown: bool = True) -> Companion:
    """Another subject as a companion with this label."""
    history = subject.history
    return Companion(label=label, history=history, scene=subject.scene, curve=history.curve, shown=shown)
