"""Initial state at static equilibrium: the positions of links and motors at rest under the first references and the load of
gravity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from asrsim.actuators.rest import resting_motors, spring_torques
from asrsim.errors import ScenarioError
from asrsim.robot.dynamics import RobotModel
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.inputs import sampled_signals
from asrsim.simulation.layout import EXTERNAL, GOALS
from asrsim.statics.balance import BALANCED, balanced, by_differences, springs_by_differences


def at_equilibrium(scenario: Scenario, drives: Sequence[SteppedJoint], model: RobotModel) -> tuple[SteppedJoint, ...]:
    """The drives with initial states at static equilibrium under the references at t = 0.

    Each motor stands where its controller torque equals the spring torque. A joint that is pressed onto its stop rests there. A
    joint without actuator rests where gravity and its passive spring balance. Joints that references drive with a torque, a
    voltage or a current (modes 0, 4, 7 and 8) keep their positions. Raises ScenarioError, which names a joint without an
    equilibrium.
    """
    sampled = sampled_signals(scenario, drives, np.zeros(1))
    goals = [tuple(drive.goals(sampled[GOALS:, j])[:, 0].tolist()) for j, drive in enumerate(drives)]
    gives_way = np.array([_gives_way(drive) for drive in drives])
    own = np.flatnonzero(gives_way).tolist()
    # Treat the base of a robot on the ground as fixed.
    falls = not scenario.fixed_base and scenario.world.empty
    stated = [drive.stated_position for drive in drives]
    couplings = model.couplings
    movable = gives_way & np.isin(np.arange(len(drives)), couplings.free)
    q = np.array(list(map(_unloaded, drives, goals, stated)))
    low, high = np.array([drive.joint.stops for drive in drives]).T

    def load(positions: Array) -> Array:
        """Torques (..., joints) of gravity in N m that springs carry at rest; 0 for a robot in free fall. External torques are
        excluded.
        """
        weight = np.zeros_like(positions) if falls else model.gravity_torques(positions)
        return weight - couplings.fold(sampled[EXTERNAL, :, 0], couplings.expand(positions))

    def springs(positions: Array) -> Array:
        """Torques of the springs on the links (1, k, joints) in N m; torques on a follower act on its master."""
        positions = couplings.expand(positions)
        torques = np.zeros_like(positions)
        torques[0].T[own] = link_torques([drives[j] for j in own], positions[0].T[own], [goals[j] for j in own])
        return couplings.fold(torques, positions)

    loads = by_differences(lambda positions: -load(positions), movable)
    found, left = balanced(loads, springs_by_differences(springs), q[None], low, high, movable)
    q = couplings.expand(found[0])
    if not np.abs(left).max(initial=0.0) < 1e3 * BALANCED:
        worst = drives[int(np.abs(left[0]).argmax())].name
        message = f"joint '{worst}' has no equilibrium: neither spring, controller nor stop carries its load"
        raise ScenarioError(message, key="initial", hint="Give initial positions instead", code="no-equilibrium")
    carried = load(q).tolist()
    return tuple(_resting(*joint) for joint in zip(drives, q.tolist(), goals, carried, strict=True))


def _resting(drive: SteppedJoint, q: float, goals: tuple[float, ...], load: float) -> SteppedJoint:
    """The drive with an initial state at rest, in which the link is at q in rad (m) under a load in N m (N)."""
    own = drive.drive
    positions: tuple[float, ...] = ()
    integrals: tuple[float, ...] = ()
    if own and own.mode.controller and drive.dynamic_motors:
        resting, torques = resting_motors([own], np.array([[q]]), np.reshape(goals, (-1, 1, 1)))
        positions = tuple(resting[:, 0, 0].tolist())
        # Integral action balances the torque of the springs, up to the motor's largest torque.
        rows = zip(torques[:, 0, 0].tolist(), own.integral, own.max_torque, strict=False)
        integrals = tuple(min(max(torque, -most), most) if gain > 0.0 else 0.0 for torque, gain, most in rows)
    elif _holds(drive):
        most = drive.joint.most_effort
        integrals = tuple(np.clip(load - link_torques([drive], np.array([[q]]), [goals])[0], -most, most).tolist())
    return replace(drive, initial_position=q, motor_positions=positions, integrals=integrals)


def link_torques(drives: Sequence[SteppedJoint], q: Array, goals: Sequence[tuple[float, ...]]) -> Array:
    """Torques (joints, n) in N m on links at rest at positions q (joints, n): the torque of spring or controller, clipped to
    the effort limit, plus the torque of the passive spring.
    """
    torques = np.zeros_like(q)
    sprung = {j: own for j, drive in enumerate(drives) if (own := drive.drive) and own.mode.spring}
    rows = [*sprung]
    torques[rows] = spring_torques([*sprung.values()], q[rows], [np.reshape(goals[j], (-1, 1)) for j in rows])
    for j, drive in enumerate(drives):
        if drive.drive and drive.drive.mode.controller and j not in sprung:
            torques[j] = drive.drive.proportional[0] * (goals[j][0] - q[j])
        most, joint = drive.joint.most_effort, drive.joint
        torques[j] = np.clip(torques[j], -most, most) + joint.spring_stiffness * (joint.spring_reference - q[j])
    return torques


def _unloaded(drive: SteppedJoint, goals: tuple[float, ...], stated: float) -> float:
    """Position in rad (m) at which the unloaded joint rests, within its stops. If no spring or controller acts, this is the
    position `stated` in the scenario.
    """
    own = drive.drive
    if not (_gives_way(drive) or _holds(drive)) or (own is None and drive.joint.spring_stiffness == 0.0):
        return stated
    rest = drive.joint.spring_reference
    if own is not None and (own.mode.spring or own.mode.controller):
        rest = own.actuator.equilibrium_position(*goals) if own.mode.spring else goals[0]
    low, high = drive.joint.stops
    return min(max(rest, low), high)


def _gives_way(drive: SteppedJoint) -> bool:
    """Whether the joint moves until spring, controller or stop carries its load. Motors without controller carry no load."""
    mode = drive.mode
    driven = mode is None or ((mode.spring or mode.controller) and not mode.direct)
    return (driven or drive.joint.spring_stiffness > 0.0) and not _holds(drive)


def _holds(drive: SteppedJoint) -> bool:
    """Whether the controller has no steady-state error: mode 1 with integral action."""
    return drive.drive is not None and drive.drive.mode.number == 1 and drive.drive.integral[0] > 0.0
