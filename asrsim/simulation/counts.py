"""Number of substeps in which the limits of the joints acted."""

from __future__ import annotations

from dataclasses import dataclass

from asrsim.samples import Array
from asrsim.simulation.layout import (
    DEFLECTION_COUNT,
    EFFORT_COUNT,
    MOTOR_SPEED_COUNT,
    MOTOR_STOP_COUNT,
    SATURATION_COUNT,
    STIFFEST,
    STOP_COUNT,
    VELOCITY_COUNT,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Number of substeps, (n,) one per joint, in which each limit acted during a run."""

    effort: Array
    """Torque clipped at the URDF's effort limit."""
    velocity: Array
    """Link faster than the URDF's velocity limit (reported, not enforced)."""
    saturation: Array
    """A motor at its torque limit."""
    motor_stop: Array
    """A motor at its position stop."""
    motor_speed: Array
    """A motor at its speed limit."""
    deflection: Array
    """A spring beyond its maximum deflection."""
    stop: Array
    """A link at or beyond its position limit, where the engine stops it; the impact takes energy."""
    stiffest: Array
    """Largest stiffness of the spring at a logged step, N m/rad."""
    substeps: int


def counts_of(state: Array, substeps: int) -> Counts:
    """Counts from the state (joints, columns) of a world after the given number of substeps."""
    columns = {
        "effort": EFFORT_COUNT, "velocity": VELOCITY_COUNT, "saturation": SATURATION_COUNT, "motor_stop": MOTOR_STOP_COUNT,
        "motor_speed": MOTOR_SPEED_COUNT, "deflection": DEFLECTION_COUNT, "stop": STOP_COUNT,
    }  # fmt: skip
    counted = {name: state[:, column].astype(int) for name, column in columns.items()}
    return Counts(**counted, stiffest=state[:, STIFFEST].copy(), substeps=substeps)
