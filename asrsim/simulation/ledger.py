"""The energy balance of a joint, and counts of the substeps at its limits.

Work is the mean torque times the displacement. This is the trapezoidal rule, which is of second order in the step. If an input
jumps, separate means are taken before and after the jump. With the default stepping the residual of the balance thus decreases
as h^2. If the step is too large for a spring, the residual stays large, which reveals divergence before any number overflows.
"""

from __future__ import annotations

from asrsim.simulation.fields import JointConstants, JointKind, JointState, Pushes, Scheme
from asrsim.simulation.joint import FULL
from asrsim.simulation.laws import drive_of, motor_of, spring_law
from asrsim.simulation.layout import TASK

AT_STOP = 1e-12
"""Distance in rad or m from a stop below which a motor or a link counts as being at the stop, as a margin for rounding."""
SHARE = 0.5
"""Residual of the energy balance, as a fraction of the turnover, above which a run counts as diverged."""


def update_ledger(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, first: bool, jumped: bool, recorded: bool
) -> None:
    """Add the energy flows since the last substep to the energies of the joint, count the limits that act in this substep, and
    store values for the next substep.

    first: whether this is the first substep of the run. jumped: whether an input jumps in this kick, so that
    the means over the half kicks differ from the present values. recorded: whether the row is recorded, so that the energies
    of the present state are needed.
    """
    before = joint.before if jumped else joint.now
    following = joint.following if jumped else joint.now
    half = 0.0 if first else 0.5 * (joint.position - joint.last_position)
    given = (joint.last.applied + before.applied) * half
    damped = -(joint.last.damping + before.damping) * half
    push = (joint.last.push + before.push) * half
    work = given
    if kind.sprung:
        work = _update_springs(joint, link, kind, scheme.step, first, jumped, recorded, before)
        joint.limit_loss += (joint.last.torque + before.torque) * half - given
    joint.link_work += given
    joint.damping_loss += damped
    joint.net_link_work += given + push - damped
    joint.motor_work += work
    joint.turnover += abs(given) + abs(push) + abs(work)
    if kind.sprung and (recorded or first):
        _balance(joint, first)
    joint.last_position = joint.position
    joint.jumped = 1.0 if jumped else 0.0
    joint.last.applied, joint.last.torque = following.applied, following.torque
    joint.last.damping, joint.last.push = following.damping, following.push
    if abs(joint.now.torque) > link.effort:
        joint.effort_count += 1.0
    if abs(joint.velocity) > link.fastest:
        joint.velocity_count += 1.0
    if joint.position <= link.lowest or joint.position >= link.highest:
        joint.stop_count += 1.0


def _update_springs(
    joint: JointState,
    link: JointConstants,
    kind: JointKind,
    step: float,
    first: bool,
    jumped: bool,
    recorded: bool,
    before: Pushes,
) -> float:
    """Update energies and counts of the springs and motors, and return the work in J of the motors since the last substep.

    step: length of a substep in s. first, jumped, recorded: as in `update_ledger`. before: the torques on the
    link, or their means over the half kick before the substep if an input jumps.
    """
    kinematic, energy_before, lost = kind.dynamic < kind.placed, joint.spring_energy, 0.0
    if recorded or first or kinematic:
        if kind.stages:
            spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.store)
        joint.spring_energy = joint.law_energy + joint.stage_energy
        joint.stiffest = max(joint.stiffest, abs(joint.stiffness))
    if kind.stages and not first:
        spring_law(kind.spring_law, joint, link, kind, joint.position, TASK.lose)
        lost = joint.stage_lost
        joint.stage_loss += lost
    work = _update_motors(joint, link, kind, step, first)
    if kinematic:
        absorbed = joint.spring_energy - energy_before + lost
        work += 0.0 if first else _kinematic(joint, link, kind, before, absorbed, jumped or joint.jumped != 0.0)
        for i in range(kind.positions):
            motor = motor_of(joint, i)
            motor.last_kick_position, motor.last_kick_parallel = motor.kick_position, motor.kick_parallel
    return work


def _update_motors(joint: JointState, link: JointConstants, kind: JointKind, step: float, first: bool) -> float:
    """Update energies and counts of the motors, and return their work in J since the last substep."""
    work = lost = kinetic = 0.0
    saturated = bent = False
    for i in range(kind.positions):
        motor, drive = motor_of(joint, i), drive_of(link, i)
        theta, speed = motor.kick_position, motor.mean_velocity
        if i < kind.springs and i < kind.pulling and abs(theta - joint.position) > link.max_deflection:
            bent = True
        if i >= kind.dynamic:
            continue
        energy = 0.5 * drive.inertia * speed * speed
        kinetic += energy
        if not first:
            work += motor.row_work.drive
            # If the motor is at a limit, the rest of the energy balance is dissipated. It is the energy of the impact and the
            # work of the torque.
            limited = motor.row_work.drive - motor.row_work.spring - (energy - motor.kinetic)
            lost += limited if motor.at_limit > 0.0 else motor.row_work.loss
        motor.kinetic = energy
        if motor.at_limit > 0.0:
            motor.at_limit -= 1.0
        if drive.resistance != 0.0:
            heat = drive.resistance * motor.current * motor.current
            joint.winding_loss += 0.0 if first else 0.5 * step * (heat + motor.last_power)
            motor.last_power = heat
        if motor.full_voltage != 0.0 or abs(motor.torque) >= (motor.limit if kind.stages else drive.limit):
            saturated = True
        if theta <= drive.low + AT_STOP or theta >= drive.high - AT_STOP:
            joint.motor_stop_count += 1.0
        if abs(speed) >= FULL * drive.most:
            joint.motor_speed_count += 1.0
    joint.motor_energy = kinetic
    joint.friction_loss += lost
    if saturated:
        joint.saturation_count += 1.0
    if bent:
        joint.deflection_count += 1.0
    return work


def _kinematic(joint: JointState, link: JointConstants, kind: JointKind, before: Pushes, absorbed: float, jump: bool) -> float:
    """Work in J of motors and adjusters without dynamics. The work is the change of the springs' energy by the motion of these
    motors and adjusters, with all other positions at their means. If an input jumps, the work is the energy that the springs
    absorbed (J) plus their work on the link.
    """
    half = 0.5 * (joint.position - joint.last_position)
    if jump:
        work: float = absorbed + (joint.last.torque + before.torque) * half
        for i in range(kind.dynamic):
            work -= motor_of(joint, i).row_work.spring
        return work
    middle = 0.5 * (joint.position + joint.last_position)
    now = _energy_at(joint, link, kind, middle, False)
    work = now - _energy_at(joint, link, kind, middle, True)
    for i in range(kind.dynamic, kind.springs):
        motor = motor_of(joint, i)
        way = motor.kick_position - motor.last_kick_position
        work += 0.5 * (motor.kick_parallel + motor.last_kick_parallel) * way
    return work


def _energy_at(joint: JointState, link: JointConstants, kind: JointKind, q: float, last: bool) -> float:
    """Energy of the springs in J for a link at q rad. Motors with dynamics are at their mean positions. The other motors are at
    their present positions, or at their positions of the last kick if `last` is set.
    """
    for i in range(kind.positions):
        motor = motor_of(joint, i)
        half_way = 0.5 * (motor.kick_position + motor.last_kick_position)
        own = motor.last_kick_position if last else motor.kick_position
        motor.theta = half_way if i < kind.dynamic else own
    stiffness, energy = joint.stiffness, joint.law_energy
    spring_law(kind.spring_law, joint, link, kind, q, TASK.whole)
    energy_there = joint.law_energy
    joint.stiffness, joint.law_energy = stiffness, energy
    return energy_there


def _balance(joint: JointState, first: bool) -> None:
    """Compute the residual of the energy balance since the start."""
    stored = joint.spring_energy + joint.motor_energy
    if first:
        joint.start_energy = stored
    joint.residual = (
        joint.motor_work
        - joint.friction_loss
        - joint.link_work
        - joint.limit_loss
        - joint.stage_loss
        - (stored - joint.start_energy)
    )
    joint.excess = max(joint.excess, abs(joint.residual) - SHARE * joint.turnover)
