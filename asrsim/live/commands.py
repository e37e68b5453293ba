"""Checks of commands from other programs: accepts finite numbers of the right count for known joints, and counts all others."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from asrsim.live.publisher import CONTROL, STIFFNESS_JOINT, reference_names
from asrsim.live.transport import Inlet, Received
from asrsim.log.topics import topic_paths
from asrsim.samples import JointInfo
from asrsim.simulation.quantities import EXTERNAL_TORQUE
from asrsim.simulation.ranges import Range
from asrsim.simulation.simulation import Simulation
from asrsim.simulation.worlds import Worlds

Target = tuple[str, str]
"""Name of a joint and name of one of its references."""
MOST_NOTICES = 100
"""Largest number of distinct refusals that are reported and counted separately."""


@dataclass(frozen=True)
class Motion:
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
        if not velocities or len(times) == 1:
            return lambda time: float(np.interp(time, times, values))
        from scipy.interpolate import CubicHermiteSpline

        spline = CubicHermiteSpline(times, values, velocities)
        return lambda time: float(spline(min(time, times[-1])))


@dataclass(frozen=True)
class _Input:
    """Input topic and the references that its values set, assigned by position or by name."""

    inlet: Inlet
    places: tuple[Target | None, ...] = ()
    names: Mapping[str, Target] = field(default_factory=dict)


class CommandInput:
    """Input topics of a robot and the checks of their messages."""

    def __init__(self, joints: Sequence[JointInfo], ranges: Mapping[str, Mapping[str, Range]], *, prefix: str = "") -> None:
        """ranges: permitted range of each reference of each joint; references without a range cannot be set."""
        self._ranges = ranges
        self._inputs = tuple(_inputs(joints, ranges, prefix))
        self.inlets = tuple(one.inlet for one in self._inputs)
        self.taken = 0
        """Number of accepted values."""
        self.refused: Counter[str] = Counter()
        """Number of dropped messages or values for each reason."""
        self.clamped: Counter[str] = Counter()
        """Number of values clamped to their range, for each `joint.reference`."""
        self.notices: list[str] = []
        """Messages for the user, one per kind of refusal; the live run shows the messages and empties the list."""
        self.motions: dict[Target, tuple[Callable[[float], float], float, float]] = {}
        """Value over time of each running trajectory (a function), arrival time of the trajectory, and its duration."""

    def listen(
        self, messages: Iterable[Received], simulation: Simulation | Worlds, time: float, ahead: float
    ) -> dict[Target, float]:  # fmt: skip
        """New values of references: the last received value, or the value of a trajectory `ahead` s after `time`."""
        values: dict[Target, float] = {}
        for message in messages:
            for target, value in self.check(message):
                self.motions.pop(target, None)
                if isinstance(value, Motion):
                    self.motions[target] = value.curve(_present(simulation, target)), time, value.times[-1]
                else:
                    values[target] = value
        for target, (curve, began, duration) in list(self.motions.items()):
            elapsed = time + ahead - began
            values[target] = self.clamp(target, curve(elapsed))
            if elapsed >= duration:
                del self.motions[target]
        return values

    def check(self, received: Received) -> list[tuple[Target, float | Motion]]:
        """Accepted values of a message, clamped to their ranges, or the motions of a trajectory."""
        one, names, fault = self._inputs[received.inlet], received.names, received.fault
        points = received.points or [(0.0, received.values, ())]
        times = [time for time, _, _ in points]
        width = len(one.places if names is None else names)
        counts = {len(row) for _, row, _ in points}
        if not fault and counts != {width}:
            fault = f"{max(counts)} values where {width} are expected"
        elif not fault and not (times[0] >= 0.0 and all(a < b for a, b in pairwise(times)) and times[-1] < math.inf):
            fault = "points that are not in the order of time"
        if fault:
            self._refuse(one.inlet.name, fault)
            return []
        found: list[tuple[Target, float | Motion]] = []
        for j, target in enumerate(one.places if names is None else [self._named(one, name) for name in names]):
            values = [row[j] for _, row, _ in points]
            velocities = [row[j] for *_, row in points if len(row) == width]
            # Controllers send NaN for joints that they do not command.
            if target is None or (names is not None and not received.points and math.isnan(values[0])):
                continue
            if not all(map(math.isfinite, (*values, *velocities))):
                self._refuse(one.inlet.name, "a value that is not finite")
                continue
            self.taken += 1
            moving = velocities if len(velocities) == len(times) else ()
            found.append((target, Motion(times, values, moving) if received.points else self.clamp(target, values[0])))
        return found

    def clamp(self, target: Target, value: float) -> float:
        """Value clamped to the range of its reference; clamped values are counted."""
        low, high = self._ranges[target[0]][target[1]]
        if not low <= value <= high:
            key = ".".join(target)
            self.clamped[key] += 1
            if self.clamped[key] == 1:
                self.notices.append(
                    f"{key}: {value:.6g} is outside {low:.6g} to {high:.6g}: clamped; later ones are only counted"
                )
        return min(max(value, low), high)

    def _named(self, one: _Input, name: str) -> Target | None:
        if name not in one.names:
            self._refuse(one.inlet.name, "a joint that does not take commands there")
        return one.names.get(name)

    def _refuse(self, topic: str, why: str) -> None:
        text = f"{topic}: {why}"
        # Limit the memory that messages from other programs may take.
        if text not in self.refused and len(self.refused) >= MOST_NOTICES:
            text = "others"
        self.refused[text] += 1
        if self.refused[text] == 1:
            self.notices.append(f"{text}: dropped; further ones are only counted")


def _present(simulation: Simulation | Worlds, target: Target) -> float:
    """Present value of a reference in the simulation, or in the first of several worlds."""
    joint, column = simulation.prepared.slot_of(*target)
    name = f"reference_{column}"
    return float(simulation.read([name])[name].ravel()[joint])


def _inputs(joints: Sequence[JointInfo], ranges: Mapping[str, Mapping[str, Range]], prefix: str) -> Iterator[_Input]:
    named: dict[str, Target] = {}
    own = {joint.name: [name for name in ranges.get(joint.name, {}) if name != EXTERNAL_TORQUE] for joint in joints}
    for joint, path in zip(joints, topic_paths(joints), strict=True):
        references = own[joint.name]
        topics = dict(zip(reference_names(joint), references, strict=False))
        if joint.mode == 4:
            # Topic names in the released code of the toolbox, in addition to the topic names in the paper.
            topics |= {f"torque_m{number}_command": reference for number, reference in enumerate(references, start=1)}
        if EXTERNAL_TORQUE in ranges.get(joint.name, {}):
            topics[EXTERNAL_TORQUE] = EXTERNAL_TORQUE
        for name, reference in topics.items():
            yield _Input(Inlet(f"{prefix}{path}/{name}", "std_msgs/Float64"), ((joint.name, reference),))
        if references:
            named[joint.name] = (joint.name, references[0])
            if references[-1] == "stiffness_preset":
                named[joint.name + STIFFNESS_JOINT] = (joint.name, references[-1])
    for namespace in dict.fromkeys(joint.namespace for joint in joints):
        members = [own[joint.name] for joint in joints if joint.namespace == namespace and joint.mode is not None]
        owners = [joint.name for joint in joints if joint.namespace == namespace and joint.mode is not None]
        path = f"{prefix}/{namespace.strip('/')}".rstrip("/")
        for slot in (0, 1):
            places = tuple((name, one[slot]) if slot < len(one) else None for name, one in zip(owners, members, strict=True))
            if any(places):
                yield _Input(Inlet(f"{path}/reference_{slot + 1}", "std_msgs/Float64MultiArray"), places)
    if named:
        yield _Input(Inlet(f"{prefix}{CONTROL}/joint_commands", "sensor_msgs/JointState"), names=named)
        yield _Input(Inlet(f"{prefix}/joint_trajectory", "trajectory_msgs/JointTrajectory"), names=named)
