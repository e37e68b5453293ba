"""Actuators that a scenario from a recording puts on joints: their modes, and what of them must not stand in a fit's way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from asrsim.actuators import ACTUATORS, MODES
from asrsim.actuators.electric import missing_constants
from asrsim.recordings.data import Recording
from asrsim.recordings.matching import match_joints
from asrsim.robot import Robot

UNIT_MODES = {"N m": 4, "N": 4, "V": 7, "A": 8}
"""Unit of a command that is no position -> mode that takes it."""
WIDE = 1e4
"""N m, rad/s: limits of motors of which nothing is known; a thousand times what joints of robots do."""


def fitting_modes(robot: Robot, recording: Recording, joints: Sequence[str]) -> dict[str, int]:
    """Joint -> mode that takes what was recorded of its command, where that is no position."""
    pairing, _ = match_joints([joint.name for joint in robot.moving_joints], recording)
    units = {(pairing.get(str(c.joint)), str(c.quantity)): c.unit for c in recording.channels.values() if c.quantity}
    commands = ("reference_1", *(f"motor_1_{what}" for what in ("voltage", "current", "torque")))
    found = {joint: [units[joint, one] for one in commands if (joint, one) in units] for joint in joints}
    return {joint: UNIT_MODES[told[0]] for joint, told in found.items() if told and told[0] in UNIT_MODES}


def open_parameters(robot: Robot, modes: Mapping[str, int], joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Joint -> parameters of motors and controllers of which nothing is known: limits that nothing reaches, constants that are
    needed, and no derivative gain, since that brakes as damping does, which is fitted and may be less than a guess of both.
    """
    found: dict[str, dict[str, float]] = {}
    for block in robot.actuators:
        motors, mode = ACTUATORS.get(block.actuator).motors, MODES[modes.get(block.joint, modes.get("*", block.mode))]
        if block.joint in joints and (mode.motor or mode.controller):
            limits = [f"motor_{i}_max_{what}" for i in range(1, motors + 1) for what in ("torque", "velocity") if mode.motor]
            constants = missing_constants(block.values(), motors, mode) if mode.motor else ()
            gains = [f"controller_{i}_derivative" for i in range(1, motors + 1) if mode.controller]
            found[block.joint] = {**dict.fromkeys(limits, WIDE), **dict.fromkeys(constants, 1.0), **dict.fromkeys(gains, 0.0)}
    return found
