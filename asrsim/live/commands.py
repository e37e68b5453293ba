"""Commands from outside, checked: known joints, finite numbers and right lengths get through; everything else is counted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from asrsim.live.publisher import CONTROL, STIFFNESS_JOINT, reference_names
from asrsim.live.transport import Inlet, Received
from asrsim.log.topics import topic_paths
from asrsim.samples import JointInfo
from asrsim.simulation.prepared import EXTERNAL_TORQUE
from asrsim.simulation.ranges import Range

Target = tuple[str, str]
"""Joint and reference."""
MOST_NOTICES = 100
"""Different refusals that are told and counted by themselves."""


@dataclass(frozen=True)
class Motion:
    """Values of a reference over time, from the arrival of a trajectory on."""

    times: Sequence[float]
    values: Sequence[float]
    velocities: Sequence[float]
    """Empty: the values are joined by straight lines."""

    def curve(self, start: float) -> Callable[[float], float]:
        """Value at a time in s; start: the value before the first point."""
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
    """An inlet, and where its values go: by place, or by name."""

    inlet: Inlet
    places: tuple[Target | None, ...] = ()
    names: Mapping[str, Target] = field(default_factory=dict)


class CommandInput:
    """The inlets of a robot, and the checks of their messages."""

    def __init__(self, joints: Sequence[JointInfo], ranges: Mapping[str, Mapping[str, Range]], *, prefix: str = "") -> None:
        """ranges: joint -> reference -> range of what may be set; others may not be set."""
        self._ranges = ranges
        self._inputs = tuple(_inputs(joints, ranges, prefix))
        self.inlets = tuple(one.inlet for one in self._inputs)
        self.taken = 0
        """Values that got through."""
        self.refused: Counter[str] = Counter()
        """Reason -> dropped messages or values."""
        self.clamped: Counter[str] = Counter()
        """joint.reference -> values that were beyond their range."""
        self.notices: list[str] = []
        """Sentences for the user, each kind once; the reader takes them away."""

    def check(self, received: Received) -> list[tuple[Target, float | Motion]]:
        """The values of a message that may be set, clamped to their ranges, or the motions of a trajectory."""
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
            # A controller leaves joints that it does not command as NaN.
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
        """The value within its range; values beyond are counted."""
        low, high = self._ranges[target[0]][target[1]]
        if not low <= value <= high:
            key = ".".join(target)
            self.clamped[key] += 1
            if self.clamped[key] == 1:
                self.notices.append(f"{key}: {value:.6g} is outside {low:.6g} to {high:.6g}: clamped, as all that follow")
        return min(max(value, low), high)

    def _named(self, one: _Input, name: str) -> Target | None:
        if name not in one.names:
            self._refuse(one.inlet.name, "a joint that does not take commands there")
        return one.names.get(name)

    def _refuse(self, topic: str, why: str) -> None:
        text = f"{topic}: {why}"
        # Foreign messages must not fill our memory.
        if text not in self.refused and len(self.refused) >= MOST_NOTICES:
            text = "others"
        self.refused[text] += 1
        if self.refused[text] == 1:
            self.notices.append(f"{text}: dropped; more of the kind are counted only")


def _inputs(joints: Sequence[JointInfo], ranges: Mapping[str, Mapping[str, Range]], prefix: str) -> Iterator[_Input]:
    named: dict[str, Target] = {}
    own = {joint.name: [name for name in ranges.get(joint.name, {}) if name != EXTERNAL_TORQUE] for joint in joints}
    for joint, path in zip(joints, topic_paths(joints), strict=True):
        references = own[joint.name]
        topics = dict(zip(reference_names(joint), references, strict=False))
        if joint.mode == 4:
            # The released code's names, beside the paper's.
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
