"""Writes the samples of a run to an MCAP file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from asrsim.errors import OutputError
from asrsim.log.cdr import CdrBuilder
from asrsim.log.container import McapContainer
from asrsim.log.description import RESULT_METADATA, RUN_METADATA, info_attachments, info_metadata
from asrsim.log.frames import FrameMessages
from asrsim.log.rows import RowBuffer
from asrsim.log.topics import DESCRIPTION_TOPIC, Topic, body_topic, contact_topic, robot_topics
from asrsim.samples import RunInfo, Samples


class LogWriter:
    """Writer of a run's MCAP file, which ROS 2 tools, viewers and `asrsim.log.read_log` can open.

    The file is readable at any time up to the last complete chunk (some hundred to 2048 samples), even if the process is
    killed. The memory is independent of the duration. Times are simulated times.

    Args:
        path: The file; an existing file is replaced.
        info: Description of the run; the `quantities` of its joints are recorded.

    Raises:
        OutputError: The file cannot be written. Samples that were written before remain readable.
    """

    def __init__(self, path: str | os.PathLike[str], info: RunInfo) -> None:
        self.path = Path(path)
        self.info = info
        self.samples = 0
        """Number of samples received so far."""
        self._container = McapContainer(
            self.path,
            attachments=info_attachments(info),
            metadata={RUN_METADATA: info_metadata(info)},
        )
        scenario = info.resolved.get("scenario", {})
        compact = scenario.get("log") == "compact"
        # The toolbox's manager publishes the arrays, so they are written for scenarios with a manager.
        self._robot_topics = robot_topics(
            info.joints, compact=compact, arrays=scenario.get("manager") is not None, external="external_torques" in scenario
        )
        self._layout: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._rows = self._row_buffer()
        self._description = Topic(
            name=DESCRIPTION_TOPIC, message="std_msgs/String", template=CdrBuilder().string(info.urdf).build()
        )
        self._frames = FrameMessages(info.frames, info.frame_rate) if info.frames and info.frame_rate > 0.0 else None
        self._asides: list[tuple[int, int, bytes]] = []
        self._begun = False
        self._failed = False
        self._closed = False

    def write(self, samples: Samples) -> None:
        """Add samples that follow the previous samples in time. Bodies and contacts may change between calls."""
        if self._failed or self._closed:
            raise OutputError(f"{self.path}: the log is closed")
        layout = (tuple(samples.bodies), tuple(samples.contacts))
        if layout != self._layout:
            self.flush()
            self._layout = layout
            self._rows = self._row_buffer()
        if not self._begun and len(samples.time):
            self._begin(float(samples.time[0]))
        if self._frames is not None:
            for time, data in self._frames.messages(samples):
                self.aside(self._frames.topic, time, data)
        start = 0
        while start < len(samples.time):
            taken = self._rows.append(samples, start, self.samples)
            start += taken
            self.samples += taken
            if self._rows.count == self._rows.capacity:
                self.flush()

    def aside(self, topic: Topic, time: float, data: bytes) -> None:
        """Add a message of `topic` at `time` in s outside of the samples. It is written together with the samples of that
        time."""
        self._asides.append((self._container.channel(topic), round(time * 1e9), data))

    def _begin(self, time: float) -> None:
        """Add the messages that appear once, at the time of the first sample."""
        self._begun = True
        if self.info.urdf:
            self.aside(self._description, time, self._description.template.data)
        if self._frames is not None and self._frames.static is not None:
            self.aside(self._frames.static_topic, time, self._frames.static)

    def close(self, metadata: Mapping[str, str] | None = None) -> None:
        """Write the remaining samples, the result as metadata record `asrsim_result`, and the index. Further calls do nothing.

        metadata: The result; `status` is `complete` by default.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if not self._failed:
                self.flush(last=True)
            self._container.finish(RESULT_METADATA, {"status": "complete", "samples": str(self.samples), **(metadata or {})})
        finally:
            self._container.close()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        if error is None:
            self.close()
            return
        status = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
        try:
            self.close({"status": status, "error": f"{type(error).__name__}: {error}"})
        except OutputError as second:
            error.add_note(str(second))

    def flush(self, *, last: bool = False) -> None:
        """Write all received samples as a chunk, even a small one. last: no samples follow."""
        if last and not self._begun:
            self._begin(0.0)
        end = self._rows.span()[1]
        ready = [aside for aside in self._asides if last or aside[1] <= end]
        if not self._rows.count and not (last and ready):
            return
        try:
            self._container.chunk(self._rows, ready)
        except OutputError:
            self._failed = True
            raise
        self._asides = [] if last else [aside for aside in self._asides if aside[1] > end]
        self._rows.clear()

    def _row_buffer(self) -> RowBuffer:
        bodies, contacts = self._layout
        topics = [*self._robot_topics, *([body_topic(bodies)] if bodies else []), *map(contact_topic, contacts)]
        return RowBuffer([(self._container.channel(topic), topic) for topic in topics])
