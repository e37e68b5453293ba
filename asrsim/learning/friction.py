"""Coulomb friction of joints that are linearised about a motion."""

from __future__ import annotations

from dataclasses import dataclass
from operator import mul

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

    def hold(
        self, sliding: list[float], slips: list[list[float]], alone: list[float], before: list[float], start: list[float]
    ) -> list[float]:
        """(m,) N m of friction after which the velocities `sliding` - slips (force - before) are 0, or as large as it can be.

        alone: the inverse of the diagonal of slips; start: a guess. In plain numbers: NumPy takes ten times as long for few.
        """
        levels: list[float] = self.level.tolist()
        force = start
        for _ in range(SWEEPS):
            more = [f - b for f, b in zip(force, before, strict=True)]
            following = [
                min(max(f + one * (speed - sum(map(mul, row, more))), -level), level)
                for f, one, speed, row, level in zip(force, alone, sliding, slips, levels, strict=True)
            ]
            if max(abs(a - f) for a, f in zip(following, force, strict=True)) < 1e-9:
                break
            force = following
        return force
