"""Twin beside a robot in real time: reads its topics of commands and joint states; publishes torques, stiffness and alarms."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack

import numpy as np

from asrsim.live.commands import CommandInput
from asrsim.live.pace import Pace
from asrsim.live.transport import Access, Inlet, Interface, Outlet, Received, Transport, opened, publish, report
from asrsim.scenario.data import Scenario
from asrsim.simulation.ranges import ranges_of, with_ranges
from asrsim.twin.twin import Twin, TwinStep

FIELDS = ("external_torque", "stiffness", "residual", "alarm")
"""Fields of a step that are published for each joint, as std_msgs/Float64."""
FLOAT64 = struct.Struct("<4sd")
"""CDR of a std_msgs/Float64: encapsulation and value."""
STALE = 0.1
"""Age from which a received position is ignored, s."""


class LiveTwin:
    """Twin that follows a robot; `run` executes it. `tell` receives sentences for the user."""

    def __init__(
        self, scenario: Scenario, *, bandwidth: float = 8.0, transports: Sequence[str] = (), access: Access | None = None,
        namespace: str = "", duration: float | None = None, tell: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        """transports, access, namespace: as in `asrsim.live.session.Settings`; duration: in s, None: until stopped."""
        prepared = with_ranges(scenario)
        prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
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
        n = len(self._twin.joints)
        self._positions, self._received_at = np.full(n, np.nan), np.full(n, -np.inf)
        """Last position of each joint, and the time at which it was received, s."""
        self.alarms = self.steps = 0

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.steps * self._step

    def run(self, *, stop: Callable[[], bool]) -> None:
        """Follow the robot until `stop` returns True or the duration is over. Raises InputError if a transport is missing."""
        pace, alarm = Pace(1.0), np.zeros(len(self._positions), dtype=bool)
        with ExitStack() as stack:
            stack.callback(self._twin.close)
            transports = stack.enter_context(opened(self._names, self.interface, self._access, self._tell))
            self._tell(f"waiting for positions on {self.interface.inlets[-1].name}")
            while not stop() and (self._duration is None or self.time < self._duration):
                if pace.wait(self._step) is None:
                    continue
                commands: dict[str, dict[str, float]] = {}
                received = self._without_positions(transports)
                for (joint, reference), value in self._commands.listen(
                    received, self._twin.simulation, self.time, self._step
                ).items():
                    commands.setdefault(joint, {})[reference] = value
                self.steps += 1
                if not np.isfinite(self._positions).any():
                    continue
                found = self._twin.step(np.where(self.time - self._received_at > STALE, np.nan, self._positions), commands)
                publish(transports, round(self.time * 1e9), _messages(found))
                for joint_number in np.flatnonzero(found.alarm & ~alarm).tolist():
                    self.alarms += 1
                    self._tell(f"{self.time:.3f} s: alarm at {self._twin.joints[joint_number]}")
                alarm = found.alarm
                report(self._tell, [*found.notes], [])
                report(self._tell, self._commands.notices, transports)

    def _without_positions(self, transports: Sequence[Transport]) -> Iterator[Received]:
        """Messages with commands; positions among the messages are kept."""
        for transport in transports:
            for message in transport.poll():
                if message.inlet < len(self._commands.inlets):
                    yield message
                    continue
                for name, value in zip(message.names or (), message.values, strict=False):
                    if name in self._twin.joints and math.isfinite(value):
                        joint = self._twin.joints.index(name)
                        self._positions[joint], self._received_at[joint] = value, self.time


def _messages(found: TwinStep) -> list[bytes]:
    table = np.column_stack([getattr(found, field) for field in FIELDS]).astype(float)
    return [FLOAT64.pack(b"\0\1\0\0", value) for value in table.ravel().tolist()]
