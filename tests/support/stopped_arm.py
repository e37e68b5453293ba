"""Independent event-driven solution of an arm with two joints, friction and inelastic stops, on Pinocchio's dynamics.

Between events, moving joints obey smooth equations, and joints that stick or rest at a stop do
not move. Events: a sliding joint stops, a joint reaches a stop, a resting joint starts to move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp

from support.pinocchio_model import PinocchioModel

Array = np.ndarray
AT_REST = 1e-9
"""Speed below which a joint is at rest (rad/s), and distance within which it touches its stop (rad)."""


@dataclass(frozen=True)
class StoppedArm:
    """Arm with the dynamics of its robot file; friction (N m) and stops (rad) of its two joints."""

    model: PinocchioModel
    friction: tuple[float, float]
    lower: tuple[float, float]
    upper: tuple[float, float]

    def held(self, q: Array, v: Array, push: Array, signs: tuple[int, ...]) -> tuple[Array, Array]:
        """Accelerations (2,), and torques (2,) of friction or stops that keep resting joints (sign 0) at rest.

        signs: direction in which each joint slides, or 0.
        """
        inertia = self.model.mass_matrix(q)
        force = push - self.model.bias(q, v) - np.array(self.friction) * signs
        free = [j for j in (0, 1) if signs[j]]
        acceleration = np.zeros(2)
        if free:
            acceleration[free] = np.linalg.solve(inertia[np.ix_(free, free)], force[free])
        return acceleration, inertia @ acceleration - force

    def bounds(self, q: Array, j: int) -> tuple[float, float]:
        """Smallest and largest torque that friction and stop can exert on the resting joint j."""
        low, high = -self.friction[j], self.friction[j]
        return (-np.inf if q[j] >= self.upper[j] - AT_REST else low), (np.inf if q[j] <= self.lower[j] + AT_REST else high)

    def signs(self, q: Array, v: Array, push: Array) -> tuple[int, ...]:
        """Direction in which each joint slides; 0 for a joint at rest."""
        choices = [(int(np.sign(v[j])),) if abs(v[j]) > AT_REST else (0, 1, -1) for j in (0, 1)]
        for signs in product(*choices):
            acceleration, holding = self.held(q, v, push, signs)
            good = True
            for j in (0, 1):
                low, high = self.bounds(q, j)
                if signs[j] == 0:
                    good &= low <= holding[j] <= high
                elif abs(v[j]) <= AT_REST:
                    good &= signs[j] * acceleration[j] > 0.0 and np.isfinite(low if signs[j] > 0 else high)
            if good:
                return signs
        raise AssertionError("no consistent state")

    def impact(self, q: Array, v: Array) -> Array:
        """Velocities after the impacts at the stops."""
        inverse = np.linalg.inv(self.model.mass_matrix(q))
        outward = [1 if q[j] >= self.upper[j] - AT_REST else -1 if q[j] <= self.lower[j] + AT_REST else 0 for j in (0, 1)]
        touching = [j for j in (0, 1) if outward[j]]
        for chosen in ([], *([j] for j in touching), touching):
            impulse = np.zeros(2)
            if chosen:
                impulse[chosen] = -np.linalg.solve(inverse[np.ix_(chosen, chosen)], v[chosen])
            after = v + inverse @ impulse
            after[chosen] = 0.0
            if all(outward[j] * impulse[j] <= 0.0 and outward[j] * after[j] <= AT_REST for j in touching):
                return after
        raise AssertionError("no consistent impact")

    def move(self, q: Array, v: Array, push: Callable[[float], Array], end: float) -> tuple[Array, Array, int]:
        """Positions and velocities at the time `end` in s, and number of events."""
        now, events = 0.0, 0
        q, v = np.array(q, float), self.impact(q, np.array(v, float))
        while now < end:
            signs = self.signs(q, v, push(now))

            def rate(t: float, y: Array, signs: tuple[int, ...] = signs) -> Array:
                return np.concatenate([y[2:], self.held(y[:2], y[2:], push(t), signs)[0]])

            watched = []
            for j in (0, 1):
                if signs[j]:
                    target = self.upper[j] if signs[j] > 0 else self.lower[j]
                    watched += [lambda t, y, j=j, s=signs[j]: s * y[2 + j] + AT_REST]
                    watched += [lambda t, y, j=j, s=signs[j], target=target: s * (target - y[j])]
                else:
                    for side, bound in enumerate(self.bounds(q, j)):
                        if np.isfinite(bound):
                            watched += [
                                lambda t, y, j=j, side=side, bound=bound, signs=signs: (
                                    (1 - 2 * side) * (self.held(y[:2], y[2:], push(t), signs)[1][j] - bound) + 1e-9
                                )
                            ]
            for event in watched:
                event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
            found = solve_ivp(
                rate, (now, end), np.concatenate([q, v]), events=watched, rtol=1e-10, atol=1e-12, max_step=5e-3
            )  # fmt: skip
            now, q, v = found.t[-1], found.y[:2, -1].copy(), found.y[2:, -1].copy()
            if found.status != 1:
                break
            events += 1
            q = np.clip(q, self.lower, self.upper) if np.any(np.abs(np.clip(q, self.lower, self.upper) - q) < AT_REST) else q
            v[np.abs(v) <= 2 * AT_REST] = 0.0
            v = self.impact(q, v)
        return q, v, events
