"""Coulomb friction of joints that are linearised about a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.samples import Array

SWEEPS = 30
"""Sweeps over the joints, at most, in which friction is found."""


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Coulomb friction of the joints in a motion about which they are linearised."""

    level: Array
    """(m,) N m."""
    velocities: Array
    """(n - 1, m) rad/s, of the motion, in the middle of each step."""
    torques: Array
    """(n - 1, m) N m against the motion, within the level: what friction did in it."""

    def hold(self, sliding: Array, slips: Array, alone: Array, before: Array, start: Array) -> Array:
        """(m,) N m of friction after which the velocities `sliding` - slips (force - before) are 0, or as large as it can be.

        alone: the inverse of the diagonal of slips; start: a guess.
        """
        force = start
        for _ in range(SWEEPS):
            left = sliding - slips @ (force - before)
            following = np.minimum(np.maximum(force + alone * left, -self.level), self.level)
            if abs(following - force).max() < 1e-9:
                break
            force = following
        return force
