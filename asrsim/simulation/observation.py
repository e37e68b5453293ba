"""Data that a simulation returns between steps: states, counts of limits, and snapshots that can be restored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from asrsim.quantities import LIMITS
from asrsim.samples import Array, HeldWrench
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.fields import JOINT, motor_column


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The state at a whole step. Arrays are (n,) in the order of the joints, or (N, n) for several worlds; NaN where a joint
    lacks the quantity.
    """

    time: Any
    """Time in s; for several worlds (N,)."""
    link_position: Array
    """Positions of the links in rad (m)."""
    link_velocity: Array
    """Velocities of the links in rad/s (m/s)."""
    motor_position: Array
    """Positions of the motors in rad, (n, motors) or (N, n, motors); NaN for ideal motors, since these are at their
    references."""
    motor_velocity: Array
    """Velocities of the motors in rad/s, (n, motors) or (N, n, motors)."""


@dataclass(frozen=True)
class Snapshot:
    """Complete states of some worlds, from which these worlds can continue."""

    owner: object
    """Object that identifies the worlds and their parameters. Only worlds with the same object can restore the snapshot."""
    states: Mapping[int, Any]
    """State of each world, by the number of the world."""
    recording: Any = None
    wrenches: Mapping[str, HeldWrench] = field(default_factory=dict)
    """Wrenches that the caller holds on bodies, by name of the body."""


def observe(time: Any, drives: Sequence[SteppedJoint], state: Array, substep: Any) -> Observation:
    """Observation of the states (..., joints, columns) at a whole step, at `time` s. substep: length of the last substep in s,
    or an array (..., 1).
    """
    dynamic = [drive.dynamic_motors for drive in drives]
    position, velocity = np.full((2, *state.shape[:-1], max(dynamic)), np.nan)
    lag = drives[0].stepping.first_drift * substep
    for i in range(max(dynamic)):
        # Use a slice if possible, since it is several times faster than a list of all joints.
        joints: Any = slice(None) if min(dynamic) > i else [j for j, count in enumerate(dynamic) if count > i]
        velocity[..., joints, i] = state[..., joints, motor_column("velocity", i)]
        position[..., joints, i] = state[..., joints, motor_column("position", i)] + lag * velocity[..., joints, i]
    return Observation(
        time=time,
        link_position=state[..., JOINT["position"]].copy(),
        link_velocity=state[..., JOINT["engine_velocity"]].copy(),
        motor_position=position,
        motor_velocity=velocity,
    )


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Number of substeps in which each limit acted during a run; arrays (n,) with an entry for each joint."""

    effort: Array
    """Substeps in which the torque was clipped at the URDF's effort limit."""
    velocity: Array
    """Substeps in which the link was faster than the URDF's velocity limit, which is reported but not enforced."""
    saturation: Array
    """Substeps in which a motor was at its largest torque, current or voltage."""
    motor_stop: Array
    """Substeps in which a motor was at its position stop."""
    motor_speed: Array
    """Substeps in which a motor was at its speed limit."""
    deflection: Array
    """Substeps in which a spring was beyond its maximum deflection."""
    stop: Array
    """Substeps in which the link was at or beyond its position limit, where the engine stops it; the impact dissipates energy.
    """
    stiffest: Array
    """Largest stiffness of the joint's springs at the logged steps, N m/rad."""
    substeps: int


def counts_of(state: Array, substeps: int) -> Counts:
    """Counts from the state (joints, columns) of a world after this number of substeps."""
    counted = {name: state[:, JOINT[f"{name}_count"]].astype(int) for name in LIMITS}
    return Counts(**counted, stiffest=state[:, JOINT["stiffest"]].copy(), substeps=substeps)
