"""The starter's motion of each joint: where it begins, where its step goes, and the references that ask for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.electric import electric_of
from asrsim.quantities import linear_unit
from asrsim.robot import ActuatorBlock, Joint, Robot

STEP = 0.3
"""rad, the step of the starter's references."""
PRISMATIC_STEP = 0.05
"""m."""
TORQUE = 0.1
"""N m, for references that are torques."""
STEP_TIME = 0.1
"""s."""

_ROOM = 0.4
"""Share of the way to a stop that a step takes at most."""


@dataclass(frozen=True, kw_only=True)
class StarterJoint:
    """One joint of the starter."""

    block: ActuatorBlock
    joint: Joint
    start: float
    """Initial link position, rad or m: 0, or the nearest that is away from the stops."""
    target: float
    """Link position after the step."""

    @property
    def actuator(self) -> type[Actuator]:
        """Class of the actuator."""
        return ACTUATORS.get(self.block.actuator)

    def presets(self) -> tuple[float, float] | None:
        """A soft and a stiff second reference, or None where there is no choice."""
        soft = self.actuator.typical_preset
        if not soft or not MODES[self.block.mode].spring or MODES[self.block.mode].direct:
            return None
        values = self.block.values()
        highest = 0.6 * values["lever_length"] if "lever_length" in values else 0.75 * values.get("max_deflection", 4.0 * soft)
        stiff = min(3.0 * soft, highest)
        # Springs pull on their motors also at rest; half of the motors' torque is left to move with.
        while MODES[self.block.mode].motor and self._pull(stiff) > 0.5:
            stiff *= 0.9
        return float(f"{min(soft, 0.5 * stiff):.2g}"), float(f"{stiff:.2g}")

    def _pull(self, preset: float) -> float:
        """What the springs ask of the motors at rest, as a share of their largest torque."""
        values = self.block.values()
        law = self.actuator.law_values(values)
        torques = self.actuator.elastic_torques(0.0, *self.actuator.motor_references(0.0, preset), law)
        limits = (values[f"motor_{i}_max_torque"] for i in range(1, self.actuator.motors + 1))
        return max(abs(torque) / limit if limit > 0.0 else 0.0 for torque, limit in zip(torques, limits, strict=False))

    def levels(self, position: float, torque: float, preset: float) -> Iterator[tuple[str, str, float]]:
        """(reference, unit, value) that hold the joint at a position, or its motors at a torque.

        preset: a second reference in the sense of preset or adjuster.
        """
        mode = MODES[self.block.mode]
        second = self.actuator.motors > 1 or self.actuator.adjuster
        if not mode.spring:
            yield mode.references[0], mode.units[0], torque if mode.number == 0 else position
        elif mode.direct:
            gains = [electric_of(self.block.values(), i, mode).gain or 1.0 for i in range(1, self.actuator.motors + 1)]
            yield mode.references[0], mode.units[0], torque / gains[0]
            if self.actuator.adjuster:
                yield mode.references[1], self.actuator.reference_2_unit, preset
            elif second:
                yield mode.references[1], mode.units[1], torque / gains[1]
        elif mode.mapped or self.actuator.adjuster or not second:
            yield mode.references[0], "rad", position
            if second:
                yield mode.references[1], self.actuator.reference_2_unit, preset
        else:
            motors = self.actuator.motor_references(position, preset)
            yield from zip(mode.references, ("rad", "rad"), motors, strict=True)

    def references(self, preset: float) -> Iterator[tuple[str, str, str]]:
        """(reference, unit, signal as YAML) of the starter's step."""
        before, after = self.levels(self.start, 0.0, preset), self.levels(self.target, TORQUE, preset)
        for (name, unit, low), (_, _, high) in zip(before, after, strict=True):
            if self.joint.kind == "prismatic":
                unit = linear_unit(unit)
            yield name, unit, number(low) if low == high else _step(low, high)


def starter_joint(robot: Robot, block: ActuatorBlock) -> StarterJoint:
    """The starter's motion of an actuated joint: from 0 or the nearest away from its stops, by a small step; of one that is
    to follow another, what that one's motion asks of it."""
    joint = robot.joint(block.joint)
    leader = next((one for one in robot.actuators if joint.mimic is not None and one.joint == joint.mimic.joint), None)
    if joint.mimic is not None and leader is not None and robot.joint(leader.joint).mimic is None:
        led = starter_joint(robot, leader)
        start, target = (joint.mimic.multiplier * place + joint.mimic.offset for place in (led.start, led.target))
        return StarterJoint(block=block, joint=joint, start=start, target=target)
    size = PRISMATIC_STEP if joint.kind == "prismatic" else STEP
    bounded = joint.lower is not None and joint.upper is not None and joint.lower < joint.upper
    low, high = (joint.lower or 0.0, joint.upper or 0.0) if bounded else (-10.0, 10.0)
    start = _start(low, high, size)
    # A soft joint without damping swings to twice its step: that is no stop.
    up, down = high - start, start - low
    upward = up > 2.0 * size or up >= down
    step = min(size, _ROOM * max(up, down))
    target = float(f"{start + (step if upward else -step):.6g}")
    return StarterJoint(block=block, joint=joint, start=start, target=target)


def _start(low: float, high: float, size: float) -> float:
    """0, or the nearest that is a step away from both stops; of a short travel, a quarter of it."""
    margin = min(size, 0.25 * (high - low))
    start = min(max(0.0, low + margin), high - margin)
    rounded = float(f"{start:.3g}")
    return rounded if low < rounded < high else start


def _step(before: float, after: float) -> str:
    return f"{{step: {{at: {STEP_TIME:g}, from: {number(before)}, to: {number(after)}}}}}"


def number(value: float) -> str:
    """A number as YAML, to six digits."""
    return f"{value + 0.0:.6g}"
