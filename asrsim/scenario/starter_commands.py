"""Commands that a recording has under another name: those of quantities that are measured elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.recordings.data import Column
from asrsim.robot import ActuatorBlock, Robot

GOES_WITH = 0.5
"""Share of a torque's variance that its spring's deflection explains, at least: a spring's own torque has nearly all of it."""
SAMPLES = 20
"""Least number of samples by which that is told."""


def named_otherwise(robot: Robot, columns: dict[tuple[str, str], Column], remarks: list[str]) -> dict[tuple[str, str], Column]:
    """Commands that go by the name of a measured quantity: beside a stiffness preset, that of the mode's reference; of a motor
    on a spring, a torque that is not the spring's. Taken out of `columns`."""
    found = {}
    for block in robot.actuators:
        if (block.joint, "reference_1") in columns:
            continue
        name = (block.joint, "equilibrium_position")
        if MODES[block.mode].mapped and (block.joint, "reference_2") in columns and name in columns:
            found[block.joint, "reference_1"] = replace(columns.pop(name), quantity="reference_1")
            remarks.append(f"{block.joint}: the recorded equilibrium_position, beside a stiffness preset, is its command")
        elif (torque := _of_the_motor(block, columns)) is not None:
            found[block.joint, "reference_1"] = replace(columns.pop((block.joint, "link_torque")), quantity="reference_1")
            remarks.append(
                f"{block.joint}: {torque.source} is no torque of the spring, since it does not go with the deflection: "
                "it is taken for the motor's command"
            )
    return found


def _of_the_motor(block: ActuatorBlock, columns: dict[tuple[str, str], Column]) -> Column | None:
    """A torque that nobody said to be the link's, where motor and link were recorded and the deflection does not explain it."""
    actuator = ACTUATORS.get(block.actuator)
    torque, motor, link = (columns.get((block.joint, name)) for name in ("link_torque", "motor_1_position", "link_position"))
    if torque is None or motor is None or link is None or actuator.motors > 1 or torque.given:
        return None
    if not MODES[block.mode].spring:
        return None
    known = [np.isfinite(one.values) for one in (motor, link, torque)]
    places = [
        np.interp(torque.time, one.time[ok], one.values[ok])
        for one, ok in zip((motor, link), known[:2], strict=True)
        if ok.any()
    ]
    if len(places) < 2 or known[2].sum() < SAMPLES:
        return None
    deflection, values = (places[0] - places[1])[known[2]], torque.values[known[2]]
    spread = float(np.std(deflection) * np.std(values))
    if spread <= 0.0:
        return None
    correlation = float(np.mean((deflection - deflection.mean()) * (values - values.mean()))) / spread
    return torque if correlation**2 < GOES_WITH else None
