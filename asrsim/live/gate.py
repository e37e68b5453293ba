"""What comes from outside, checked: only known joints, finite numbers and right lengths get through; all else is counted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from asrsim.live.board import CONTROL, STIFFNESS_JOINT, reference_names
from asrsim.live.transport import Inlet, Received
from asrsim.log.topics import topic_paths
from asrsim.samples import JointInfo
from asrsim.simulation.prepared import EXTERNAL_TORQUE
from asrsim.simulation.ranges import Range

Target = tuple[str, str]
"""Joint and reference."""
MOST_NOTICES = 100
"""Different refusals that are said; more are only counted."""


@dataclass(frozen=True)
class _Listener:
    """An inlet and where its values go: by place, or by name."""

    inlet: Inlet
    places: tuple[Target | None, ...] = ()
    names: Mapping[str, Target] = field(default_factory=dict)


class Gate:
    """The inlets of a robot, and the checks behind them."""

    def __init__(self, joints: Sequence[JointInfo], ranges: Mapping[str, Mapping[str, Range]], *, prefix: str = "") -> None:
        """ranges: joint -> reference -> what may be set; others may not."""
        self._ranges = ranges
        self._listeners = tuple(_listeners(joints, ranges, prefix))
        self.inlets = tuple(listener.inlet for listener in self._listeners)
        self.taken = 0
        """Values that got through."""
        self.refused: Counter[str] = Counter()
        """Why values were dropped -> how often."""
        self.clamped: Counter[str] = Counter()
        """joint.reference -> values that were beyond their range."""
        self.notices: list[str] = []
        """Sentences to be said, each kind once; whoever says them takes them away."""
        self._said: set[str] = set()

    def check(self, received: Received) -> list[tuple[Target, float]]:
        """The values of a message that may be set, clamped to their ranges."""
        listener = self._listeners[received.inlet]
        fault = received.fault
        if not fault and received.names is None and len(received.values) != len(listener.places):
            fault = f"{len(received.values)} values where {len(listener.places)} are expected"
        if not fault and received.names is not None and len(received.names) != len(received.values):
            fault = "not as many values as names"
        if fault:
            self._refuse(listener.inlet.name, fault)
            return []
        found = []
        if received.names is None:
            pairs = list(zip(listener.places, received.values, strict=True))
        else:
            pairs = []
            for name, value in zip(received.names, received.values, strict=True):
                # What a controller does not command it leaves as NaN.
                if name not in listener.names:
                    self._refuse(listener.inlet.name, "a joint that does not take commands there")
                elif not math.isnan(value):
                    pairs.append((listener.names[name], value))
        for target, value in pairs:
            if target is None:
                continue
            if not math.isfinite(value):
                self._refuse(listener.inlet.name, "a value that is not finite")
                continue
            joint, reference = target
            low, high = self._ranges[joint][reference]
            if not low <= value <= high:
                key = f"{joint}.{reference}"
                if not self.clamped[key]:
                    self._say(f"{key}: {value:.6g} is outside {low:.6g} to {high:.6g}: clamped, as all that follow")
                self.clamped[key] += 1
                value = min(max(value, low), high)
            self.taken += 1
            found.append((target, float(value)))
        return found

    def _refuse(self, topic: str, why: str) -> None:
        text = f"{topic}: {why}"
        # What strangers send must not fill our memory.
        if text not in self.refused and len(self.refused) >= MOST_NOTICES:
            text = "others"
        if not self.refused[text]:
            self._say(f"{text}: dropped; more of the kind are counted only")
        self.refused[text] += 1

    def _say(self, text: str) -> None:
        if len(self._said) < MOST_NOTICES:
            self._said.add(text)
            self.notices.append(text)


def _listeners(joints: Sequence[JointInfo], ranges: Mapping[str, Mapping[str, Range]], prefix: str) -> list[_Listener]:
    found: list[_Listener] = []

    def single(name: str, target: Target) -> None:
        if target[1] in ranges.get(target[0], {}):
            found.append(_Listener(Inlet(prefix + name, "std_msgs/Float64"), (target,)))

    positions: dict[str, Target] = {}
    for joint, path in zip(joints, topic_paths(joints), strict=True):
        own = [name for name in ranges.get(joint.name, {}) if name != EXTERNAL_TORQUE]
        for name, reference in zip(reference_names(joint), own, strict=False):
            single(f"{path}/{name}", (joint.name, reference))
        if joint.mode == 4:
            # The paper's names are above; these are the released code's.
            for number, reference in enumerate(own, start=1):
                single(f"{path}/torque_m{number}_command", (joint.name, reference))
        single(f"{path}/{EXTERNAL_TORQUE}", (joint.name, EXTERNAL_TORQUE))
        if own:
            positions[joint.name] = (joint.name, own[0])
            if own[-1] == "stiffness_preset":
                positions[joint.name + STIFFNESS_JOINT] = (joint.name, own[-1])
    for namespace in dict.fromkeys(joint.namespace for joint in joints):
        members = [joint for joint in joints if joint.namespace == namespace and joint.mode is not None]
        for slot in (0, 1):
            places = tuple(_place(joint, slot, ranges) for joint in members)
            if any(place is not None for place in places):
                path = "/" + namespace.strip("/") if namespace.strip("/") else ""
                inlet = Inlet(f"{prefix}{path}/reference_{slot + 1}", "std_msgs/Float64MultiArray")
                found.append(_Listener(inlet, places))
    if positions:
        found.append(_Listener(Inlet(f"{prefix}{CONTROL}/joint_commands", "sensor_msgs/JointState"), names=positions))
    return found


def _place(joint: JointInfo, slot: int, ranges: Mapping[str, Mapping[str, Range]]) -> Target | None:
    own = [name for name in ranges.get(joint.name, {}) if name != EXTERNAL_TORQUE]
    return (joint.name, own[slot]) if slot < len(own) else None
