"""Health of worlds, tasks of laws, and columns of the inputs of a joint."""

from __future__ import annotations

from enum import IntEnum


class Health(IntEnum):
    """Health of a world."""

    HEALTHY = 0
    """The world can continue."""
    NO_VALUE = 1
    """A law gave a value that is not finite."""
    RAN_AWAY = 2
    """A link became impossibly fast."""


class Task(IntEnum):
    """Tasks of the laws of a joint. The last three are tasks of its stages after the kick."""

    TORQUES = 0
    """Torques of the springs."""
    WHOLE = 1
    """Torques, stiffness and energy of the springs."""
    REMEMBER = 2
    """Advance the memories of the stages."""
    STORE = 3
    """Compute the energy in the stages."""
    LOSE = 4
    """Compute the losses of the stages."""


EXTERNAL, GOALS = 0, 1
"""First columns of an input row: external torque (N m), and goals of the motors. Two columns for each sensor follow: whether
the sensor takes a sample at the beginning of the kick or piece, and the noise."""
