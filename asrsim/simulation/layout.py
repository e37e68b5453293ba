"""Kinds of joints, health of worlds, and columns of the arrays that the kernel exchanges with signals and engines."""

from __future__ import annotations

PASSIVE, DIRECT, CONTROLLED, SPRUNG = range(4)
"""Kinds of joints: without actuator, in mode 0, in mode 1, with springs."""

TORQUES, WHOLE, REMEMBER, STORE, LOSE = range(5)
"""Tasks of the laws of a joint: torques of the springs; torques, stiffness and energy; and the tasks of its stages after the
kick: advance their memories, compute their energy, compute their losses."""

EXTERNAL, GOALS = 0, 1
"""First columns of an input row: external torque (N m), and goals of the motors. Two columns for each sensor follow: whether
the sensor takes a sample at the beginning of the kick or piece, and the noise."""

(E_POSITION, E_VELOCITY, E_TORQUE, E_DAMPING, E_FRICTION, E_MIDDLE) = range(6)
"""Columns of the array that joints and engine exchange; see `asrsim.engines.base`."""

HEALTHY, NO_VALUE, RAN_AWAY = range(3)
"""Health of a world: the world can continue; a law gave a value that is not finite; a link became impossibly fast."""
