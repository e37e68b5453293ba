"""Twin of a robot in real time. It receives commands and joint states from topics, and publishes external torques, stiffness,
residuals and alarms.
"""

from __future__ import annotations

import math
import struct
import time as clock
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import itemgetter

import numpy as np

from asrsim.live.commands import CommandInput
from asrsim.live.pace import Pace
from asrsim.live.publisher import APPLIED
from asrsim.live.transport import Access, Interface, LiveTopic, Received, Transport, opened, prefix_of
from asrsim.progress import Stop
from asrsim.samples import Array
from asrsim.simulation.drives import EXTERNAL_TORQUE, ranges_of
from asrsim.simulation.prepare import ScenarioLike, prepare_worlds
from asrsim.twin.twin import LONGEST_GAP, Twin, TwinStep

FIELDS = ("external_torque", "stiffness", "residual", "alarm")
"""Fields of `TwinStep` that are published for each joint, each as a std_msgs/Float64."""
FLOAT64 = struct.Struct("<4sd")
"""Binary layout (CDR) of a std_msgs/Float64 message: encapsulation header and value."""
PAUSE = 5.0
"""The robot counts as paused or restarted if the stamps of two successive messages differ by more than this time, s."""
WAIT = 0.02
"""Time for which the twin holds a message back, s. Messages that were published earlier may arrive later."""
MOST_COMMANDS = 1000
"""Largest number of commands that are kept until the next positions arrive."""
QUIET = 0.5
"""An alarm of a joint is reported only if the joint had no alarm for longer than this time, s."""


class LiveTwin:
    """A twin that follows a robot in real time."""

    def __init__(
        self,
        scenario: ScenarioLike,
        *,
        bandwidth: float = 8.0,
        transports: Sequence[str] = (),
        access: Access | None = None,
        namespace: str = "",
        duration: float | None = None,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        """bandwidth: bandwidth of the observer, Hz; transports, access, namespace: as in `asrsim.live.session.Settings`;
        duration: time after which the twin ends, s, or None if it ends when the user stops it; tell: function that receives
        messages for the user.
        """
        prepared = prepare_worlds(scenario, settable=True)
        prefix, ranges = prefix_of(namespace), ranges_of(prepared.scenario, prepared.drives)
        self._step, self._duration, self._tell = prepared.scenario.step, duration, tell
        self._twin = Twin(prepared, bandwidth=bandwidth)
        self._commands = CommandInput(prepared.info.joints, ranges, prefix=prefix, tell=tell)
        sources = [LiveTopic(prefix + name, "sensor_msgs/JointState") for name in (APPLIED, "/joint_states")]
        names = [f"{prefix}/twin/{joint}/{field}" for joint in self._twin.joints for field in FIELDS]
        outlets = tuple(LiveTopic(name, "std_msgs/Float64") for name in names)
        self.interface = Interface(f"{prefix}/asrsim_twin", outlets, (*self._commands.inlets, *sources))
        self._names, self._access = transports, access or Access()
        self._references = [(joint, name) for joint, own in ranges.items() for name in own if name != EXTERNAL_TORQUE]
        self._applied = np.full(len(self._references), np.nan)
        """Last applied command of each reference, as the robot publishes it; NaN if the robot publishes no applied commands."""
        self._waiting: list[tuple[float, Received]] = []
        """Messages that are held back, each with the time of its publication, s."""
        self._last: tuple[float, Array] | None = None
        """Time stamp of the last positions, s, and an array of these positions followed by the applied commands."""
        self.prepared = prepared
        self.watch: Callable[[Array, TwinStep], None] = lambda positions, found: None
        """Function that is called after each step with the measured positions (n,) and the estimates."""
        self._alarm_ends = np.full(len(self._twin.joints), -np.inf)
        self.alarms = self.steps = 0

    @property
    def time(self) -> float:
        """Time for which the twin has followed the robot, s."""
        return self.steps * self._step

    def run(self, *, stop: Stop) -> None:
        """Follow the robot until `stop` returns True or the duration is reached. Raises InputError if a transport is not
        available.
        """
        pace = Pace(1.0)
        with self._twin, opened(self._names, self.interface, self._access, self._tell) as transports:
            self._tell(f"waiting for positions on {self.interface.inlets[-1].name}")
            commands = deque[Received](maxlen=MOST_COMMANDS)
            while not stop() and (self._duration is None or pace.ticks * self._step < self._duration):
                if pace.wait(self._step) is None:
                    continue
                for message in self._in_order(transports):
                    if message.inlet < len(self._commands.inlets):
                        commands.append(message)
                    elif self.interface.inlets[message.inlet].name.endswith(APPLIED):
                        self._applied = _values(message, map(".".join, self._references))
                    else:
                        for row in self._due(message):
                            self._follow(row, commands, transports)
                            commands.clear()

    def _in_order(self, transports: Sequence[Transport]) -> Iterator[Received]:
        """Messages in the order of their publication, so that positions are combined with commands that the robot had received
        before.

        On a busy machine, a message may arrive after a message that another program published later. Therefore each message is
        held back for `WAIT` seconds. This is not necessary if the robot publishes its applied commands.
        """
        now = clock.time()
        arrived = (message for transport in transports for message in transport.poll())
        self._waiting += [(message.sent or now, message) for message in arrived]
        self._waiting.sort(key=itemgetter(0))
        wait = WAIT if np.isnan(self._applied).all() else 0.0
        newest = self._waiting[-1][0] if self._waiting else 0.0
        while self._waiting and self._waiting[0][0] <= newest - wait:
            yield self._waiting.pop(0)[1]

    def _due(self, message: Received) -> Iterator[Array]:
        """Positions and applied commands for each step of the twin until this message, in one array for each step. They are
        interpolated between the time stamps of two messages, so that varying delays of messages have no effect. In a long gap
        between messages the positions are unknown (NaN). A message without a time stamp, or after a pause, gives one step.
        """
        positions = _values(message, self._twin.joints)
        if not np.isfinite(positions).any():
            return
        row = np.concatenate([positions, self._applied])
        before, start = self._last or (message.stamp, row)
        steps = round((message.stamp - before) / self._step)
        if not (message.stamp and 0 <= steps <= PAUSE / self._step):
            steps = 1
        if steps or self._last is None:
            self._last = message.stamp, row
        for k in range(1, steps + 1):
            between = start + (row - start) * k / steps
            if k < steps and steps > LONGEST_GAP / self._step:
                between[: len(positions)] = np.nan
            yield between

    def _follow(self, row: Array, messages: Sequence[Received], transports: Sequence[Transport]) -> None:
        """Let the twin take a step, and publish its estimates. row: positions followed by applied commands; messages: commands
        that the twin uses if the robot does not publish its applied commands.
        """
        positions, applied = np.split(row, [len(self._twin.joints)])
        values = dict(zip(self._references, applied.tolist(), strict=True))
        if np.isnan(applied).all():
            values = self._commands.listen(messages, self._twin.worlds, self.time, self._step)
        commands: dict[str, dict[str, float]] = {}
        for (joint, reference), value in values.items():
            commands.setdefault(joint, {})[reference] = value
        found = self._twin.step(positions, commands)
        self.steps += 1
        self.watch(positions, found)
        for transport in transports:
            transport.publish(round(self.time * 1e9), _messages(found))
        for number in np.flatnonzero(found.alarm).tolist():
            # Do not report an alarm shortly after another alarm of the same joint, since a torque at the threshold causes many
            # alarms.
            if self.time - self._alarm_ends[number] > QUIET:
                self.alarms += 1
                self._tell(f"{self.time:.3f} s: alarm at {self._twin.joints[number]}")
            self._alarm_ends[number] = self.time
        for note in found.notes:
            self._tell(note)


def _values(message: Received, names: Iterable[str]) -> Array:
    """Values of a JointState message in the order of the given names; NaN for a name that the message lacks."""
    known = dict(zip(message.names or (), message.values, strict=False))
    return np.array([known.get(name, math.nan) for name in names])


def _messages(found: TwinStep) -> list[bytes]:
    table = np.column_stack([getattr(found, field) for field in FIELDS]).astype(float)
    return [FLOAT64.pack(b"\0\1\0\0", value) for value in table.ravel().tolist()]
