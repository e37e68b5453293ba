"""Commands from outside, checked: known joints, finite numbers and right lengths get through; everything else is counted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

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

    def at(self, time: float, start: float) -> float:
        """The value at `time` s; start: the value before the first point."""
        times, values = [0.0, *self.times][self.times[0] <= 0.0 :], [start, *self.values][self.times[0] <= 0.0 :]
        if time >= times[-1] or len(times) == 1:
            return values[-1]
        if not self.velocities:
            return float(np.interp(time, times, values))
        from scipy.interpolate import CubicHermiteSpline

        slopes = [0.0, *self.velocities][-len(times) :]
        return float(CubicHermiteSpline(times, values, slopes)(time))


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
        one = self._inputs[received.inlet]
        fault, pairs = received.fault, list(zip(one.places, received.values, strict=False))
        if fault:
            pass
        elif received.points:
            return self._motions(one, received)
        elif received.names is None:
            if len(received.values) != len(one.places):
                fault = f"{len(received.values)} values where {len(one.places)} are expected"
        elif len(received.names) != len(received.values):
            fault = "not as many values as names"
        else:
            named = zip(received.names, received.values, strict=True)
            # A controller leaves joints that it does not command as NaN.
            pairs = [(self._named(one, name), value) for name, value in named if not (name in one.names and math.isnan(value))]
        if fault:
            self._refuse(one.inlet.name, fault)
            return []
        found: list[tuple[Target, float | Motion]] = []
        for target, value in pairs:
            if target is not None and math.isfinite(value):
                self.taken += 1
                found.append((target, self.clamp(target, float(value))))
            elif target is not None:
                self._refuse(one.inlet.name, "a value that is not finite")
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

    def _motions(self, one: _Input, received: Received) -> list[tuple[Target, float | Motion]]:
        names = received.names or ()
        times = [time for time, _, _ in received.points]
        rows = [positions for _, positions, _ in received.points]
        slopes = [velocities for _, _, velocities in received.points]
        moving = all(len(row) == len(names) for row in slopes)
        numbers = np.array([number for row in (times, *rows, *(slopes if moving else ())) for number in row])
        if any(len(row) != len(names) for row in rows):
            self._refuse(one.inlet.name, "a point without a position for each joint")
        elif not np.isfinite(numbers).all() or times[0] < 0.0 or (np.diff(times) <= 0.0).any():
            self._refuse(one.inlet.name, "points that are not finite, or not in the order of time")
        else:
            targets = [self._named(one, name) for name in names]
            self.taken += len(targets) - targets.count(None)
            slopes = slopes if moving else [()] * len(times)
            motions = [Motion(times, [row[j] for row in rows], [row[j] for row in slopes if row]) for j in range(len(names))]
            return [(target, motion) for target, motion in zip(targets, motions, strict=True) if target is not None]
        return []

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
