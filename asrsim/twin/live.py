"""Twin beside a robot in real time: it reads topics of commands and joint states, and publishes torques, stiffness
and alarms.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack

import numpy as np

from asrsim.live.commands import CommandInput
from asrsim.live.pace import Pace
from asrsim.live.transport import Access, Inlet, Interface, Outlet, Received, Transport, opened, prefix_of, publish, report
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.ranges import ranges_of, with_ranges
from asrsim.twin.twin import Twin, TwinStep

FIELDS = ("external_torque", "stiffness", "residual", "alarm")
"""Fields of a `TwinStep` that are published for each joint, as std_msgs/Float64."""
FLOAT64 = struct.Struct("<4sd")
"""Binary layout (CDR) of a std_msgs/Float64: encapsulation header and value."""
LONGEST_GAP = 0.1
"""Longest time between the stamps of two messages over which positions are interpolated, s."""
QUIET = 0.5
"""Time without an alarm after which the next alarm of a joint is reported, s."""


class LiveTwin:
    """Twin that follows a robot in real time in `run`. `tell` receives messages for the user."""

    def __init__(
        self, scenario: Scenario, *, bandwidth: float = 8.0, transports: Sequence[str] = (), access: Access | None = None,
        namespace: str = "", duration: float | None = None, tell: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        """transports, access, namespace: as in `asrsim.live.session.Settings`; duration: duration in s; None: until the user
        stops.
        """
        prepared = with_ranges(scenario)
        prefix = prefix_of(namespace)
        self._twin, self._step, self._duration, self._tell = Twin(prepared, bandwidth=bandwidth), scenario.step, duration, tell
        self._commands = CommandInput(prepared.info.joints, ranges_of(prepared), prefix=prefix)
        source = Inlet(f"{prefix}/joint_states", "sensor_msgs/JointState")
        outlets = [
            Outlet(f"{prefix}/twin/{joint}/{field}", "std_msgs/Float64") for joint in self._twin.joints for field in FIELDS
        ]
        self.interface = Interface(
            node=f"{prefix}/asrsim_twin", outlets=tuple(outlets), inlets=(*self._commands.inlets, source), latched={},
        )  # fmt: skip
        self._names, self._access = transports, access or Access()
        self._received: list[tuple[float, Array]] = []
        """Time stamps in s, and positions that the twin has not followed yet."""
        self._last: tuple[float, Array] | None = None
        """Time stamp and positions that the twin followed last."""
        self._alarm_ends = np.full(len(self._twin.joints), -np.inf)
        self.alarms = self.steps = 0

    @property
    def time(self) -> float:
        """Time that the twin has followed the robot, s."""
        return self.steps * self._step

    def run(self, *, stop: Callable[[], bool]) -> None:
        """Follow the robot until `stop` returns True or the duration is over. Raises InputError if a transport is missing."""
        pace = Pace(1.0)
        with ExitStack() as stack:
            stack.callback(self._twin.close)
            transports = stack.enter_context(opened(self._names, self.interface, self._access, self._tell))
            self._tell(f"waiting for positions on {self.interface.inlets[-1].name}")
            while not stop() and (self._duration is None or pace.ticks * self._step < self._duration):
                if pace.wait(self._step) is None:
                    continue
                commands: dict[str, dict[str, float]] = {}
                received = self._without_positions(transports)
                values = self._commands.listen(received, self._twin.worlds, self.time, self._step)
                for (joint, reference), value in values.items():
                    commands.setdefault(joint, {})[reference] = value
                for positions in self._due():
                    found = self._twin.step(positions, commands)
                    self.steps += 1
                    publish(transports, round(self.time * 1e9), _messages(found))
                    self._report_alarms(found)
                    report(self._tell, [*found.notes], [])
                report(self._tell, self._commands.notices, transports)

    def _due(self) -> Iterator[Array]:
        """Positions at the twin's steps, interpolated between the time stamps of the messages, so that varying delays have no
        effect. A message without a stamp, or after a gap, is a single step.
        """
        while self._received:
            stamp, positions = self._received.pop(0)
            before, start = self._last or (stamp, positions)
            steps = round((stamp - before) / self._step)
            if not (stamp and 0 <= steps <= LONGEST_GAP / self._step):
                steps = 1
            if steps or self._last is None:
                self._last = stamp, positions
            for k in range(1, steps + 1):
                yield start + (positions - start) * k / steps

    def _report_alarms(self, found: TwinStep) -> None:
        """Report alarms of joints that had no alarm for a while."""
        for joint in np.flatnonzero(found.alarm).tolist():
            if self.time - self._alarm_ends[joint] > QUIET:
                self.alarms += 1
                self._tell(f"{self.time:.3f} s: alarm at {self._twin.joints[joint]}")
            self._alarm_ends[joint] = self.time

    def _without_positions(self, transports: Sequence[Transport]) -> Iterator[Received]:
        """Received messages with commands; received messages with positions are stored for the next steps."""
        for transport in transports:
            for message in transport.poll():
                if message.inlet < len(self._commands.inlets):
                    yield message
                    continue
                known = dict(zip(message.names or (), message.values, strict=False))
                positions = np.array([known.get(joint, math.nan) for joint in self._twin.joints])
                if np.isfinite(positions).any():
                    self._received.append((message.stamp, positions))


def _messages(found: TwinStep) -> list[bytes]:
    table = np.column_stack([getattr(found, field) for field in FIELDS]).astype(float)
    return [FLOAT64.pack(b"\0\1\0\0", value) for value in table.ravel().tolist()]
