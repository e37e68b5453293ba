"""Pendulum on an SEA with one effect that a model may lack, simulated independently of asrsim by a Runge-Kutta method.

The robot file and the scenario are those of `support.soft_arm.SEA`, without the effect.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numba import njit

from support.soft_arm import SEA, command

EFFECTS = (
    "backlash", "cubic spring", "second mode", "hysteresis", "stribeck", "torque limit", "speed limit", "load", "late sensor",
    "spring damper", "load friction",
)  # fmt: skip
GRAVITY = 9.81
STEP = 2.5e-5
"""Time step, s."""
STUCK = 8000.0
"""Frequency of the link on the bristles of its joint, rad/s: so high that the arm reverses as with dry friction."""
_OFF = {
    "backlash": 0.0, "cubic": 0.0, "soft": 0.0, "split": 0.5, "hysteresis": 0.0, "yield": 0.03, "static": 0.0, "slow": 0.1,
    "torque": 1e3, "speed": 1e3, "load": 0.0, "damper": 0.0, "late": 0.0,
    "grip": 0.0,
}  # fmt: skip
"""Sizes of the effects in a right model."""
KEYS = {
    "backlash": "joint_1.backlash",
    "cubic": "joint_1.spring_cubic",
    "static": "joint_1.stribeck_friction",
    "slow": "joint_1.stribeck_velocity",
    "torque": "joint_1.motor_1_max_torque",
    "speed": "joint_1.motor_1_max_velocity",
    "load": "link_1.mass",
    "damper": "joint_1.spring_damping",
    "late": "joint_1.link_position.delay",
    "grip": "joint_1.load_friction",
}
"""Parameters that state the sizes of effects. The law of hysteresis here is another one than that of asrsim."""


@njit(cache=True)
def _rate(out, y, goal, p, e):  # type: ignore[no-untyped-def]
    """Set `out` to the time derivative of link, its speed, motor, its speed, tip, its speed, and bristles of joint, motor and
    spring.
    """
    k, rotor, drag, motor_rub, damping, rub, inertia, mass, reach, gain, brake = p
    width, cubic, soft, split, level, bend, static, slow, most, fastest, load, damper, _, grip = e
    out[8] = 0.0
    q, v, theta, omega, tip, tip_v = y[0], y[1], y[2], y[3], y[4], y[5]
    deflection = theta - q
    free = math.copysign(max(abs(deflection) - 0.5 * width, 0.0), deflection)
    spring = k * free + cubic * free**3 + damper * (omega - v)
    if level > 0.0:
        out[8] = (omega - v - abs(omega - v) * y[8]) / bend
        spring += level * y[8]
    own = rub + static * math.exp(-((v / slow) ** 2)) + grip * abs(spring)
    stiff = STUCK**2 * (inertia + mass * reach**2)
    # Without damping, bristles would ring while the link sticks, and break away below the static friction.
    lost = stiff * y[6] + 2.0 * STUCK * (inertia + mass * reach**2) * v
    out[6] = 0.0 if abs(lost) >= own and lost * v > 0.0 else v
    lost = max(min(lost, own), -own)
    motor_lost = max(min(1000.0 * y[7], motor_rub), -motor_rub)
    out[7] = 0.0 if abs(motor_lost) >= motor_rub and motor_lost * omega > 0.0 else omega
    drive = max(min(gain * (goal - theta) - brake * omega, most), -most)
    if (omega >= fastest and drive > 0.0) or (omega <= -fastest and drive < 0.0):
        drive = max(min(drive, drag * omega + spring + motor_lost), -1e3) if omega > 0.0 else drive
        if omega < 0.0:
            drive = min(max(drive, drag * omega + spring + motor_lost), 1e3)
    out[2], out[3] = omega, (drive - spring - drag * omega - motor_lost) / rotor
    total = inertia + mass * reach**2 + load * reach**2
    weight = (mass + load) * reach * 9.81
    out[0] = v
    if soft > 0.0:
        pull = soft * (tip - q) + 0.002 * (tip_v - v)
        out[1] = (spring - damping * v - lost - weight * (1.0 - split) * math.sin(q) + pull) / (total * (1.0 - split))
        out[4], out[5] = tip_v, (-pull - weight * split * math.sin(tip)) / (total * split)
    else:
        out[1] = (spring - damping * v - lost - weight * math.sin(q)) / total
        out[4], out[5] = v, 0.0


@njit(cache=True)
def _move(goals, every, step, p, e):  # type: ignore[no-untyped-def]
    """Link and motor at every `every`-th step; goals (2 steps + 1,) at half steps."""
    steps = (len(goals) - 1) // 2
    y, rows = np.zeros(9), np.empty((steps // every + 1, 2))
    between, rate, mean = np.zeros(9), np.zeros(9), np.zeros(9)
    stiff = STUCK**2 * (p[6] + p[7] * p[8] ** 2)
    for s in range(steps + 1):
        if s % every == 0:
            rows[s // every, 0], rows[s // every, 1] = y[0], y[2]
        if s == steps:
            break
        for half, weight in ((0, 1.0), (1, 2.0), (1, 2.0), (2, 1.0)):
            for m in range(9):
                between[m] = y[m] + 0.5 * half * step * rate[m]
            _rate(rate, between, goals[2 * s + half], p, e)
            for m in range(9):
                mean[m] += weight / 6.0 * rate[m]
        for m in range(9):
            y[m] += step * mean[m]
            mean[m] = 0.0
        own = p[5] + e[6] * math.exp(-((y[1] / e[7]) ** 2)) + e[13] * p[0] * abs(y[2] - y[0])
        y[6] = min(max(y[6], -own / stiff), own / stiff)
        y[7] = min(max(y[7], -p[3] / 1000.0), p[3] / 1000.0)
        y[8] = min(max(y[8], -1.0), 1.0)
    return rows


def sizes(effect: str, p: dict[str, float], random: np.random.Generator) -> dict[str, float]:
    """Sizes of an effect that changes the motion visibly, drawn at random; "" for a right model."""
    u, k = random.uniform, p["spring_stiffness"]
    inertia = p["iyy"] + 0.5 * 0.06**2
    if effect == "late sensor":
        # Drawn apart, so that the noise of the other robots stays as it was.
        return {"late": u(0.02, 0.06)}
    if effect == "spring damper":
        return {"damper": u(0.03, 0.1)}
    if effect == "load friction":
        return {"grip": u(0.1, 0.3)}
    return {
        "": {},
        "backlash": {"backlash": u(0.02, 0.06)},
        "cubic spring": {"cubic": k * u(15.0, 40.0)},
        "second mode": {"soft": inertia * u(70.0, 140.0) ** 2 / 4.0, "split": u(0.25, 0.5)},
        "hysteresis": {"hysteresis": u(0.06, 0.15), "yield": u(0.01, 0.03)},
        "stribeck": {"static": u(0.06, 0.12), "slow": u(0.1, 0.4)},
        "torque limit": {"torque": u(0.7, 1.1)},
        "speed limit": {"speed": u(1.5, 2.5)},
        "load": {"load": u(0.15, 0.4)},
    }[effect]


def true_effect(effect: str, seed: int) -> dict[str, float]:
    """Sizes of an effect by key of identification, as far as one parameter states each."""
    own = drawn(effect, seed)[1]
    own = {"load": 0.5 + own["load"]} if effect == "load" else own
    return {KEYS[name]: value for name, value in own.items() if name in KEYS}


def drawn(effect: str, seed: int):
    """Arm with random parameters, sizes of its effect, and the generator for the noise of its recording."""
    random = np.random.default_rng([11, seed])
    true = SEA.scaled(lambda _: math.exp(random.uniform(-0.2, 0.2)))
    (numbers,) = true.joints
    return true, sizes(effect, dict(numbers), random), random


def record(
    effect: str, seed: int, folder: Path, *, duration: float = 3.0, rate: float = 500.0, noise: float = 5e-4, held: bool = False
):
    """Scenario without the effect, recording of link and motor with it, and true parameters by key of identification. held:
    whether the robot holds each sample of its command until the next sample.
    """
    true, own, random = drawn(effect, seed)
    (numbers,) = true.joints
    p = {"mass": 0.5, "reach": 0.06, "controller_1_proportional": 8.0, "controller_1_derivative": 0.3} | dict(numbers)
    names = (
        "spring_stiffness", "motor_1_inertia", "motor_1_damping", "motor_1_friction_torque", "damping", "friction", "iyy",
        "mass", "reach", "controller_1_proportional", "controller_1_derivative",
    )  # fmt: skip
    e = _OFF | own
    half = np.arange(round(2.0 * duration / STEP) + 1) * (0.5 * STEP)
    goals = command(np.floor(half * rate + 1e-6) / rate if held else half, duration)[:, 0]
    moved = _move(goals, round(1.0 / (rate * STEP)), STEP, np.array([p[name] for name in names]), np.array([*e.values()]))
    time = np.arange(len(moved)) / rate
    moved[:, 0] = np.interp(time - e["late"], time, moved[:, 0])
    shown = moved + noise * random.normal(size=moved.shape)
    folder.mkdir(parents=True, exist_ok=True)
    header = "time [s],joint_1.reference_1 [rad],joint_1.link_position [rad],joint_1.motor_1_position [rad]"
    table = np.column_stack([time, command(time, duration)[:, 0], shown])
    np.savetxt(folder / "a.csv", table, delimiter=",", header=header, comments="")
    return SEA.write(folder), folder / "a.csv", dict(true.keys)
