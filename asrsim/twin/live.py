"""A twin beside a robot in real time: its topics of commands and joint states in, torques, stiffness and alarms out."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np

from asrsim.live.commands import CommandInput, Motion, Target
from asrsim.live.pace import Pace
from asrsim.live.transport import TRANSPORTS, Access, Inlet, Interface, Outlet, Received, Transport
from asrsim.scenario.data import Scenario
from asrsim.simulation.ranges import ranges_of, with_ranges
from asrsim.twin.twin import Twin, TwinStep

OUT = ("external_torque", "stiffness", "residual", "alarm")
"""Fields of a step that are published for each joint, as std_msgs/Float64."""
FLOAT64 = struct.Struct("<4sd")
"""CDR of a std_msgs/Float64, behind its four bytes of encapsulation."""
STALE = 0.1
"""s after which a position counts no more."""


class LiveTwin:
    """One twin; :meth:`run` until it is stopped. `tell` takes sentences for the user."""

    def __init__(
        self, scenario: Scenario, *, bandwidth: float = 8.0, transports: Sequence[str] = (), access: Access | None = None,
        namespace: str = "", duration: float | None = None, tell: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        """transports, access, namespace: as of a live run's settings; duration: s, None: until it is stopped."""
        prepared = with_ranges(scenario)
        prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self._twin, self._step, self._duration, self._tell = Twin(prepared, bandwidth=bandwidth), scenario.step, duration, tell
        self._commands = CommandInput(prepared.info.joints, ranges_of(prepared), prefix=prefix)
        self.source = f"{prefix}/joint_states"
        """Topic of the robot's positions."""
        self.interface = Interface(
            node=f"{prefix}/asrsim_twin",
            outlets=tuple(
                Outlet(f"{prefix}/twin/{joint}/{field}", "std_msgs/Float64") for joint in self._twin.joints for field in OUT
            ),
            inlets=(*self._commands.inlets, Inlet(self.source, "sensor_msgs/JointState")),
            latched={}, services={},
        )  # fmt: skip
        self._names, self._access = transports, access or Access()
        self._transports: list[Transport] = []
        self._positions = np.full(len(self._twin.joints), np.nan)
        self._seen = np.full(len(self._twin.joints), -np.inf)
        """s at which each joint's position came."""
        self._motions: dict[Target, tuple[Callable[[float], float], float]] = {}
        """Reference over the time since a trajectory came, and s at which it came."""
        self._last: dict[Target, float] = {}
        """Commands that hold."""
        self.alarms = 0
        self.steps = 0

    @property
    def time(self) -> float:
        """s since the start."""
        return self.steps * self._step

    def run(self, *, stop: Callable[[], bool]) -> None:
        """Follow the robot until `stop` returns True, or the duration ends. Raises InputError where a transport is missing."""
        pace, alarm = Pace(1.0), np.zeros(len(self._positions), dtype=bool)
        with ExitStack() as stack:
            stack.callback(self._twin.close)
            for name in self._names:
                transport = TRANSPORTS.get(name).make(self.interface, self._access)
                stack.callback(transport.close)
                self._transports.append(transport)
                self._tell(f"{name}: {transport.where}")
            self._tell(f"waiting for positions on {self.source}")
            while not stop() and (self._duration is None or self.time < self._duration):
                if pace.wait(self._step) is None:
                    continue
                orders = self._listen()
                self.steps += 1
                if not np.isfinite(self._positions).any():
                    continue
                measured = np.where(self.time - self._seen > STALE, np.nan, self._positions)
                found = self._twin.step(measured, orders)
                self._publish(found)
                for joint in np.flatnonzero(found.alarm & ~alarm).tolist():
                    self.alarms += 1
                    self._tell(f"{self.time:.3f} s: alarm at {self._twin.joints[joint]}")
                alarm = found.alarm
                for note in (*found.notes, *self._notices()):
                    self._tell(note)

    def _listen(self) -> dict[str, dict[str, float]]:
        """Commands that came, by joint and reference; positions are kept."""
        wanted: dict[Target, float] = {}
        for transport in self._transports:
            for message in transport.poll():
                if message.inlet == len(self._commands.inlets):
                    self._measure(message)
                    continue
                for target, value in self._commands.check(message):
                    self._motions.pop(target, None)
                    if isinstance(value, Motion):
                        self._motions[target] = value.curve(self._last.get(target, value.values[0])), self.time
                    else:
                        wanted[target] = value
        for target, (curve, began) in self._motions.items():
            wanted[target] = self._commands.clamp(target, curve(self.time + self._step - began))
        self._last |= wanted
        orders: dict[str, dict[str, float]] = {}
        for (joint, reference), value in wanted.items():
            orders.setdefault(joint, {})[reference] = value
        return orders

    def _measure(self, message: Received) -> None:
        for name, value in zip(message.names or (), message.values, strict=False):
            if name in self._twin.joints and math.isfinite(value):
                joint = self._twin.joints.index(name)
                self._positions[joint], self._seen[joint] = value, self.time

    def _publish(self, found: TwinStep) -> None:
        table = np.column_stack([getattr(found, field) for field in OUT]).astype(float)
        messages = [FLOAT64.pack(b"\0\1\0\0", value) for value in table.ravel().tolist()]
        for transport in self._transports:
            transport.publish(round(self.time * 1e9), messages)

    def _notices(self) -> list[str]:
        found: list[str] = []
        for notices in (self._commands.notices, *(transport.notices for transport in self._transports)):
            found += notices
            notices.clear()
        return found
