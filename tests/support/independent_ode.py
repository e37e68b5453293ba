"""Independent solution of a random run: the paper's equations with Pinocchio's dynamics, integrated by scipy's DOP853.

No code of asrsim is used: Pinocchio reads the URDF and computes the dynamics, the laws are written again from sections 2 and
3 of the paper, and the integrator has order 8 and ends a step at every jump of an input.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio
from scipy.integrate import solve_ivp

from support.random_runs import JointSpec, RandomRun

Array = np.ndarray
BRISTLES = 1000.0
"""Stiffness of Dahl's friction, N m/rad (paper eq. 8)."""


def clip(x: float, limit: float) -> float:
    return min(max(x, -limit), limit)


def spring(joint: JointSpec, q: float, first: float, second: float) -> tuple[float, float]:
    """Torques on the link from the springs of motor 1 and motor 2, N m (paper eqs. 2 to 6)."""
    p = joint.parameters
    if joint.actuator == "sea":
        return p["spring_stiffness"] * clip(first - q, p["max_deflection"]), 0.0
    if joint.actuator == "awas_ii":
        gain = (
            2.0 * p["spring_stiffness"] * (p["lever_length"] / p["pulley_radius"] * second / (p["lever_length"] - second)) ** 2
        )
        d = clip(first - q, 0.3)
        return gain * np.sin(d) * np.cos(d), 0.0
    if joint.actuator == "qbmove":
        pair = [
            p[f"spring_k_{i}"] * np.sinh(p[f"spring_a_{i}"] * clip(theta - q, 0.8)) for i, theta in ((1, first), (2, second))
        ]
        return float(pair[0]), float(pair[1])
    a, b, k, rate = p["spring_a"], p["spring_b"], p["spring_k"], p["spring_exponent"]
    d_1, d_2 = clip(first - q, 0.27), clip(second - q, 0.27)
    return (
        k * (b * np.exp(rate * d_1) - a * np.exp(-rate * d_1)),
        k * (a * np.exp(rate * d_2) - b * np.exp(-rate * d_2)),
    )


def motors_of(joint: JointSpec) -> int:
    """Number of motors with dynamics."""
    if joint.mode < 4:
        return 0
    return 1 if joint.actuator in ("sea", "awas_ii") else 2


class Truth:
    """Equations of motion of a random run.

    State: pose of a floating base (7), joint positions, velocities (the base first, in its frame), then for each joint the
    error integral of mode 1, or for each motor position, velocity, error integral, bristle deflection and hysteresis torque.
    """

    PER_MOTOR = 5

    def __init__(self, run: RandomRun) -> None:
        self.run = run
        # Pinocchio describes a continuous joint by two numbers. A revolute joint with wide limits needs only one.
        text = run.urdf.replace('type="continuous"', 'type="revolute"')
        text = re.sub(r"<limit effort", '<limit lower="-60" upper="60" effort', text)
        root = [] if run.fixed else [pinocchio.JointModelFreeFlyer()]
        self.model = pinocchio.buildModelFromXML(text, *root)
        self.rotation = pinocchio.rpy.rpyToMatrix(np.array(run.rpy))
        gravity = np.array(run.gravity)
        self.model.gravity.linear = self.rotation.T @ gravity if run.fixed else gravity
        self.data = self.model.createData()
        first_q, first_v = (0, 0) if run.fixed else (7, 6)
        self.q_of = [self.model.joints[self.model.getJointId(j.name)].idx_q for j in run.joints]
        self.v_of = [self.model.joints[self.model.getJointId(j.name)].idx_v for j in run.joints]
        self.base_q, self.base_v = first_q, first_v
        self.nq, self.nv = self.model.nq, self.model.nv
        self.inner = []
        place = self.nq + self.nv
        for joint in run.joints:
            self.inner.append(place)
            place += self.PER_MOTOR * motors_of(joint) + (joint.actuator != "" and joint.mode == 1)
        self.size = place

    def start(self) -> Array:
        state = np.zeros(self.size)
        if not self.run.fixed:
            state[3:7] = pinocchio.Quaternion(self.rotation).coeffs()
        for j, joint in enumerate(self.run.joints):
            state[self.q_of[j]] = joint.start
            state[self.nq + self.v_of[j]] = joint.speed
            for i in range(motors_of(joint)):
                place = self.inner[j] + self.PER_MOTOR * i
                state[place : place + 2] = joint.motors[i] if joint.motors else (joint.start, 0.0)
        return state

    def rate(self, t: float, state: Array, after: bool) -> Array:
        """Time derivative of the state. after: whether an input that jumps at `t` has its value after the jump."""
        run, nq, nv = self.run, self.nq, self.nv
        q, v = state[:nq].copy(), state[nq : nq + nv]
        if not run.fixed:
            q[3:7] /= np.linalg.norm(q[3:7])
        torque, slope = np.zeros(nv), np.zeros(self.size)
        for j, joint in enumerate(run.joints):
            x, speed = float(q[self.q_of[j]]), float(v[self.v_of[j]])
            push = self.actuator(j, joint, t, x, speed, state, slope, after)
            push = clip(push, joint.effort)
            if joint.external is not None:
                push += joint.external(t, after)
            torque[self.v_of[j]] = push + joint.spring * (joint.rest - x)
            torque[self.v_of[j]] -= (joint.damping + joint.constant_damping) * speed
        slope[nq : nq + nv] = pinocchio.aba(self.model, self.data, q, v, torque)
        if not run.fixed:
            turn = pinocchio.Quaternion(q[3:7]).matrix()
            slope[:3] = turn @ v[:3]
            xyz, w = q[3:6], q[6]
            slope[3:6] = 0.5 * (w * v[3:6] + np.cross(xyz, v[3:6]))
            slope[6] = -0.5 * float(xyz @ v[3:6])
        for j in range(len(run.joints)):
            slope[self.q_of[j]] = v[self.v_of[j]]
        return slope

    def actuator(
        self, j: int, joint: JointSpec, t: float, x: float, speed: float, state: Array, slope: Array, after: bool
    ) -> float:
        """Torque on the link before the effort limit. Derivatives of motor and controller states are written to `slope`."""
        if not joint.actuator:
            return 0.0
        p, place = joint.parameters, self.inner[j]
        goals = [wave(max(t - joint.delay, 0.0), after) for wave in joint.references] + [0.0]
        if joint.mode == 0:
            return goals[0]
        if joint.mode == 1:
            error = goals[0] - x
            slope[place] = p["controller_1_integral"] * error
            return p["controller_1_proportional"] * error + float(state[place]) - p["controller_1_derivative"] * speed
        if joint.mode in (3, 6) and joint.actuator in ("qbmove", "bavs"):
            goals = [goals[0] + goals[1], goals[0] - goals[1]]
        if joint.mode < 4:
            return sum(spring(joint, x, goals[0], goals[1]))
        count = motors_of(joint)
        motors = [state[place + self.PER_MOTOR * i :][: self.PER_MOTOR] for i in range(count)]
        second = float(motors[1][0]) if count == 2 else goals[1]
        loads = list(spring(joint, x, float(motors[0][0]), second))
        for i, (theta, omega, integral, bristle, lag) in enumerate(motors):
            here = place + self.PER_MOTOR * i
            if level := p.get("hysteresis_torque"):
                stretching = omega - speed
                slope[here + 4] = (level * stretching - abs(stretching) * lag) / p["hysteresis_deflection"]
                loads[i] += lag
            error = goals[i] - theta
            push = goals[i]
            if joint.mode in (5, 6):
                push = p[f"controller_{i + 1}_proportional"] * error + integral - p[f"controller_{i + 1}_derivative"] * omega
                slope[here + 2] = p[f"controller_{i + 1}_integral"] * error
            push = clip(motor_torque(joint, i + 1, push, omega), p[f"motor_{i + 1}_max_torque"])
            # Dahl friction: bristles bend until they slip.
            slip = p[f"motor_{i + 1}_friction_torque"] / BRISTLES
            bent = clip(bristle, slip)
            slope[here + 3] = 0.0 if (bristle >= slip and omega > 0.0) or (bristle <= -slip and omega < 0.0) else omega
            slope[here] = omega
            slope[here + 1] = (push - loads[i] - BRISTLES * bent - p[f"motor_{i + 1}_damping"] * omega) / p[
                f"motor_{i + 1}_inertia"
            ]
        return sum(loads)


def motor_torque(joint: JointSpec, number: int, command: float, omega: float) -> float:
    """Torque of a motor before its torque limit, N m: tau = n k_t i, u = R i + n k_t omega at the output of the gear."""

    def of(name: str, otherwise: float) -> float:
        return joint.parameters.get(f"motor_{number}_{name}", otherwise)

    constant, resistance = of("torque_constant", 0.0) * of("gear_ratio", 1.0), of("resistance", 0.0)
    if not constant:
        return command
    current = command
    if joint.mode == 4:
        current = command / constant
    elif joint.mode == 7 or (joint.mode in (5, 6) and resistance):
        current = (command - constant * omega) / resistance
    if resistance:
        most, back = of("max_voltage", np.inf), constant * omega
        current = min(max(current, (-most - back) / resistance), (most - back) / resistance)
    return constant * clip(current, of("max_current", np.inf))


def solve(run: RandomRun, times: Array, *, tolerance: float = 1e-11, longest: float = np.inf) -> dict[str, Array]:
    """Joint positions (n, joints), base poses (n, 7) and motor positions at `times`."""
    truth = Truth(run)
    state = truth.start()
    edges = sorted({0.0, float(times[-1]), *(t for t in run.jumps if t < times[-1])})
    rows = np.empty((len(times), truth.size))
    for begin, end in pairwise(edges):
        inside = (times >= begin) & (times <= end)

        def rate(t: float, y: Array, begin: float = begin, end: float = end) -> Array:
            # At the end of an interval between two jumps, inputs have their values before the jump.
            return truth.rate(t, y, after=t < end)

        found: Any = solve_ivp(
            rate,
            (begin, end),
            state,
            method="DOP853",
            t_eval=np.unique([*times[inside], end]),
            rtol=tolerance,
            atol=tolerance,
            max_step=longest,
        )
        if not found.success:
            raise ArithmeticError(found.message)
        picked = np.isin(found.t, times[inside])
        rows[inside] = found.y.T[picked]
        state = found.y[:, -1]
    return {
        "positions": rows[:, truth.q_of],
        "velocities": rows[:, [truth.nq + v for v in truth.v_of]],
        "base": rows[:, : truth.base_q],
        "motors": np.column_stack(
            [rows[:, truth.inner[j]] if motors_of(joint) else np.full(len(times), np.nan) for j, joint in enumerate(run.joints)]
        ),
    }
