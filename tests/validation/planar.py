"""An independent solution: equations of motion of a planar chain with elastic joints, written down and integrated here.

Nothing of the simulator is used but the springs' laws: Lagrange's equations in absolute angles, motors, PID controllers and
damping as first-order equations, solved by an eighth-order Runge-Kutta method (DOP853) between jumps of inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from asrsim.actuators import ACTUATORS, MODES
from asrsim.samples import Array
from asrsim.simulation.run import Run
from validation.models import Body

MARGIN = 1e-12
"""s."""
Input = Callable[[float], float]


@dataclass(frozen=True, kw_only=True)
class Planar:
    """A chain of bodies that turn about y, each hanging below the one before; see :class:`validation.models.Body`."""

    bodies: tuple[Body, ...]
    gravity: float = 9.81
    _coupling: Array = field(init=False, repr=False)
    _weights: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = len(self.bodies)
        mass = np.array([body.mass for body in self.bodies])
        # Lever of angle i in the position of centre of mass k: its own reach, or the whole length of a link before it.
        levers = np.array([
            [body.reach if i == k else (self.bodies[i].length if i < k else 0.0) for i in range(n)]
            for k, body in enumerate(self.bodies)
        ])  # fmt: skip
        coupling = np.einsum("k,ki,kj->ij", mass, levers, levers)
        object.__setattr__(self, "_coupling", coupling)
        object.__setattr__(self, "_weights", levers.T @ mass)

    def mass_matrix(self, q: Array) -> Array:
        """(n, n) kg m^2 in joint angles."""
        to_absolute = np.tril(np.ones((len(q), len(q))))
        return np.asarray(to_absolute.T @ self._absolute_mass(to_absolute @ q) @ to_absolute)

    def _absolute_mass(self, angles: Array) -> Array:
        spread = np.diag([body.inertia for body in self.bodies])
        return np.asarray(self._coupling * np.cos(angles[:, None] - angles[None, :]) + spread)

    def acceleration(self, q: Array, speed: Array, torque: Array) -> Array:
        """(n,) rad/s^2 of the joints under joint torques (n,) N m."""
        n = len(q)
        angles, turning = np.cumsum(q), np.cumsum(speed)
        # A joint's torque turns its link and, the other way round, the link before.
        load = torque - np.append(torque[1:], 0.0)
        load = load - (self._coupling * np.sin(angles[:, None] - angles[None, :])) @ turning**2
        load -= self.gravity * self._weights * np.sin(angles)
        return np.diff(np.linalg.solve(self._absolute_mass(angles), load), prepend=np.zeros(1)) if n else load

    @property
    def swing(self) -> float:
        """J between hanging and standing upright."""
        return 2.0 * self.gravity * float(np.sum(self._weights))

    def energy(self, q: Array, speed: Array) -> float:
        """Kinetic and gravitational energy in J."""
        kinetic = 0.5 * float(speed @ self.mass_matrix(q) @ speed)
        return kinetic - self.gravity * float(self._weights @ np.cos(np.cumsum(q)))


def solve(
    result: Run,
    bodies: Sequence[Body],
    *,
    gravity: float,
    inputs: Sequence[tuple[Input, Input, Input]],
    jumps: Sequence[float] = (),
    step: float,
) -> Array:
    """Positions (n, joints) rad at whole steps of the motion that `result` simulated, actuators and modes as there.

    inputs: reference 1, reference 2 and external torque of each joint as functions of time; jumps: times at which one is not
    smooth. Dahl friction is left out: it must be 0.
    """
    from scipy.integrate import solve_ivp

    model = Planar(bodies=tuple(bodies), gravity=gravity)
    n = len(bodies)
    blocks = {block.joint: block for block in result.robot.actuators}
    joints = [_JointLaw(body, blocks.get(f"joint_{j + 1}"), inputs[j], n) for j, body in enumerate(bodies)]
    sizes = [6 if joint.dynamic else 0 for joint in joints]
    starts = 2 * n + np.concatenate([[0], np.cumsum(sizes)]).astype(int)

    def derivative(t: float, state: Array) -> Array:
        q, speed = state[:n], state[n : 2 * n]
        out = np.empty_like(state)
        torque = np.empty(n)
        for j, joint in enumerate(joints):
            part = slice(starts[j], starts[j + 1])
            torque[j], out[part] = joint(t, q[j], speed[j], state[part])
        out[:n] = speed
        out[n : 2 * n] = model.acceleration(q, speed, torque)
        return out

    initial = [result.scenario.initial_positions.get(f"joint_{j + 1}", 0.0) for j in range(n)]
    state = np.concatenate([initial, np.zeros(n), *([q, 0.0, 0.0] * 2 for q, size in zip(initial, sizes, strict=True) if size)])
    count = round(result.scenario.duration / step)
    times = np.arange(count + 1) * step
    positions = np.empty((count + 1, n))
    edges = [0.0, *sorted(t for t in jumps if 0.0 < t < times[-1]), times[-1] + step]
    for start, end in pairwise(edges):
        inside = (times >= start - 1e-12) & (times <= end + 1e-12)
        # A little inside the piece, so that no input is read across its jump.
        solution = solve_ivp(
            lambda t, x, a=start + MARGIN, b=end - MARGIN: derivative(min(max(t, a), b), x),
            (start, end), state, method="DOP853", rtol=1e-11, atol=1e-12, dense_output=True,
        )  # fmt: skip
        positions[inside] = solution.sol(times[inside])[:n].T
        state = solution.y[:, -1]
    return positions


class _JointLaw:
    """Torque on a link and derivative of its motors' states (position, velocity, integral, twice)."""

    def __init__(self, body: Body, block: Any, inputs: tuple[Input, Input, Input], joints: int) -> None:
        self.damping = body.damping
        self.inputs = inputs
        self.mode = MODES[block.mode] if block else None
        self.dynamic = bool(self.mode and self.mode.motor)
        if block is None:
            return
        self.law = ACTUATORS.get(block.actuator)
        self.values = block.values()
        self.elastic = tuple(self.values[parameter.name] for parameter in self.law.parameters)

    def __call__(self, t: float, q: float, speed: float, state: Array) -> tuple[float, Array]:
        first, second, external = (signal(t) for signal in self.inputs)
        passive = external - self.damping * speed
        if self.mode is None:
            return passive, state
        if self.mode.number == 0:
            return first + passive, state
        if self.mode.number == 1:
            p, d = self.values["controller_1_proportional"], self.values["controller_1_derivative"]
            return p * (first - q) - d * speed + passive, state
        goals = self.law.motor_references(first, second) if self.mode.mapped else (first, second)
        if not self.dynamic:
            return sum(self.law.elastic_torques(q, *goals, self.elastic)) + passive, state
        theta_2 = goals[1] if self.law.motors == 1 else state[3]
        torques = self.law.elastic_torques(q, state[0], theta_2, self.elastic)
        change = np.zeros(6)
        for i in range(self.law.motors):
            angle, rate, integral = state[3 * i : 3 * i + 3]
            values = {name: self.values[f"motor_{i + 1}_{name}"] for name in ("inertia", "damping", "max_torque")}
            push = goals[i]
            if self.mode.controller:
                gains = [self.values[f"controller_{i + 1}_{name}"] for name in ("proportional", "integral", "derivative")]
                error = goals[i] - angle
                change[3 * i + 2] = gains[1] * error
                push = gains[0] * error + integral - gains[2] * rate
            push = min(max(push, -values["max_torque"]), values["max_torque"])
            change[3 * i] = rate
            change[3 * i + 1] = (push - torques[i] - values["damping"] * rate) / values["inertia"]
        return sum(torques) + passive, change
