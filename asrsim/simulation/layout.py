"""Health of worlds, tasks of laws, and columns of the inputs of a joint. Compiled code and Warp take named tuples of numbers as
constants."""

from __future__ import annotations

from typing import NamedTuple


class Health(NamedTuple):
    """Health of a world."""

    healthy: int = 0
    """The world can continue."""
    no_value: int = 1
    """A law gave a value that is not finite."""
    ran_away: int = 2
    """A link became impossibly fast."""


class LawTask(NamedTuple):
    """Tasks of the laws of a joint. The last three are tasks of its stages after the kick."""

    torques: int = 0
    """Torques of the springs."""
    whole: int = 1
    """Torques, stiffness and energy of the springs."""
    remember: int = 2
    """Advance the memories of the stages."""
    store: int = 3
    """Compute the energy in the stages."""
    lose: int = 4
    """Compute the losses of the stages."""


HEALTH, TASK = Health(), LawTask()
EXTERNAL, GOALS = 0, 1
"""EXTERNAL: column of the external torque (N m) in an input row; GOALS: first column of the goals of the motors. Two columns
for each sensor follow: whether the sensor takes a sample at the beginning of the kick or piece, and the noise."""
