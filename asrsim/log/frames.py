"""Poses of the robot's links as `/tf` and `/tf_static`. Viewers need them besides `/robot_description` to animate the robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.log.cdr import CdrBuilder, CdrTemplate, MessageColumn
from asrsim.log.topics import Topic
from asrsim.samples import Array, Frame, Samples


class FrameMessages:
    """Messages with the frames that joints move, at a given rate, and one message with the fixed frames."""

    def __init__(self, frames: Sequence[Frame], rate: float) -> None:
        """rate: Largest rate of the messages, Hz."""
        self._moving = [frame for frame in frames if frame.joint]
        self._rate, self._next = rate, 0
        self.topic = Topic(name="/tf", message="tf2_msgs/TFMessage", template=_template(self._moving), canonical=False)
        self._places = np.array([frame.position for frame in self._moving]).reshape(-1, 3)
        self._slides = np.array([frame.prismatic for frame in self._moving], bool)
        self._start = np.array([frame.rotation for frame in self._moving]).reshape(-1, 4)
        axes = np.array([frame.axis for frame in self._moving]).reshape(-1, 3)
        vector, scalar = self._start[:, :3], self._start[:, 3:]
        across = np.cross(vector, axes)
        self._half_turn = np.hstack([scalar * axes + across, -np.sum(vector * axes, axis=1, keepdims=True)])
        """Rotation (frames, 4) of each frame after half a turn of its joint, which is the product of the initial rotation and
        the axis."""
        self._axes = axes + 2.0 * (scalar * across + np.cross(vector, across))
        """Axis (frames, 3) of each joint in the frame of the parent link."""
        still = [frame for frame in frames if not frame.joint]
        self.static_topic = Topic(name="/tf_static", message="tf2_msgs/TFMessage", template=_template(still), canonical=False)
        poses = np.array([(*frame.position, *frame.rotation) for frame in still]).reshape(1, -1, 7)
        self.static: bytes | None = _filled(self.static_topic.template, np.zeros(1), poses)[0] if still else None
        """Message with the fixed frames; None if there are no fixed frames."""

    def messages(self, samples: Samples) -> list[tuple[float, bytes]]:
        """Pairs (time in s, message) for the samples at which a message is due. Calls must follow the order of time."""
        if not self._moving or not len(samples.time):
            return []
        ticks = np.floor(samples.time * self._rate + 1e-9)
        due = np.flatnonzero(np.diff(ticks, prepend=self._next - 1.0) > 0)
        if not len(due):
            return []
        self._next = int(ticks[-1]) + 1
        columns = [samples.joints.index(frame.joint) for frame in self._moving]
        poses = self._poses(samples.values["link_position"][due][:, columns])
        messages = _filled(self.topic.template, samples.time[due], poses)
        return list(zip(samples.time[due].tolist(), messages, strict=True))

    def _poses(self, positions: Array) -> Array:
        """Poses (n, frames, 7) of the joints' frames: position in m, quaternion x y z w. positions: positions of the joints (n,
        frames), rad or m."""
        half = np.where(self._slides, 0.0, 0.5 * positions)[..., None]
        slides = np.where(self._slides, positions, 0.0)[..., None]
        rotation = np.cos(half) * self._start + np.sin(half) * self._half_turn
        return np.concatenate([self._places + slides * self._axes, rotation], axis=-1)


def _template(frames: Sequence[Frame]) -> CdrTemplate:
    builder = CdrBuilder().uint32(len(frames))
    for frame in frames:
        builder.header(frame.parent).string(frame.child)
        builder.numbers(MessageColumn("frame", frame.child, index) for index in range(7))
    return builder.build()


def _filled(template: CdrTemplate, time: Array, poses: Array) -> list[bytes]:
    """Messages with the poses (n, frames, 7) at the times (n,) in s."""
    rows = np.tile(np.frombuffer(template.data, np.uint8), (len(time), 1))
    stamps = np.stack(np.divmod(np.rint(time * 1e9).astype("<i8"), 1_000_000_000), axis=1).astype("<u4")
    for offset in template.stamps:
        rows[:, offset : offset + 8] = stamps.view(np.uint8)
    places = np.array([offset for offset, _ in template.floats])[:, None] + np.arange(8)
    rows[:, places.ravel()] = np.ascontiguousarray(poses.reshape(len(time), -1), "<f8").view(np.uint8)
    return [row.tobytes() for row in rows]
