"""A motor under voltage that sticks between steps of its goal, simulated independently of asrsim.

Numbers are of the size of a laboratory's geared arm: a gear of 48.4, 0.0107 V s/rad, 3.29 ohm; its amplifier has a zero, its
command acts late, and its static friction exceeds the friction while it slips.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

GEAR, CONSTANT, RESISTANCE = 48.4, 0.0107, 3.29
LINK = 0.0015
"""Part of the inertia that the model's link has, kg m^2."""
STEP, EVERY = 1e-4, 10
"""Time step, s; steps in a sampling interval."""
ROBOT = f"""<?xml version="1.0"?>
<robot name="rig">
  <link name="world"/>
  <joint name="joint_1" type="continuous">
    <parent link="world"/><child link="arm"/><axis xyz="0 0 1"/><limit effort="1000" velocity="1000"/>
  </joint>
  <link name="arm">
    <inertial><mass value="0.1"/><inertia ixx="{LINK}" ixy="0" ixz="0" iyy="{LINK}" iyz="0" izz="{LINK}"/></inertial>
  </link>
</robot>
"""
SCENARIO = f"""robot: rig.urdf
duration: 5
actuators: {{joint_1: sea}}
modes: 7
parameters:
  joint_1:
    spring_k: 200.0
    motor_1_inertia: 0.008
    motor_1_damping: 0.01
    motor_1_friction_torque: 0.01
    motor_1_torque_constant: {CONSTANT}
    motor_1_gear_ratio: {GEAR}
    motor_1_resistance: {RESISTANCE}
    motor_1_max_torque: 1000
    motor_1_max_velocity: 1000
    max_deflection: 10
"""


def drawn(seed: int) -> tuple[dict[str, float], np.random.Generator]:
    """Sizes by key of identification, and the generator of the noise. The inertia is that of motor and link."""
    random = np.random.default_rng(seed)
    names = "motor_1_inertia", "motor_1_friction_torque", "reference_1.offset", "reference_1.delay"
    sizes = np.array([0.0035, 0.05, 0.034, 0.04]) * np.exp(random.uniform(-0.2, 0.2, 4)) * (1.0, 1.0, -1.0, 1.0)
    return {f"joint_1.{name}": size for name, size in zip(names, sizes.tolist(), strict=True)}, random


def record(folder: Path, seed: int) -> tuple[Path, Path]:
    """Scenario of a model with Coulomb friction and without delay; recording of `hub` (rad) and `drive` (V), 10 s."""
    sizes, random = drawn(seed)
    inertia, rub, zero, delay = sizes.values()
    steps, late = round(10.0 / STEP), round(delay / STEP)
    place, speed, places, volts = -0.055, 0.0, np.empty(steps), np.empty(steps)
    for i in range(steps):
        goal = 0.1 if i * STEP > 1.0 and (i * STEP - 1.0) % 5.0 < 2.5 else -0.1
        places[i], volts[i] = place, 6.0 * (goal - place)
        volt = (volts[i - late] if i >= late else -0.27) - zero
        torque = GEAR * CONSTANT / RESISTANCE * (volt - GEAR * CONSTANT * speed)
        if speed == 0.0 and abs(torque) < 1.5 * rub:
            continue
        against = math.copysign(rub * (1.0 + 0.5 * math.exp(-((speed / 0.1) ** 2))), speed or torque)
        moved = speed + STEP * (torque - against) / inertia
        speed = 0.0 if moved * speed < 0.0 else moved
        place += STEP * speed
    time = np.arange(0, steps, EVERY) * STEP
    shown = places[::EVERY] + 3e-4 * random.normal(size=len(time))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.urdf").write_text(ROBOT)
    (folder / "lab.yaml").write_text(SCENARIO)
    table = np.column_stack([time, shown, volts[::EVERY]])
    np.savetxt(folder / "a.csv", table, delimiter=",", header="time,hub,drive", comments="")
    return folder / "lab.yaml", folder / "a.csv"
