"""Joints that a recorded torque drives. In a simulation of such a joint, errors of the torque accumulate. Therefore a stiff
controller brings the simulated joint back to the recorded position, and the additional torque of the controller is the error
that is compared.

The controller is that of mode 1. Its reference r combines the recorded torque u, position q and velocity v; x is the simulated
position: P (r - x) - D x' = u + P (q - x) + D (v - x').
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from asrsim.identification.data import Channel, Data, Guide, PlayedCommand
from asrsim.identification.noise import bandwidth, fine_noise, smoothed
from asrsim.robot.model import Robot
from asrsim.signals.curve import curve_through

HIGHEST = 20.0
"""Highest bandwidth of the controller, Hz."""
EDGE = 2.0
"""Duration that is not compared at both ends of a recording, in periods of the controller's bandwidth."""
POSITION_SHARE, TORQUE_SHARE, ABOVE_SHARE = 0.54, 0.785, 0.85
"""Integrals over the frequency, in units of the bandwidth: of the squared response of the compared torque to noise of the
position, of its squared response to noise of the torque, and over the band in which the noise of the position is measured.
"""
PID = 1
"""Operation mode in which a PID controller acts on the link."""
NO_LIMIT = 1e9
"""Torque limit of a controller that must not saturate, N m."""


def guided(data: Data, robot: Robot, free: Collection[str]) -> Data:
    """Recording in which joints that only a recorded torque drives (mode 0, without a spring) follow their recorded positions,
    unless a coarse encoder would shake these joints.
    """
    for block in robot.actuators:
        joint, name = robot.joint(block.joint), block.joint
        sprung = joint.spring_stiffness != 0.0 or f"{name}.passive_stiffness" in free
        command = next((one for one in data.commands if one.key == f"{name}.reference_1"), None)
        place = next((one for one in data.channels if one.key == f"{name}.link_position"), None)
        if data.modes.get(name, block.mode) == 0 and not sprung and command and place and not place.quantum:
            data = _guided(data, command, place, "N" if joint.kind == "prismatic" else "N m")
    return data


def _guided(data: Data, command: PlayedCommand, place: Channel, unit: str) -> Data:
    from scipy.interpolate import CubicSpline

    name, step = place.joint, float(np.median(np.diff(place.time)))
    time = np.arange(place.time[0], place.time[-1], step)
    raw = np.interp(time, place.time, place.values)
    band = min(1.5 * bandwidth(step, raw, place.floor) or 1.0, HIGHEST, 0.15 / step)
    cutoff = 4.0 * band * step
    recorded = smoothed(np.interp(time, command.time, command.values), min(4.0 * cutoff, 0.9))
    position, torque = smoothed(raw, cutoff), smoothed(recorded, 2.0 * band * step)
    velocity = CubicSpline(time, position)(time, 1)
    # The inertia is estimated as if all of the torque accelerated it, so no parameter of the robot is needed.
    inertia = float(np.std(torque) / max(np.std(np.gradient(velocity, time)), 1e-300))
    omega = 2.0 * np.pi * band
    gain, brake = inertia * omega**2, 2.0 * inertia * omega
    guide = curve_through(time, position + brake / gain * velocity)
    inside = (time > time[0] + EDGE / band) & (time < time[-1] - EDGE / band)
    # The samples are so far apart that the controller does not correlate their errors.
    rows = np.flatnonzero(inside)[:: max(1, round(0.5 / (band * step)))]
    # Noise of the position enters the compared torque as gain s^2 / (1 + s^2), noise of the torque as 1 / (1 + s^2), with the
    # frequency s in units of the bandwidth. The shares are integrals of the squares of these responses: for noise of the
    # position up to the cutoff s = 2. Noise of the position is measured between s = 1 and 2, where the motion has ended. Jumps
    # of friction need the torque far beyond s = 2.
    above = position - smoothed(raw, 0.5 * cutoff)
    of_position = gain * float(np.std(above[inside])) * np.sqrt(POSITION_SHARE / ABOVE_SHARE)
    noise = float(np.hypot(fine_noise(command.values) * np.sqrt(2.0 * band * step * TORQUE_SHARE), of_position))
    channel = Channel(
        joint=name, quantity="link_torque", unit=unit, time=time[rows], values=torque[rows], noise=noise, quantum=0.0,
        guide=Guide(command=command.key, positions=position[rows], stiffness=gain),
    )  # fmt: skip
    remark = f"{name}: driven by the recorded torque; torques are compared up to {band:.3g} Hz"
    played = replace(command, name="link_position", time=time, values=recorded, scale=1.0 / gain, guide=guide)
    numbers = {
        "controller_1_proportional": gain, "controller_1_derivative": brake, "controller_1_integral": 0.0,
        "motor_1_max_torque": NO_LIMIT,
    }  # fmt: skip
    return replace(
        data, modes={**data.modes, name: PID}, parameters={**data.parameters, name: numbers},
        commands=tuple(played if one is command else one for one in data.commands),
        channels=tuple(channel if one is place else one for one in data.channels), guides=(*data.guides, place),
        remarks=(*data.remarks, remark),
    )  # fmt: skip
