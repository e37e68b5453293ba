"""Positions at which the torques on the joints of a robot balance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.rest import FLAT, LONGEST, NUDGE

Array = NDArray[np.float64]
BALANCED = 1e-10
"""Largest residual torque of a joint at equilibrium, N m (N)."""
SHOVE = 1e-2
"""Displacement by which the search leaves an unstable equilibrium, rad (m)."""
ROUNDS = 200
"""Largest number of steps of Newton's method."""


Loads = Callable[[Array], tuple[Array, Array]]
"""Function from positions (m, n) to the torques of gravity and other loads on the joints (m, n) in N m, and to their slopes
(m, n, n): entry [i, j] is the change of torque j per displacement of joint i."""


def by_differences(loads: Callable[[Array], Array], movable: NDArray[np.bool_]) -> Loads:
    """Loads whose slopes are finite differences. loads: function from positions (m, k, n) to torques (m, k, n); movable: mask
    (n,) of the joints for which slopes are computed."""
    # The first row contains the positions. In each further row, one of the movable joints is displaced.
    nudges = NUDGE * np.vstack([np.zeros(len(movable)), np.eye(len(movable))[movable]])

    def sloped(positions: Array) -> tuple[Array, Array]:
        values, slopes = loads(positions[:, None] + nudges), np.zeros((*positions.shape, len(movable)))
        slopes[:, movable] = (values[:, 1:] - values[:, :1]) / NUDGE
        return values[:, 0], slopes

    return sloped


Springs = Callable[[Array], tuple[Array, Array]]
"""Function from positions (m, n) to the torques of springs on the joints (m, n) in N m, and to their changes (m, n) per
displacement of their joints. Each torque depends on the position of its own joint only."""


def springs_by_differences(springs: Callable[[Array], Array]) -> Springs:
    """Springs whose changes are finite differences. springs: function from positions (m, k, n) to torques (m, k, n)."""

    def sloped(positions: Array) -> tuple[Array, Array]:
        torques = springs(np.stack([positions, positions + NUDGE], axis=1))
        return torques[:, 0], (torques[:, 1] - torques[:, 0]) / NUDGE

    return sloped


def balanced(
    loads: Loads,
    springs: Springs,
    start: Array,
    low: Array,
    high: Array,
    movable: NDArray[np.bool_],
    *,
    close: float = 0.0,
    shove: float = SHOVE,
) -> tuple[Array, Array]:
    """Positions (m, n) of m robots at rest, and the torques (m, n) that remain on joints that are free to move.

    The remaining torques are nearly 0. They are NaN for a robot with infinite torques.

    Newton's method minimises the potential energy, beginning at `start` (m, n). A joint that is pressed onto its stop rests
    there. low, high: stops (n,), rad (m). movable: mask (n,) of the joints that may move. close: distance from the balance at
    which the search ends, rad (m); 0: the search ends when the torques balance. shove: displacement by which the search leaves
    an unstable equilibrium, rad (m).
    """
    q, count = start.copy(), start.shape[1]
    residual, before, share = np.zeros_like(q), np.zeros_like(q), np.ones((len(q), 1))
    slopes = np.zeros((len(q), count, count))
    for _ in range(ROUNDS):
        (values, changes), (pulls, own) = loads(q), springs(q)
        left = values + pulls
        slopes[:, movable] = (changes + own[:, None] * np.eye(count))[:, movable]
        pressed = (q <= low) & (left < 0.0) | (q >= high) & (left > 0.0)
        # Do not move a robot with infinite torques, since its Newton step is undefined.
        finite = np.isfinite(slopes.sum(axis=(1, 2)))[:, None]
        free = movable & ~pressed & finite
        residual = np.where(free, left, 0.0)
        symmetric = np.where(free[..., None] & free[:, None], -0.5 * (slopes + slopes.swapaxes(1, 2)), np.eye(count))
        stiffness, ways = np.linalg.eigh(symmetric)
        still = np.abs(residual).max(axis=1, keepdims=True, initial=0.0) < BALANCED
        unstable = stiffness[:, :1] < -FLAT
        if (still & ~unstable).all():
            break
        # If the stiffness is negative, as for an upright link, step in the direction of the torque.
        along = np.einsum("mji,mj->mi", ways, residual) / np.maximum(np.abs(stiffness), FLAT)
        step = np.where(still, shove * unstable * ways[:, :, 0], np.einsum("mij,mj->mi", ways, along))
        step *= np.minimum(1.0, LONGEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
        # Shorten a step after a step that reverses the motion. Otherwise steps could alternate between the two sides of a
        # corner of a spring law for ever.
        turned = np.sum(step * before, axis=1, keepdims=True) < 0.0
        share, before = np.where(turned, 0.5 * share, np.minimum(2.0 * share, 1.0)), step
        q = np.where(free, np.clip(q + share * step, low, high), q)
        if (np.abs(step).max(initial=0.0) < close) and not unstable.any():
            break
    return q, np.where(finite, residual, np.nan)
