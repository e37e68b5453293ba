"""Ranges of references that callers may set: those that the scenario declares, else the limits of the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence

from asrsim.actuators.electric import largest_command
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.quantities import EXTERNAL_TORQUE

TURN = math.pi
"""Range of a joint without limits in each direction, rad."""
LEVER_SHARE = 0.5
"""Largest position of an adjuster, as a fraction of the lever length at which the stiffness becomes infinite."""

Range = tuple[float, float]


def ranges_of(scenario: Scenario, drives: Sequence[SteppedJoint]) -> dict[str, dict[str, Range]]:
    """Smallest and largest value of each reference, by joint and reference: from the scenario, else from the robot's limits.
    External torques are included if the robot's file subscribes to them or the scenario declares their range.
    """
    found: dict[str, dict[str, Range]] = {}
    for drive in drives:
        declared = scenario.ranges_of(drive.name)
        own = {name: declared.get(name) or _default(drive, slot) for slot, name in enumerate(drive.acting_references)}
        if EXTERNAL_TORQUE in declared or (drive.block is not None and drive.block.subscribe_external_torque):
            own[EXTERNAL_TORQUE] = declared.get(EXTERNAL_TORQUE) or _torque(drive)
        found[drive.name] = own
    return found


def _default(drive: SteppedJoint, slot: int) -> Range:
    mode, actuator, values = drive.mode, drive.actuator, drive.values
    if mode is None or actuator is None or mode.number == 0:
        return _torque(drive)
    if slot == 1 and actuator.adjuster:
        return 0.0, LEVER_SHARE * values.get("lever_length", math.inf)
    if mode.direct:
        most = largest_command(values, slot + 1, mode)
        return -most, most
    spread = values.get("max_deflection", 0.0) if mode.spring else 0.0
    if slot == 1 and mode.mapped:
        return -spread, spread
    joint = drive.joint
    low = -TURN if joint.lower is None else joint.lower
    high = TURN if joint.upper is None else joint.upper
    if mode.mapped or not mode.spring:
        return low, high
    # A motor may lead the link by the largest deflection of the spring, within the position limits of the motor.
    least, most = (values[f"motor_{slot + 1}_{end}_position"] for end in ("min", "max"))
    return max(low - spread, least), min(high + spread, most)


def _torque(drive: SteppedJoint) -> Range:
    return -drive.joint.most_effort, drive.joint.most_effort
