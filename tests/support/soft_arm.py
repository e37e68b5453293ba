"""Soft planar arm, simulated independently of asrsim, with its robot file, its scenario and its recordings.

At q = 0, the links hang down; the axes are parallel. Each joint has one motor with a linear spring (SEA), or two motors with
springs tau_i = k_i sinh(a (theta_i - q)) (qbMove). Motors: J theta'' + D theta' + friction = clip(P (goal - theta) - D' theta')
- tau_i. Friction of joints and motors is Dahl's: bristles that bend, and slip at the friction level. Integrator: fourth-order
Runge-Kutta.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import yaml
from numba import njit
from scipy.signal import lfilter

BRISTLES = 1000.0
"""Stiffness of the bristles of motors, N m/rad (paper eq. 8)."""
STUCK = 4000.0
"""Frequency of a link on the bristles of its joint, rad/s. It is so high that a link that sticks moves by microradians only."""
FINE = 5e-5
"""Time step, s."""
DEFAULTS = {
    "mass": 0.5, "reach": 0.06, "length": 0.12, "iyy": 0.01, "damping": 0.0, "friction": 0.0,
    "spring_a_1": 0.0, "spring_k_1": 0.0, "spring_stiffness": 0.0, "motor_1_inertia": 0.02, "motor_1_damping": 0.2,
    "motor_1_friction_torque": 0.0, "motor_1_max_torque": 1e3, "controller_1_proportional": 8.0, "controller_1_derivative": 0.3,
}  # fmt: skip
"""Values of the parameters that an arm does not state: `length` to the next joint and `reach` to the centre of mass in m."""


# Numba compiles loops over numbers three times as fast as operations on arrays and `np.linalg.solve`.


@njit(cache=True)
def _rate(out, y, goals, outer, n, motors, p, gravity, room):  # type: ignore[no-untyped-def]
    """Set `out` to the time derivative of the state: position, speed and bristle deflection of each link and, after it, of its
    motors. room: memory for the mass matrix (n, n), torques, angles and speeds (n,) of the links.
    """
    mass, reach, length, inertia, damping, rub, bristles, a, k_1, k_2, rotor, drag, motor_rub, most, gain, brake = p
    matrix, push, phi, omega = room
    for j in range(n):
        at = 3 * (1 + motors) * j
        phi[j] = y[at] + (phi[j - 1] if j > 0 else 0.0)
        omega[j] = y[at + 1] + (omega[j - 1] if j > 0 else 0.0)
        push[j] = outer[j] - damping[j] * y[at + 1]
        for i in range(1 + motors):
            m = at + 3 * i
            level, stiffness = (rub[j], bristles[j]) if i == 0 else (motor_rub[j], BRISTLES)
            bend = min(max(y[m + 2], -level / stiffness), level / stiffness)
            slips = abs(bend) >= level / stiffness and bend * y[m + 1] > 0.0
            lost = stiffness * bend
            out[m], out[m + 2] = y[m + 1], 0.0 if slips else y[m + 1]
            if i == 0:
                push[j] -= lost
                continue
            k, deflection = k_1[j] if i == 1 else k_2[j], y[m] - y[at]
            spring = k * deflection if motors == 1 else k * math.sinh(a[j] * deflection)
            drive = min(max(gain[j] * (goals[motors * j + i - 1] - y[m]) - brake[j] * y[m + 1], -most[j]), most[j])
            out[m + 1] = (drive - spring - drag[j] * y[m + 1] - lost) / rotor[j]
            push[j] += spring
    # Equations of motion in the angles of the links to the vertical.
    for link in range(n):
        push[link] -= push[link + 1] if link < n - 1 else 0.0
        for j in range(n):
            matrix[link, j] = 0.0
    for link in range(n):
        matrix[link, link] += inertia[link]
        for i in range(link + 1):
            first = reach[i] if i == link else length[i]
            push[i] -= gravity * mass[link] * first * math.sin(phi[i])
            for j in range(link + 1):
                both = mass[link] * first * (reach[j] if j == link else length[j])
                matrix[i, j] += both * math.cos(phi[i] - phi[j])
                push[i] -= both * math.sin(phi[i] - phi[j]) * omega[j] ** 2
    # Gauss's elimination, which leaves the accelerations in `push`.
    for j in range(n):
        for i in range(j + 1, n):
            share = matrix[i, j] / matrix[j, j]
            push[i] -= share * push[j]
            for k in range(j + 1, n):
                matrix[i, k] -= share * matrix[j, k]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            push[i] -= matrix[i, j] * push[j]
        push[i] /= matrix[i, i]
    for j in range(n):
        out[3 * (1 + motors) * j + 1] = push[j] - (push[j - 1] if j > 0 else 0.0)


@njit(cache=True)
def _integrate(goals, outer, start, every, step, n, motors, p, gravity):  # type: ignore[no-untyped-def]
    """Positions (rows, n (1 + motors)) at every `every`-th step, each link before its motors.

    goals: motor setpoints (2 steps + 1, n motors) at half steps; outer: external torques (steps, n), N m; start: first row.
    """
    steps, many = (len(goals) - 1) // 2, len(start)
    y, rows = np.zeros(3 * many), np.empty((steps // every + 1, many))
    between, rate, mean = np.zeros(len(y)), np.zeros(len(y)), np.zeros(len(y))
    room = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n)
    for m in range(many):
        y[3 * m] = start[m]
    for s in range(steps + 1):
        if s % every == 0:
            for m in range(many):
                rows[s // every, m] = y[3 * m]
        if s == steps:
            break
        for half, weight in ((0, 1.0), (1, 2.0), (1, 2.0), (2, 1.0)):
            for m in range(len(y)):
                between[m] = y[m] + 0.5 * half * step * rate[m]
            _rate(rate, between, goals[2 * s + half], outer[s], n, motors, p, gravity, room)
            for m in range(len(y)):
                mean[m] += weight / 6.0 * rate[m]
        for m in range(len(y)):
            y[m] += step * mean[m]
            mean[m] = 0.0
        for m in range(many):
            j = m // (1 + motors)
            slip = p[5][j] / p[6][j] if m % (1 + motors) == 0 else p[12][j] / BRISTLES
            y[3 * m + 2] = min(max(y[3 * m + 2], -slip), slip)
    return rows


@dataclass(frozen=True)
class SoftArm:
    """An arm. Its parameters are named as in asrsim; motors of a joint are equal, springs may differ (`spring_k_2`)."""

    actuator: str
    joints: tuple[Mapping[str, float], ...]
    gravity: float = 0.0
    preset: float = 0.3
    """Stiffness preset of qbMoves, rad."""
    delay: float = 0.0
    """Delay of the commands, s. Until the first arrives, motors rest at their presets."""

    @property
    def motors(self):
        """Number of motors of a joint."""
        return 2 if self.actuator == "qbmove" else 1

    def values(self, name):
        """Values (joints,) of a parameter."""
        return np.array([joint.get(name, DEFAULTS[name]) for joint in self.joints])

    def scaled(self, factor):
        """Arm whose stated parameters are multiplied by `factor(name)`."""
        joints = tuple({name: value * factor(name) for name, value in joint.items()} for joint in self.joints)
        return replace(self, joints=joints)

    def move(self, time, goals, *, outer=None, step=FINE):
        """Positions (n, joints, 1 + motors) of links and motors at `time`, rad.

        goals: equilibrium positions (n, joints) at times (n,); outer: external torques (steps, joints), N m.
        """
        half = np.arange(round(2.0 * time[-1] / step) + 1) * (0.5 * step)
        targets = np.where(half[:, None] >= self.delay, goals(half - self.delay), 0.0)
        offsets = np.array([self.preset, -self.preset]) if self.motors == 2 else np.zeros(1)
        spring = self.values("spring_k_1" if self.motors == 2 else "spring_stiffness")
        second = [joint.get("spring_k_2", k) for joint, k in zip(self.joints, spring, strict=True)]
        bristles = STUCK**2 * (self.values("iyy") + self.values("mass") * self.values("reach") ** 2)
        p = (
            *map(self.values, ("mass", "reach", "length", "iyy", "damping", "friction")),
            bristles,
            self.values("spring_a_1"),
            spring,
            np.array(second),
            *(self.values(f"motor_1_{name}") for name in ("inertia", "damping", "friction_torque", "max_torque")),
            *(self.values(f"controller_1_{name}") for name in ("proportional", "derivative")),
        )
        outer = np.zeros((len(half) // 2, len(self.joints))) if outer is None else outer
        every = round((time[1] - time[0]) / step)
        n, motors = len(self.joints), self.motors
        start = np.tile([0.0, *offsets], n)
        found = _integrate(
            np.repeat(targets, motors, axis=1) + np.tile(offsets, n), outer, start, every, step, n, motors, p, self.gravity
        )
        return np.asarray(found).reshape(-1, n, 1 + motors)

    @property
    def keys(self):
        """Stated parameters of the first joint by the keys of identification."""
        return {f"{'link' if name == 'iyy' else 'joint'}_1.{name}": value for name, value in self.joints[0].items()}

    @property
    def ties(self):
        """Ties that give the second motor of the first joint the parameters of its first motor."""
        both = [name for name in self.joints[0] if "_1" in name] if self.motors == 2 else []
        return [f"joint_1.{name.replace('_1', '_2', 1)} = joint_1.{name}" for name in both]

    def write(self, folder, **keys):
        """Write robot and scenario, and return the scenario. keys: further keys of the scenario."""
        folder.mkdir(parents=True, exist_ok=True)
        parts, parameters, references = ['<link name="link_0"/>'], {}, {}
        for j, joint in enumerate(self.joints, 1):
            n = DEFAULTS | dict(joint)
            up = 0.0 if j == 1 else -self.values("length")[j - 2]
            parts.append(LINK.format(j=j, before=j - 1, up=up, actuator=self.actuator, **n))
            drive = {name: n[name] for name in n if name.startswith(("motor", "controller"))}
            drive |= {"controller_1_integral": 0.0, "motor_1_max_velocity": 1000.0}
            if self.motors == 2:
                drive |= {"spring_a_1": n["spring_a_1"], "spring_k_1": n["spring_k_1"]}
                drive |= {name.replace("_1", "_2", 1): value for name, value in drive.items()}
                references[f"joint_{j}"] = {"stiffness_preset": self.preset}
            else:
                drive["spring_stiffness"] = n["spring_stiffness"]
            parameters[f"joint_{j}"] = {name: float(value) for name, value in drive.items()} | {"max_deflection": 3.0}
        (folder / "arm.urdf").write_text(f'<robot name="arm">{"".join(parts)}</robot>')
        scenario = {
            "robot": "arm.urdf",
            "duration": 2.0,
            "engine": "mujoco",
            "gravity": [0.0, 0.0, -self.gravity],
            "parameters": parameters,
            "references": references,
            **keys,
        }
        (folder / "arm.yaml").write_text(yaml.safe_dump(scenario))
        return folder / "arm.yaml"


LINK = """
<joint name="joint_{j}" type="revolute"><origin xyz="0 0 {up}"/><parent link="link_{before}"/><child link="link_{j}"/>
  <axis xyz="0 1 0"/><limit effort="1000" velocity="10000" lower="-10" upper="10"/>
  <dynamics damping="{damping}" friction="{friction}"/></joint>
<link name="link_{j}"><inertial><origin xyz="0 0 -{reach}"/><mass value="{mass}"/>
  <inertia ixx="{iyy}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{iyy}"/></inertial></link>
<gazebo><plugin name="c{j}" filename="lib{actuator}_plugin.so"><joint>joint_{j}</joint><operation_mode>6</operation_mode>
  <pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau></plugin></gazebo>
"""

QBMOVE = SoftArm("qbmove", ({
    "spring_a_1": 6.7328, "spring_k_1": 0.0222, "motor_1_inertia": 0.0233, "motor_1_damping": 0.2698,
    "motor_1_friction_torque": 0.05, "damping": 0.02, "friction": 0.03, "iyy": 0.009,
},))  # fmt: skip
SEA = SoftArm("sea", ({
    "spring_stiffness": 4.0, "motor_1_inertia": 0.02, "motor_1_damping": 0.2, "motor_1_friction_torque": 0.08,
    "damping": 0.03, "friction": 0.04, "iyy": 0.007,
},), gravity=9.81)  # fmt: skip


def command(time, duration):
    """Link setpoints (n, 1), rad: a chirp up to 6 Hz and a sine, both faded in."""
    phase = 2.0 * np.pi * (0.5 * time + 0.5 * 5.5 / duration * time**2)
    return np.asarray(0.35 * (1.0 - np.exp(-time / 0.1)) * (np.sin(phase) + 0.4 * np.sin(2.3 * time)))[:, None]


def record(arm, path, *, seed, duration=2.0, every=1, noise=1e-3, memory=0.0, quantum=0.0):
    """Write a recording of link and motor positions of an arm with one joint.

    every: sampling interval, ms; noise, memory: standard deviation (rad) and correlation time (s) of the noise;
    quantum: resolution of the encoders, rad.
    """
    time, random = np.arange(round(1e3 * duration / every) + 1) * every * 1e-3, np.random.default_rng(seed)
    measured = arm.move(time, lambda at: command(at, duration))[:, 0]
    rho = np.exp(-every * 1e-3 / memory) if memory else 0.0
    measured += noise * lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], random.normal(size=measured.shape), axis=0)
    if quantum:
        measured = quantum * np.round(measured / quantum)
    names = ["reference_1", "link_position", *(f"motor_{i}_position" for i in range(1, 1 + arm.motors))]
    header = ",".join(["time [s]", *(f"joint_1.{name} [rad]" for name in names)])
    np.savetxt(path, np.column_stack([time, command(time, duration), measured]), delimiter=",", header=header, comments="")
    return path


def random_arm(seed, joints=None):
    """Arm number `seed` with two or three joints, a motion for each joint, and the duration of the motions in s."""
    draw = np.random.default_rng([31, seed])
    n = joints or 2 + seed % 2
    actuator = ("sea", "qbmove")[seed // 2 % 2]
    mass, length = draw.uniform(0.3, 1.2, n) * np.linspace(1.0, 0.5, n), draw.uniform(0.12, 0.25, n)
    gravity = 9.81 if draw.random() < 0.7 else 0.0
    load = np.array([np.sum(mass[j:]) * length[j:].sum() for j in range(n)])
    torque, a = np.maximum(5.0 * load, 0.5), draw.uniform(5.0, 9.0, n)
    k = torque * draw.uniform(3.0, 8.0, n) if actuator == "sea" else torque * draw.uniform(0.03, 0.08, n)
    springs = {"spring_stiffness": k} if actuator == "sea" else {"spring_a_1": a, "spring_k_1": k}
    columns = {
        "mass": mass, "length": length, "reach": 0.5 * length, "iyy": mass * length**2 / 12.0, **springs,
        "damping": draw.uniform(0.01, 0.08, n), "friction": draw.uniform(0.0, 0.03, n),
        "motor_1_max_torque": 6.0 * torque + 6.0, "motor_1_friction_torque": draw.uniform(0.01, 0.05, n),
        "controller_1_proportional": np.full(n, 60.0), "controller_1_derivative": np.full(n, 2.0),
    }  # fmt: skip
    numbers = tuple(dict(zip(columns, row, strict=True)) for row in np.column_stack(list(columns.values())).tolist())
    duration = float(draw.uniform(2.0, 3.0))
    motions: dict[str, dict[str, object]] = {}
    for j in range(1, 1 + n):
        goal = float(draw.uniform(0.3, 0.8) * draw.choice([-1.0, 1.0]))
        there, back = 0.55 * duration, 0.45 * duration
        motions[f"joint_{j}"] = {
            "sum": [
                {"minimum_jerk": {"duration": there, "to": goal}},
                {"minimum_jerk": {"start": there, "duration": back, "to": -goal * float(draw.random() < 0.5)}},
            ]
        }
    return SoftArm(actuator, numbers, gravity, preset=0.25), motions, round(duration, 2)


def perturbed(arm, seed):
    """Robot that differs from its model: masses and stiffnesses by up to 25 %, losses by up to 50 %, and a delay of 10 ms."""
    draw = np.random.default_rng([5, seed])
    spread = {"mass": 0.25, "spring_k_1": 0.25, "spring_stiffness": 0.25}
    spread |= dict.fromkeys(("damping", "friction", "motor_1_friction_torque"), 0.5)
    return replace(arm.scaled(lambda name: 1.0 + draw.uniform(-1.0, 1.0) * spread.get(name, 0.0)), delay=0.01)


def differing(arm, seed):
    """Robot whose masses, inertias, stiffnesses and losses are 15 to 40 % larger or smaller than those of its model."""
    draw = np.random.default_rng([7, seed])
    losses = ("damping", "friction", "motor_1_friction_torque", "motor_1_damping")
    names = ("mass", "iyy", "spring_k_1", "spring_stiffness", *losses)
    return arm.scaled(lambda name: 1.0 + draw.choice([-1.0, 1.0]) * draw.uniform(0.15, 0.4) if name in names else 1.0)
