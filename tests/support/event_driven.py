"""Independent event-driven solution of a mechanism with dry friction and inelastic stops.

Between events, sliding joints obey smooth equations, and joints that stick or rest at a stop do not move. Events: the velocity
of a sliding joint becomes 0, a joint reaches a stop, a resting joint starts to move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
AT_REST = 1e-9
"""Speed below which a joint is at rest (rad/s), and distance within which it touches its stop (rad)."""


class Dynamics(Protocol):
    """Mass matrix (n, n), and torques (n,) of gravity, velocities and damping, N m."""

    def mass_matrix(self, q: Array) -> Array: ...

    def bias(self, q: Array, v: Array) -> Array: ...


@dataclass(frozen=True)
class Mass:
    """One joint with an inertia (kg m^2) and damping (N m s/rad)."""

    inertia: float
    damping: float = 0.0

    def mass_matrix(self, q: Array) -> Array:
        return np.array([[self.inertia]])

    def bias(self, q: Array, v: Array) -> Array:
        return self.damping * v


@dataclass(frozen=True)
class EventDriven:
    """Mechanism with n joints. friction: friction torques (n,) in N m at the speeds (n,); lower, upper: stops (n,), rad."""

    model: Dynamics
    friction: Callable[[Array], Array]
    lower: tuple[float, ...] = (-np.inf,)
    upper: tuple[float, ...] = (np.inf,)

    def motion(self, q: Array, v: Array, push: Array, signs: Sequence[int]) -> tuple[Array, Array]:
        """Accelerations (n,), and torques (n,) of friction or stops that keep resting joints (sign 0) at rest.

        signs: direction in which each joint slides, or 0.
        """
        inertia = self.model.mass_matrix(q)
        force = push - self.model.bias(q, v) - self.friction(np.abs(v)) * signs
        free = [j for j, sign in enumerate(signs) if sign]
        acceleration = np.zeros(len(q))
        if free:
            acceleration[free] = np.linalg.solve(inertia[np.ix_(free, free)], force[free])
        return acceleration, inertia @ acceleration - force

    def outward(self, q: Array) -> list[int]:
        """1 for a joint at its upper stop, -1 at its lower stop, otherwise 0."""
        stops = zip(q, self.lower, self.upper, strict=True)
        return [1 if x >= upper - AT_REST else -1 if x <= lower + AT_REST else 0 for x, lower, upper in stops]

    def bounds(self, q: Array, j: int) -> tuple[float, float]:
        """Smallest and largest torque that friction and stop can exert on the resting joint j."""
        level, side = self.friction(np.zeros(len(q)))[j], self.outward(q)[j]
        return (-np.inf if side > 0 else -level), (np.inf if side < 0 else level)

    def signs(self, q: Array, v: Array, push: Array) -> tuple[int, ...]:
        """Direction in which each joint slides; 0 for a joint at rest."""
        choices = [(int(np.sign(speed)),) if abs(speed) > AT_REST else (0, 1, -1) for speed in v]
        for signs in product(*choices):
            acceleration, holding = self.motion(q, v, push, signs)
            good = True
            for j, sign in enumerate(signs):
                low, high = self.bounds(q, j)
                if sign == 0:
                    good &= low <= holding[j] <= high
                elif abs(v[j]) <= AT_REST:
                    good &= sign * acceleration[j] > 0.0 and np.isfinite(low if sign > 0 else high)
            if good:
                return signs
        raise AssertionError("no consistent state")

    def impact(self, q: Array, v: Array) -> Array:
        """Velocities after the impacts at the stops."""
        inverse, outward = np.linalg.inv(self.model.mass_matrix(q)), self.outward(q)
        touching = [j for j, side in enumerate(outward) if side]
        for chosen in ([], *([j] for j in touching), touching):
            impulse = np.zeros(len(q))
            if chosen:
                impulse[chosen] = -np.linalg.solve(inverse[np.ix_(chosen, chosen)], v[chosen])
            after = v + inverse @ impulse
            after[chosen] = 0.0
            if all(outward[j] * impulse[j] <= 0.0 and outward[j] * after[j] <= AT_REST for j in touching):
                return after
        raise AssertionError("no consistent impact")

    def move(self, q: Array, v: Array, push: Callable[[float, Array], Array], times: Array) -> tuple[Array, int]:
        """Positions and velocities (n, 2 joints) at `times` (n,), the first of which is the start, and number of events.

        push: torques (joints,) at a time and at positions, N m.
        """
        n, now, events = len(q), float(times[0]), 0
        q, v = np.array(q, float), self.impact(np.array(q, float), np.array(v, float))
        rows = [np.concatenate([q, v])[None]]
        while now < times[-1]:
            signs = self.signs(q, v, push(now, q))

            def motion(t: float, y: Array, signs: tuple[int, ...] = signs) -> tuple[Array, Array]:
                return self.motion(y[:n], y[n:], push(t, y[:n]), signs)

            watched: list[Callable[[float, Array], float]] = []
            for j, sign in enumerate(signs):
                if sign:
                    target = self.upper[j] if sign > 0 else self.lower[j]
                    watched.append(lambda t, y, j=j, s=sign: s * y[n + j] + AT_REST)
                    if np.isfinite(target):
                        watched.append(lambda t, y, j=j, s=sign, target=target: s * (target - y[j]))
                    continue
                for side, bound in zip((1, -1), self.bounds(q, j), strict=True):
                    if np.isfinite(bound):
                        watched.append(lambda t, y, j=j, s=side, b=bound, motion=motion: s * (motion(t, y)[1][j] - b) + 1e-9)
            for event in watched:
                event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
            found = solve_ivp(
                lambda t, y, motion=motion: np.concatenate([y[n:], motion(t, y)[0]]),
                (now, times[-1]),
                np.concatenate([q, v]),
                events=watched,
                dense_output=True,
                rtol=1e-10,
                atol=1e-12,
                max_step=5e-3,
            )
            inside = (times > now) & (times <= found.t[-1])
            if inside.any():
                rows.append(found.sol(times[inside]).T)
            now, q, v = float(found.t[-1]), found.y[:n, -1].copy(), found.y[n:, -1].copy()
            if found.status != 1:
                break
            events += 1
            near = np.clip(q, self.lower, self.upper)
            q = np.where(np.abs(near - q) < AT_REST, near, q)
            v[np.abs(v) <= 2 * AT_REST] = 0.0
            v = self.impact(q, v)
        return np.concatenate(rows), events
