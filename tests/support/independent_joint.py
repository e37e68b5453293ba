"""Recordings of one elastic joint, simulated independently of asrsim.

A link turns about a vertical or horizontal axis: I q'' + d q' + F sign(q') + m g l sin q = tau; stiction is exact. The joint
has one motor with a linear spring (SEA), or two motors with springs tau_i = k sinh(a (theta_i - q)) (qbMove). Motors:
J theta'' + D theta' + friction = u - tau_i with u = P (goal - theta) - D' theta'. Their friction is Dahl's: bristles of
1000 N m/rad that slip at the friction level. Integrator: fourth-order Runge-Kutta with steps of 0.05 ms; a step ends early
if the link comes to rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit

Array = np.ndarray
BRISTLES, GAIN, BRAKE = 1000.0, 8.0, 0.3
"""Stiffness of Dahl's friction (N m/rad, paper eq. 8), and gains of the motor controllers (N m/rad, N m s/rad)."""
MASS, ARM, GRAVITY = 0.5, 0.06, 9.81
"""Mass (kg), distance of the centre of mass from the axis (m), gravity (m/s^2)."""
FINE = 5e-5
"""Time step, s."""


@njit(cache=True)
def _spring(law: int, a: float, k: float, x: float) -> float:
    return k * x if law == 0 else k * np.sinh(a * x)


@njit(cache=True)
def _rate(y, goals, outer, held, p, out):  # type: ignore[no-untyped-def]
    """Torque on the link without its friction, N m. The derivative of the state is written to `out`.

    y: position and speed of the link, then position, speed and bristle deflection of each motor; outer: external torque on
    the link, N m; held: direction in which the link slips, 0 if it sticks.
    """
    law, a, k, inertia, damping, friction, weight, rotor, brake, level, other = p
    push = outer - damping * y[1] - weight * np.sin(y[0])
    for i in range(len(goals)):
        theta, omega, bent = y[2 + 3 * i], y[3 + 3 * i], y[4 + 3 * i]
        torque = _spring(int(law), a, k if i == 0 else other, theta - y[0])
        push += torque
        most = level / BRISTLES
        z = min(max(bent, -most), most)
        drive = GAIN * (goals[i] - theta) - BRAKE * omega
        out[2 + 3 * i] = omega
        out[3 + 3 * i] = (drive - torque - brake * omega - BRISTLES * z) / rotor
        out[4 + 3 * i] = 0.0 if (bent >= most and omega > 0.0) or (bent <= -most and omega < 0.0) else omega
    if held == 0.0:
        out[0] = out[1] = 0.0
    else:
        out[0], out[1] = y[1], (push - held * friction) / inertia
    return push


@njit(cache=True)
def _goal(goals, at):  # type: ignore[no-untyped-def]
    """Motor setpoints at the fraction `at` of a step, interpolated by a parabola.

    goals: setpoints (3, motors) at the start, the middle and the end of the step.
    """
    return goals[0] * (1.0 - at) * (1.0 - 2.0 * at) + goals[1] * 4.0 * at * (1.0 - at) + goals[2] * at * (2.0 * at - 1.0)


@njit(cache=True)
def _advance(y, goals, outer, begin, end, step, held, p):  # type: ignore[no-untyped-def]
    """State after a part of a step, by the fourth-order Runge-Kutta method."""
    k1, k2, k3, k4 = np.empty(len(y)), np.empty(len(y)), np.empty(len(y)), np.empty(len(y))
    h, middle = (end - begin) * step, _goal(goals, 0.5 * (begin + end))
    _rate(y, _goal(goals, begin), outer, held, p, k1)
    _rate(y + 0.5 * h * k1, middle, outer, held, p, k2)
    _rate(y + 0.5 * h * k2, middle, outer, held, p, k3)
    _rate(y + h * k3, _goal(goals, end), outer, held, p, k4)
    there = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    most = p[9] / BRISTLES
    for i in range(4, len(y), 3):
        there[i] = min(max(there[i], -most), most)
    return there


@njit(cache=True)
def _integrate(goals, outer, every, step, p):  # type: ignore[no-untyped-def]
    """Positions of link and motors at every `every`-th step.

    goals: motor setpoints (2 n + 1, motors) at half steps; outer: external torque (n,) on the link in each step, N m.
    """
    motors, n, friction = goals.shape[1], (len(goals) - 1) // 2, p[5]
    y, slope, rows = np.zeros(2 + 3 * motors), np.empty(2 + 3 * motors), np.empty((n // every + 1, 1 + motors))
    for i in range(motors):
        y[2 + 3 * i] = goals[0, i]
    held = 0.0 if friction > 0.0 else 1.0
    for s in range(n + 1):
        if s % every == 0:
            rows[s // every, 0] = y[0]
            for i in range(motors):
                rows[s // every, 1 + i] = y[2 + 3 * i]
        if s == n:
            break
        here, done = goals[2 * s : 2 * s + 3], 0.0
        for _ in range(4):
            if held == 0.0:
                push = _rate(y, _goal(here, done), outer[s], 0.0, p, slope)
                held = np.sign(push) if abs(push) > friction else 0.0
            there = _advance(y, here, outer[s], done, 1.0, step, held, p)
            if friction == 0.0 or held == 0.0 or held * there[1] >= 0.0:
                break
            # The link comes to rest within this step. Bisection finds the time; the rest of the step starts at rest.
            low, high = done, 1.0
            for _ in range(30):
                middle = 0.5 * (low + high)
                if held * _advance(y, here, outer[s], done, middle, step, held, p)[1] >= 0.0:
                    low = middle
                else:
                    high = middle
            y = _advance(y, here, outer[s], done, low, step, held, p)
            y[1], held, done = 0.0, 0.0, low
        y = there
    return rows


@dataclass(frozen=True)
class Joint:
    """An elastic joint with its parameters, named as in asrsim."""

    actuator: str
    numbers: Mapping[str, float]
    gravity: bool = False

    @property
    def motors(self) -> int:
        return 2 if self.actuator == "qbmove" else 1

    def goals(self, command: Array) -> Array:
        """Motor setpoints (n, motors) for link setpoints (n,). A qbMove has a preset of 0.3 rad."""
        return np.column_stack([command + 0.3, command - 0.3]) if self.motors == 2 else command[:, None]

    def move(self, command: Array, every: int, step: float = FINE, outer: Array | None = None) -> Array:
        """Positions of link and motors (rows, 1 + motors), rad.

        command: link setpoints at half steps, rad; outer: external torque on the link in each step, N m.
        """
        n = self.numbers
        weight = MASS * GRAVITY * ARM if self.gravity else 0.0
        inertia = n["izz"] + MASS * ARM**2
        law = 1.0 if self.motors == 2 else 0.0
        p = (
            law, n.get("spring_a_1", 0.0), n.get("spring_k_1", n.get("spring_stiffness", 0.0)), inertia, n["damping"],
            n["friction"], weight, n["motor_1_inertia"], n["motor_1_damping"], n["motor_1_friction_torque"],
            n.get("spring_k_2", n.get("spring_k_1", 0.0)),
        )  # fmt: skip
        return _integrate(self.goals(command), np.zeros(len(command) // 2) if outer is None else outer, every, step, p)

    @property
    def keys(self) -> dict[str, float]:
        """True values by asrsim's keys."""
        inertia = "iyy" if self.gravity else "izz"
        return {f"link_1.{inertia}" if k == "izz" else f"joint_1.{k}": v for k, v in self.numbers.items()}

    @property
    def ties(self) -> list[str]:
        """Ties that give the second motor the parameters of the first."""
        both = [k for k in self.numbers if "_1" in k] if self.motors == 2 else []
        return [f"joint_1.{k.replace('_1', '_2', 1)} = joint_1.{k}" for k in both]

    def write(self, folder: Path, numbers: Mapping[str, float]) -> Path:
        """Write robot and scenario with these parameters, and return the scenario."""
        centre = f"0 0 {-ARM}" if self.gravity else f"{ARM} 0 0"
        text = ROBOT.format(
            actuator=self.actuator, axis="0 1 0" if self.gravity else "0 0 1", mass=MASS, centre=centre, **numbers
        )
        (folder / "joint.urdf").write_text(text)
        own = {k: v for k, v in numbers.items() if k not in ("izz", "damping", "friction")}
        own |= {k.replace("_1", "_2", 1): v for k, v in own.items() if "_1" in k and self.motors == 2}
        for i in range(1, self.motors + 1):
            own |= {f"controller_{i}_proportional": GAIN, f"controller_{i}_derivative": BRAKE, f"controller_{i}_integral": 0.0}
            own |= {f"motor_{i}_max_torque": 1000.0, f"motor_{i}_max_velocity": 1000.0}
        own["max_deflection"] = 10.0
        body = "".join(f"    {key}: {value!r}\n" for key, value in own.items())
        preset = "references: {joint_1: {stiffness_preset: 0.3}}\n" if self.motors == 2 else ""
        (folder / "lab.yaml").write_text(
            f"robot: joint.urdf\nduration: 2\nengine: mujoco\n{preset}parameters:\n  joint_1:\n{body}"
        )
        return folder / "lab.yaml"


ROBOT = """<robot name="lab"><link name="world"/>
  <joint name="joint_1" type="revolute"><parent link="world"/><child link="link_1"/><axis xyz="{axis}"/>
    <limit effort="1000" velocity="10000" lower="-10" upper="10"/><dynamics damping="{damping}" friction="{friction}"/></joint>
  <link name="link_1"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>
    <inertia ixx="{izz}" ixy="0" ixz="0" iyy="{izz}" iyz="0" izz="{izz}"/></inertial></link>
  <gazebo><plugin name="c1" filename="lib{actuator}_plugin.so"><joint>joint_1</joint><operation_mode>6</operation_mode>
    <pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau></plugin></gazebo>
</robot>
"""


def command(time: Array, duration: float) -> Array:
    """Link setpoints, rad: a chirp up to 6 Hz and a sine, both faded in."""
    phase = 2.0 * np.pi * (0.5 * time + 0.5 * 5.5 / duration * time**2)
    return np.asarray(0.35 * (1.0 - np.exp(-time / 0.1)) * (np.sin(phase) + 0.4 * np.sin(2.3 * time)))


QBMOVE = Joint(
    "qbmove",
    {"spring_a_1": 6.7328, "spring_k_1": 0.0222, "motor_1_inertia": 0.0233, "motor_1_damping": 0.2698,
     "motor_1_friction_torque": 0.05, "damping": 0.02, "friction": 0.03, "izz": 0.009},
)  # fmt: skip
SEA = Joint(
    "sea",
    {"spring_stiffness": 4.0, "motor_1_inertia": 0.02, "motor_1_damping": 0.2, "motor_1_friction_torque": 0.08,
     "damping": 0.03, "friction": 0.04, "izz": 0.007}, gravity=True,
)  # fmt: skip


def record(
    joint: Joint, path: Path, *, seed: int, duration: float = 2.0, every: int = 1, noise: float = 1e-3, memory: float = 0.0,
    quantum: float = 0.0,
) -> Path:  # fmt: skip
    """Write a recording of link and motor positions with noise.

    every: sampling interval, ms; memory: correlation time of the noise, s; quantum: resolution of the encoders, rad.
    """
    time = np.arange(round(2 * duration / FINE) + 1) * (0.5 * FINE)
    goals = command(time, duration)
    skip = round(every * 1e-3 / FINE)
    rows, generator = joint.move(goals, skip), np.random.default_rng(seed)
    table = {"time [s]": time[:: 2 * skip][: len(rows)], "joint_1.reference_1 [rad]": goals[:: 2 * skip][: len(rows)]}
    for i, place in enumerate(rows.T):
        rho = np.exp(-every * 1e-3 / memory) if memory else 0.0
        white = generator.normal(size=len(place))
        coloured = np.empty(len(place))
        coloured[0] = white[0]
        for k in range(1, len(coloured)):
            coloured[k] = rho * coloured[k - 1] + np.sqrt(1.0 - rho**2) * white[k]
        values = place + noise * coloured
        if quantum:
            values = quantum * np.round(values / quantum)
        name = "link_position" if i == 0 else f"motor_{i}_position"
        table[f"joint_1.{name} [rad]"] = values
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="", fmt="%.9g")
    return path
