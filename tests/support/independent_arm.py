"""Planar arm with elastic joints, simulated independently of asrsim.

At q = 0, the links hang down. The axes are parallel. Each joint has one motor with a linear spring (SEA), or two motors
with springs tau_i = k sinh(a (theta_i - q)) (qbMove). Motors: J theta'' + D theta' + F_m tanh(theta' / v) =
clip(P (goal - theta) - D' theta') - tau_i. Commands arrive `delay` s late; until then, motors rest at their presets.
Integrator: fourth-order Runge-Kutta with steps of 0.1 ms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numba import njit

Array = np.ndarray
GAIN, BRAKE, ROTOR, DRAG, CREEP, PRESET = 60.0, 2.0, 0.02, 0.2, 0.01, 0.25
"""Controller gains (N m/rad, N m s/rad), motor inertia (kg m^2) and damping (N m s/rad), speed below which friction is
viscous (rad/s), preset (rad)."""


@njit(cache=True)
def _rate(y, goals, n, motors, law, mass, length, damping, friction, k, a, most, rub, gravity):  # type: ignore[no-untyped-def]
    out = np.zeros(len(y))
    q, v = y[:n], y[n : 2 * n]
    phi, omega = np.cumsum(q), np.cumsum(v)
    torque = np.zeros(n)
    for j in range(n):
        torque[j] = -damping[j] * v[j] - friction[j] * np.tanh(v[j] / CREEP)
        for i in range(motors):
            place = 2 * n + 2 * (motors * j + i)
            theta, speed = y[place], y[place + 1]
            bent = theta - q[j]
            spring = k[j] * bent if law == 0 else k[j] * np.sinh(a[j] * bent)
            drive = min(max(GAIN * (goals[j, i] - theta) - BRAKE * speed, -most[j]), most[j])
            torque[j] += spring
            out[place] = speed
            out[place + 1] = (drive - spring - DRAG * speed - rub[j] * np.tanh(speed / CREEP)) / ROTOR
    matrix, push = np.zeros((n, n)), torque.copy()
    push[:-1] -= torque[1:]
    for link in range(n):
        matrix[link, link] += mass[link] * length[link] ** 2 / 12.0
        for i in range(link + 1):
            first = 0.5 * length[i] if i == link else length[i]
            push[i] -= gravity * mass[link] * first * np.sin(phi[i])
            for j in range(link + 1):
                both = mass[link] * first * (0.5 * length[j] if j == link else length[j])
                matrix[i, j] += both * np.cos(phi[i] - phi[j])
                push[i] -= both * np.sin(phi[i] - phi[j]) * omega[j] ** 2
    turned = np.linalg.solve(matrix, push)
    out[:n] = v
    out[n] = turned[0]
    out[n + 1 : 2 * n] = turned[1:] - turned[:-1]
    return out


@njit(cache=True)
def _integrate(goals, starts, every, step, n, motors, law, mass, length, damping, friction, k, a, most, rub, gravity):  # type: ignore[no-untyped-def]
    """Joint positions (rows, joints), one row per `every` steps. goals: setpoints (2 m + 1, joints, motors) at half steps."""
    count = (len(goals) - 1) // 2
    y, rows = np.zeros(2 * n + 2 * n * motors), np.empty((count // every + 1, n))
    for j in range(n):
        for i in range(motors):
            y[2 * n + 2 * (motors * j + i)] = starts[i]
    p = (n, motors, law, mass, length, damping, friction, k, a, most, rub, gravity)
    for s in range(count + 1):
        if s % every == 0:
            rows[s // every] = y[:n]
        if s == count:
            break
        k1 = _rate(y, goals[2 * s], *p)
        k2 = _rate(y + 0.5 * step * k1, goals[2 * s + 1], *p)
        k3 = _rate(y + 0.5 * step * k2, goals[2 * s + 1], *p)
        k4 = _rate(y + step * k3, goals[2 * s + 2], *p)
        y = y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return rows


@dataclass(frozen=True)
class Arm:
    """Parameters of an arm, each an array (joints,)."""

    actuator: str
    mass: Array
    length: Array
    damping: Array
    friction: Array
    k: Array
    a: Array
    most: Array
    """Torque limit of each motor, N m."""
    rub: Array
    """Friction of each motor, N m."""
    gravity: float
    delay: float = 0.0

    @property
    def joints(self) -> int:
        return len(self.mass)

    @property
    def motors(self) -> int:
        return 2 if self.actuator == "qbmove" else 1

    def move(self, time: Array, inputs: Array, step: float = 1e-4) -> Array:
        """Link positions (n, joints) at `time`. inputs: equilibrium positions (n, joints), linearly interpolated."""
        half = np.arange(0.0, time[-1] + 0.25 * step, 0.5 * step)
        goals = np.column_stack([np.interp(half - self.delay, time, column, left=0.0) for column in inputs.T])
        offsets = np.array([PRESET, -PRESET]) if self.motors == 2 else np.zeros(1)
        law, every = int(self.motors == 2), round((time[1] - time[0]) / step)
        return _integrate(
            goals[:, :, None] + offsets, offsets, every, step, self.joints, self.motors, law, self.mass, self.length,
            self.damping, self.friction, self.k, self.a, self.most, self.rub, self.gravity,
        )  # fmt: skip

    def other(self, seed: int, share: float = 0.25, losses: float = 0.5, delay: float = 0.01) -> Arm:
        """Perturbed arm. Masses and stiffnesses change by up to the fraction `share`, friction and damping by `losses`."""
        draw = np.random.default_rng([5, seed])

        def off(values: Array, amount: float) -> Array:
            return values * (1.0 + draw.uniform(-amount, amount, len(values)))

        return replace(
            self, mass=off(self.mass, share), k=off(self.k, share), damping=off(self.damping, losses),
            friction=off(self.friction, losses), rub=off(self.rub, losses), delay=delay,
        )  # fmt: skip

    def write(self, folder: Path, motion: dict[str, object], duration: float, **ilc: object) -> Path:
        """Write robot and scenario of asrsim with these parameters, and return the scenario. motion: signal of each joint."""
        folder.mkdir(parents=True, exist_ok=True)
        parts, parameters, references = ['<link name="world"/>'], {}, {}
        for j in range(self.joints):
            name, length, mass = f"joint_{j + 1}", self.length[j], self.mass[j]
            own, up = mass * length**2 / 12.0, 0.0 if j == 0 else -self.length[j - 1]
            parts.append(
                f'<joint name="{name}" type="revolute"><origin xyz="0 0 {up}"/><parent link="{f"link_{j}" if j else "world"}"/>'
                f'<child link="link_{j + 1}"/><axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="1000" velocity="1000"/>'
                f'<dynamics damping="{self.damping[j]}" friction="{self.friction[j]}"/></joint><link name="link_{j + 1}">'
                f'<inertial><origin xyz="0 0 {-0.5 * length}"/><mass value="{mass}"/><inertia ixx="{own}" iyy="{own}" '
                f'izz="{0.1 * own}" ixy="0" ixz="0" iyz="0"/></inertial></link><gazebo><plugin name="drive_{j}" '
                f'filename="lib{self.actuator}_plugin.so"><joint>{name}</joint><operation_mode>6</operation_mode>'
                "<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau></plugin></gazebo>"
            )
            springs = {"spring_stiffness": self.k[j]} if self.motors == 1 else {}
            for i in range(1, self.motors + 1):
                if self.motors == 2:
                    springs |= {f"spring_a_{i}": self.a[j], f"spring_k_{i}": self.k[j]}
                springs |= {
                    f"controller_{i}_proportional": GAIN, f"controller_{i}_derivative": BRAKE, f"controller_{i}_integral": 0.0,
                    f"motor_{i}_inertia": ROTOR, f"motor_{i}_damping": DRAG, f"motor_{i}_max_torque": self.most[j],
                    f"motor_{i}_max_velocity": 1000.0, f"motor_{i}_friction_torque": self.rub[j],
                }  # fmt: skip
            parameters[name] = {key: float(value) for key, value in springs.items()} | {"max_deflection": 3.0}
            references[name] = {"stiffness_preset": PRESET} if self.motors == 2 else {}
        import yaml

        (folder / "arm.urdf").write_text('<robot name="arm">' + "\n".join(parts) + "</robot>\n")
        scenario = {
            "robot": "arm.urdf", "duration": duration, "engine": "mujoco", "gravity": [0.0, 0.0, -self.gravity],
            "initial": "equilibrium", "parameters": parameters, "references": {k: v for k, v in references.items() if v},
            "ilc": {"trajectory": motion, "tolerance": 0.005, "max_iterations": 15, **ilc},
        }  # fmt: skip
        (folder / "arm.yaml").write_text(yaml.safe_dump(scenario))
        return folder / "arm.yaml"


def random_arm(seed: int) -> tuple[Arm, dict[str, object], float]:
    """Arm number `seed` with two or three joints, a motion for the arm, and the duration of the motion in s."""
    draw = np.random.default_rng([31, seed])
    n = 2 + seed % 2
    actuator = ("sea", "qbmove")[seed // 2 % 2]
    mass, length = draw.uniform(0.3, 1.2, n) * np.linspace(1.0, 0.5, n), draw.uniform(0.12, 0.25, n)
    gravity = 9.81 if draw.random() < 0.7 else 0.0
    reach = np.array([length[j:].sum() for j in range(n)])
    load = np.array([np.sum(mass[j:] * reach[j]) for j in range(n)])
    torque = np.maximum(5.0 * load, 0.5)
    a = draw.uniform(5.0, 9.0, n)
    k = torque * draw.uniform(3.0, 8.0, n) if actuator == "sea" else torque * draw.uniform(0.03, 0.08, n)
    arm = Arm(
        actuator=actuator, mass=mass, length=length, damping=draw.uniform(0.01, 0.08, n), friction=draw.uniform(0.0, 0.03, n),
        k=k, a=a, most=6.0 * torque + 6.0, rub=draw.uniform(0.01, 0.05, n), gravity=gravity,
    )  # fmt: skip
    duration = float(draw.uniform(2.0, 3.0))
    motion: dict[str, object] = {}
    for j in range(n):
        goal = float(draw.uniform(0.3, 0.8) * draw.choice([-1.0, 1.0]))
        there = {"minimum_jerk": {"duration": 0.55 * duration, "to": goal}}
        back = {
            "minimum_jerk": {"start": 0.55 * duration, "duration": 0.45 * duration, "to": -goal * float(draw.random() < 0.5)}
        }
        motion[f"joint_{j + 1}"] = {"sum": [there, back]}
    return arm, motion, round(duration, 2)
