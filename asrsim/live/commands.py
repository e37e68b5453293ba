"""Checks of commands from other programs. A message is accepted if its values are finite, if their number is right, and if
their joints are known; all other messages are refused and counted.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from asrsim.live.publisher import CONTROL, STIFFNESS_JOINT, Ranges, reference_names
from asrsim.live.transport import LiveTopic, Received, TellUser, prefix_of
from asrsim.log.topics import topic_paths
from asrsim.robot.findings import LARGEST_NUMBER
from asrsim.samples import JointInfo
from asrsim.simulation.drives import EXTERNAL_TORQUE
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.worlds import Worlds

Target = tuple[str, str]
"""Name of a joint and name of one of its references."""
MOST_NOTICES = 100
"""Largest number of distinct refusals that are reported and counted separately."""


@dataclass(frozen=True)
class Trajectory:
    """Trajectory of a reference, starting at the arrival of its message."""

    times: Sequence[float]
    values: Sequence[float]
    velocities: Sequence[float]
    """Velocities at the points; empty: linear interpolation between the points."""

    def curve(self, start: float) -> Callable[[float], float]:
        """Function that returns the value at a time in s; start: value before the first point."""
        times, values, velocities = self.times, self.values, self.velocities
        if times[0] > 0.0:
            times, values, velocities = [0.0, *times], [start, *values], [0.0, *velocities] if velocities else ()

        def value(time: float) -> float:
            after = bisect_right(times, time)
            if after in (0, len(times)):
                return values[0 if after == 0 else -1]
            # Divide only the elapsed time by the interval between the points, so that values stay finite for tiny intervals.
            length, rise = times[after] - times[after - 1], values[after] - values[after - 1]
            share = (time - times[after - 1]) / length
            if not velocities:
                return values[after - 1] + share * rise
            slopes = (1.0 - share) * velocities[after - 1], share * velocities[after]
            bend = (1.0 - share) * slopes[0] - share * slopes[1]
            return values[after - 1] + share * share * (3.0 - 2.0 * share) * rise + share * length * bend

        return value


_Input = tuple[LiveTopic, Mapping[str, Target | None]]
"""Input topic, and the references that its values set: by name, or in the order of the values if the message type (std_msgs)
has no names.
"""


class CommandInput:
    """Input topics of a robot and the checks of their messages."""

    def __init__(
        self, joints: Sequence[JointInfo], ranges: Ranges, tell: TellUser = lambda text: None, *, prefix: str = ""
    ) -> None:
        """tell: function that receives one sentence for each kind of refusal."""
        self._ranges, self._tell = ranges, tell
        self._inputs = tuple(_inputs(joints, ranges, prefix))
        self.inlets = tuple(topic for topic, _ in self._inputs)
        self.taken = 0
        """Number of accepted values."""
        self.refused: Counter[str] = Counter()
        """Number of dropped messages or values for each reason."""
        self.clamped: Counter[str] = Counter()
        """Number of values clamped to their range, for each `joint.reference`."""
        self._motions: dict[Target, tuple[Callable[[float], float], float, float]] = {}
        """Value over time of each running trajectory (a function), arrival time of the trajectory, and its duration."""

    def listen(
        self, messages: Iterable[Received], simulation: Simulation | Worlds, time: float, ahead: float
    ) -> dict[Target, float]:
        """New values of references: the last received value, or the value of a trajectory `ahead` s after `time`."""
        values: dict[Target, float] = {}
        for message in messages:
            for target, value in self.check(message):
                self._motions.pop(target, None)
                if isinstance(value, Trajectory):
                    joint, column = simulation.prepared.slot_of(*target)
                    present = simulation.read([f"reference_{column}"])[f"reference_{column}"]
                    # In a run of several worlds, start the trajectory at the reference of the first world.
                    self._motions[target] = value.curve(float(present.ravel()[joint])), time, value.times[-1]
                else:
                    values[target] = value
        for target, (curve, began, duration) in list(self._motions.items()):
            elapsed = time + ahead - began
            values[target] = self._clamp(target, curve(elapsed))
            if elapsed >= duration:
                del self._motions[target]
        return values

    def check(self, received: Received) -> list[tuple[Target, float | Trajectory]]:
        """Accepted values of a message, clamped to their ranges, or the motions of a trajectory."""
        (topic, known), names = self._inputs[received.inlet], received.names
        points = received.points or [(0.0, received.values, ())]
        times = [time for time, _, _ in points]
        targets = [*known.values()] if names is None else [known.get(name) for name in names]
        counts = {len(row) for _, row, _ in points}
        fault = received.fault
        if not fault and (names is None) != topic.message.startswith("std_msgs/"):
            fault = f"a message that is not a {topic.message}"
        elif not fault and counts != {len(targets)}:
            fault = f"{max(counts)} values where {len(targets)} are expected"
        elif not fault and not (times[0] >= 0.0 and all(a < b for a, b in pairwise(times)) and times[-1] <= LARGEST_NUMBER):
            fault = "points that are not in the order of time"
        if fault:
            self._refuse(topic, fault)
            return []
        found: list[tuple[Target, float | Trajectory]] = []
        for j, target in enumerate(targets):
            values = [row[j] for _, row, _ in points]
            velocities = [row[j] for *_, row in points if len(row) == len(targets)]
            if target is None:
                if names is not None:
                    self._refuse(topic, "a command for a joint that takes none on this topic")
            elif names is not None and not received.points and math.isnan(values[0]):
                # Controllers send NaN for joints that they do not command. Leave out these values without a notice.
                continue
            elif not all(map(math.isfinite, (*values, *velocities))):
                self._refuse(topic, "a value that is not finite")
            elif received.points and max(map(abs, (*values, *velocities))) > LARGEST_NUMBER:
                self._refuse(topic, f"a value larger than {LARGEST_NUMBER:g}, too large for a robot")
            else:
                self.taken += 1
                moving = velocities if len(velocities) == len(times) else ()
                found.append((target, Trajectory(times, values, moving) if received.points else self._clamp(target, values[0])))
        return found

    def _clamp(self, target: Target, value: float) -> float:
        """Value clamped to the range of its reference; clamped values are counted."""
        low, high = self._ranges[target[0]][target[1]]
        if not low <= value <= high:
            key = ".".join(target)
            self.clamped[key] += 1
            if self.clamped[key] == 1:
                self._tell(
                    f"{key}: {value:.6g} is outside {low:.6g} to {high:.6g}: clamped; later values outside are only counted"
                )
        return min(max(value, low), high)

    def _refuse(self, topic: LiveTopic, why: str) -> None:
        text = f"{topic.name}: {why}"
        # Limit the memory that messages from other programs may take.
        if text not in self.refused and len(self.refused) >= MOST_NOTICES:
            text = "others"
        self.refused[text] += 1
        if self.refused[text] == 1:
            self._tell(f"{text}: dropped; further messages are only counted")


def _inputs(joints: Sequence[JointInfo], ranges: Ranges, prefix: str) -> Iterator[_Input]:
    named: dict[str, Target | None] = {}
    arrays: dict[str, dict[str, Target | None]] = {}
    """References in each of the toolbox's arrays, by joint."""
    for joint, path in zip(joints, topic_paths(joints), strict=True):
        own = ranges.get(joint.name, {})
        targets = [(joint.name, name) for name in own if name != EXTERNAL_TORQUE]
        topics = dict(zip(reference_names(joint), targets, strict=False))
        if joint.mode == 4:
            # In mode 4, also accept the topic names in the released code of the toolbox, which differ from the topic names in
            # the paper.
            topics |= {f"torque_m{number}_command": target for number, target in enumerate(targets, start=1)}
        if EXTERNAL_TORQUE in own:
            topics[EXTERNAL_TORQUE] = joint.name, EXTERNAL_TORQUE
        for name, target in topics.items():
            yield LiveTopic(f"{prefix}{path}/{name}", "std_msgs/Float64"), {joint.name: target}
        if targets:
            named[joint.name] = targets[0]
            if targets[-1][1] == "stiffness_preset":
                named[joint.name + STIFFNESS_JOINT] = targets[-1]
        for number in (0, 1) if joint.mode is not None else ():
            name = f"{prefix}{prefix_of(joint.namespace)}/reference_{number + 1}"
            arrays.setdefault(name, {})[joint.name] = targets[number] if number < len(targets) else None
    for name, members in arrays.items():
        if any(members.values()):
            yield LiveTopic(name, "std_msgs/Float64MultiArray"), members
    if named:
        yield LiveTopic(f"{prefix}{CONTROL}/joint_commands", "sensor_msgs/JointState"), named
        yield LiveTopic(f"{prefix}/joint_trajectory", "trajectory_msgs/JointTrajectory"), named
