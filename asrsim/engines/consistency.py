"""Test of a user's equations of motion M(q) dv/dt + b(q, v) = torques: the bias b must belong to the mass matrix M.

The derivative of the kinetic energy 1/2 v' M v is the power of the torques, minus v' b(q, v), plus 1/2 v' (dM/dt) v. Gravity
and springs, which are b(q, 0), must be the gradient of an energy. The rest of the bias must not create energy:

    v' (b(q, v) - b(q, 0)) >= 1/2 v' (dM/dt) v        for every q and v

The two sides are equal without drag. The power of Coriolis and centrifugal terms changes its sign with v. So a wrong term
violates the inequality at v or at -v if v is large enough, even if there is drag. Murray, Li and Sastry (1994), A Mathematical
Introduction to Robotic Manipulation, section 4.3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from asrsim.errors import Problem
from asrsim.samples import Array

Equations = Callable[[Array, Array], tuple[Array, Array]]
"""Function from positions (n,) and velocities (n,) to mass matrix (n, n) and bias (n,)."""
TRIALS = 3
"""Number of random positions."""
SPEEDS = (1.0, 1e2, 1e4)
"""Largest speeds in rad/s (m/s) at each of the positions: the larger the speed, the less a drag hides a wrong term."""
NUDGES = (1e-3, 1e-5)
"""Displacements in rad (m) of the finite differences. The two results differ by about the error of these
differences.
"""
STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
"""Places and weights of a central difference of fourth order."""
ROUNDING = 1e-6
"""Relative error of a power or a derivative that counts as rounding."""
SMALLEST = 1e-10
"""Rounding error of a difference over the smallest nudge, relative to the largest entry of the equations."""


def inconsistency(equations: Equations, joints: Sequence[str], lower: Array, upper: Array) -> Problem | None:
    """The fault of the equations at random positions between `lower` and `upper` (n,), in rad or m; None if the equations are
    correct."""
    random, count = np.random.default_rng(0), len(joints)
    for _ in range(TRIALS):
        q = lower + (upper - lower) * random.uniform(0.05, 0.95, count)
        direction = random.uniform(0.3, 1.0, count) * random.choice((-1.0, 1.0), count)
        slopes, doubts = _slopes(equations, q)
        fault = _fault_at_rest(joints, q, slopes[:, count], doubts[:, count])
        for speed in SPEEDS:
            fault = fault or _fault_in_motion(equations, joints, q, speed * direction, slopes[:, :count], doubts[:, :count])
        if fault is not None:
            return fault
    return None


def _slopes(equations: Equations, q: Array) -> tuple[Array, Array]:
    """Derivatives (n, n + 1, n) of the rows of the mass matrix and of the bias at rest, by each position, and their errors."""

    def rows(place: Array) -> Array:
        return np.vstack(equations(place, np.zeros_like(q)))

    found = [
        np.array([sum(w * rows(q + k * nudge * axis) for k, w in STENCIL) / nudge for axis in np.eye(len(q))])
        for nudge in NUDGES
    ]
    doubts = np.abs(found[1] - found[0]) + ROUNDING * np.abs(found[1]).max(axis=0, initial=0.0)
    return found[1], doubts + SMALLEST * np.abs(rows(q)).max(initial=0.0)


def _fault_at_rest(joints: Sequence[str], q: Array, slopes: Array, doubts: Array) -> Problem | None:
    """The fault of the bias at rest. slopes: its derivatives, (position, joint)."""
    excess = np.abs(slopes - slopes.T) - doubts - doubts.T
    j, i = divmod(int(excess.argmax()), len(joints))
    if excess[j, i] <= ROUNDING * np.abs(slopes).max():
        return None
    message = (
        "the engine's bias at rest is not the gradient of an energy, as gravity and springs are: the derivative of the entry "
        f"of joint '{joints[i]}' by the position of '{joints[j]}' is {slopes[j, i]:.6g}, but the entry of '{joints[j]}' has "
        f"the derivative {slopes[i, j]:.6g} by the position of '{joints[i]}', at the positions {q.tolist()}"
    )
    return Problem(message, code="engine")


def _fault_in_motion(
    equations: Equations, joints: Sequence[str], q: Array, v: Array, slopes: Array, doubts: Array
) -> Problem | None:
    """The fault of the bias at the velocities v and -v. slopes: derivatives of the mass matrix, (position, row, column)."""
    rest, ahead, back = (equations(q, velocity)[1] for velocity in (0.0 * v, v, -v))
    size = np.abs(v)
    given = 0.5 * v @ np.tensordot(v, slopes, 1) @ v
    margin = ROUNDING * (size @ (np.abs(ahead) + np.abs(back) + np.abs(rest)) + abs(given))
    margin += 0.5 * size @ np.tensordot(size, doubts, 1) @ size
    if min(v @ (ahead - rest) - given, given - v @ (back - rest)) >= -margin:
        return None
    # Compute the Coriolis and centrifugal torques that belong to the mass matrix, by Christoffel symbols.
    due = np.tensordot(v, slopes, 1) @ v - 0.5 * slopes @ v @ v
    even, odd = 0.5 * (ahead + back) - rest, 0.5 * (ahead - back)
    worst = int(np.abs(v * (even - due)).argmax())
    if size[worst] * abs(even[worst] - due[worst]) > margin:
        message = (
            f"the engine's bias does not belong to its mass matrix: the velocities change the entry of joint '{joints[worst]}' "
            f"by {even[worst]:.6g}, but the Coriolis and centrifugal terms of the mass matrix are {due[worst]:.6g}"
        )
    else:
        worst = int((v * odd).argmin())
        message = (
            f"the engine's bias drives the joint '{joints[worst]}': its entry contains {odd[worst]:.6g} at the velocity "
            f"{v[worst]:.6g}, but a drag has the sign of the velocity"
        )
    return Problem(f"{message}, at the positions {q.tolist()} and the velocities {v.tolist()}", code="engine")
