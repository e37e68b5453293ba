"""The one table of a world's numbers: what every column of a joint's row is, in which unit, and under which name it is logged.

A world has two tables of floats, one row a joint. The state S is everything that decides how the run goes on, and what the
last substep left for the record. The parameters P do not change while a run is stepped. A third table K of integers says of
which kind a joint is. A row begins with the joint's own columns; a block of :data:`MOTOR` (or :data:`DRIVE`) columns for each
of its motors follows. What has no fixed length stands behind: positions and torques as the spring's law takes and gives them,
what sensors saw, and the parameters of the spring's law.
"""

from __future__ import annotations

from typing import NamedTuple


class Column(NamedTuple):
    """A number of a joint or of a motor."""

    name: str
    unit: str
    doc: str
    quantity: str = ""
    """Under which it is logged, with {} for the motor's number; empty: it is not."""


JOINT = (
    Column("position", "rad", "position of the link", "link_position"),
    Column("lagging", "rad/s", "velocity of the link as the engine has it: half a substep late in staggered steppings"),
    Column("previous", "rad/s", "the same one substep before"),
    Column("velocity", "rad/s", "velocity of the link at the whole substep", "link_velocity"),
    Column("integral", "N m", "integral action of the link's controller (mode 1)"),
    Column("last_position", "rad", "position of the link one substep before"),
    Column("brake", "N m s/rad", "derivative gain of the link's controller, as far as it acts in this kick"),
    Column("drag", "N m s/rad", "viscous damping of the link in this kick"),
    Column("jumped", "1", "1 if an input jumped in the last substep"),
    # What does work on the link: at the whole substep, its mean over the half kick before, and over the half kick after.
    Column("applied", "N m", "torque of the actuator on the link, after the effort limit", "link_torque"),
    Column("torque", "N m", "the same before the limit"),
    Column("damping", "N m", "torque of the link's damping", "damping_torque"),
    Column("push", "N m", "external torque and passive spring"),
    *(Column(f"{name}_before", "N m", "mean over the half kick before") for name in ("applied", "torque", "damping", "push")),
    *(Column(f"{name}_next", "N m", "mean over the half kick after") for name in ("applied", "torque", "damping", "push")),
    *(Column(f"{name}_last", "N m", "the same of the kick before") for name in ("applied", "torque", "damping", "push")),
    Column("free", "1", "1 if the brake acts at the whole substep's time"),
    Column("free_before", "1", "share of the half kick before in which the brake acts"),
    Column("free_after", "1", "share of the half kick after in which the brake acts"),
    Column("link_work", "J", "work of the actuator on the link since the start", "link_work"),
    Column("limit_loss", "J", "energy that the effort limit kept from the link", "limit_loss"),
    Column("damping_loss", "J", "energy lost in the link's damping", "damping_loss"),
    Column("motor_work", "J", "work of the motors", "motor_work"),
    Column("friction_loss", "J", "energy lost in the motors' friction, damping and at their limits", "friction_loss"),
    Column("winding_loss", "J", "heat of the windings", "winding_loss"),
    Column("hysteresis_loss", "J", "energy lost in the springs' hysteresis", "hysteresis_loss"),
    Column("spring_energy", "J", "energy that the springs hold", "spring_energy"),
    Column("motor_energy", "J", "kinetic energy of the motors"),
    Column("start_energy", "J", "energy of springs and motors at the start"),
    Column("residual", "J", "motor work - losses - stored - link work", "energy_residual"),
    Column("given", "J", "work of actuator and external torques on the link, less what its damping took"),
    Column("turnover", "J", "sizes of all work at the joint"),
    Column("excess", "J", "most by which the residual was larger than the share of the turnover that a resolved run may have"),
    Column("stiffness", "N m/rad", "stiffness of the spring", "stiffness"),
    Column("law_energy", "J", "energy by the spring's law alone, of the last call"),
    Column("stiffest", "N m/rad", "largest stiffness so far"),
    Column("effort_count", "1", "substeps in which the effort limit clipped the torque"),
    Column("velocity_count", "1", "substeps beyond the link's velocity limit"),
    Column("saturation_count", "1", "substeps with a motor at its torque limit"),
    Column("motor_stop_count", "1", "substeps with a motor at its position stop"),
    Column("motor_speed_count", "1", "substeps with a motor at its speed limit"),
    Column("deflection_count", "1", "substeps with a spring beyond its largest deflection"),
    Column("stop_count", "1", "substeps with the link at its position stop"),
)
(
    POSITION, LAGGING, PREVIOUS, VELOCITY, INTEGRAL, LAST_POSITION, BRAKE, DRAG, JUMPED,
    APPLIED, TORQUE, DAMPING, PUSH,
    APPLIED_BEFORE, _, _, _, APPLIED_NEXT, _, _, _, APPLIED_LAST, _, _, _, FREE, FREE_BEFORE, FREE_AFTER,
    LINK_WORK, LIMIT_LOSS, DAMPING_LOSS, MOTOR_WORK, FRICTION_LOSS, WINDING_LOSS, HYSTERESIS_LOSS,
    SPRING_ENERGY, MOTOR_ENERGY, START_ENERGY, RESIDUAL, GIVEN, TURNOVER, EXCESS, STIFFNESS, LAW_ENERGY, STIFFEST,
    EFFORT_COUNT, VELOCITY_COUNT, SATURATION_COUNT, MOTOR_STOP_COUNT, MOTOR_SPEED_COUNT, DEFLECTION_COUNT, STOP_COUNT,
) = range(len(JOINT))  # fmt: skip
OWN = len(JOINT)
"""Columns of the joint itself; its first motor's begin here."""
PUSHES = 4
"""Columns of what does work on the link: applied, torque, damping, push."""

MOTOR = (
    Column("motor_position", "rad", "position of the motor, which its velocity has not reached yet"),
    Column("motor_velocity", "rad/s", "its velocity after the last kick"),
    Column("anchor", "rad", "where the bristles of its friction stick (Dahl's w)"),
    Column("motor_integral", "N m", "integral action of its controller, in units of the command"),
    Column("kick_position", "rad", "its position at the kick", "motor_{}_position"),
    Column("mean_velocity", "rad/s", "its mean velocity over the kick", "motor_{}_velocity"),
    # What does work on the motor, as for the link.
    Column("drive", "N m", "torque of the motor after its limit", "motor_{}_torque"),
    Column("friction", "N m", "friction torque on the motor", "friction_torque_{}"),
    Column("load", "N m", "torque of its spring", "elastic_torque_{}"),
    *(Column(f"{name}_before", "N m", "mean over the half kick before") for name in ("drive", "friction", "load")),
    *(Column(f"{name}_next", "N m", "mean over the half kick after") for name in ("drive", "friction", "load")),
    *(Column(f"{name}_last", "N m", "the same of the kick before") for name in ("drive", "friction", "load")),
    *(Column(f"{name}_piece", "N m", "in a piece of a kick that a jump cuts") for name in ("drive", "friction", "load")),
    Column("last_kick_position", "rad", "its position at the kick before"),
    Column("last_mean_velocity", "rad/s", "its mean velocity over the kick before"),
    Column("held", "1", "1 if a limit of position or speed cut this kick short"),
    Column("last_held", "1", "the same of the kick before"),
    Column("current", "A", "current of its winding", "motor_{}_current"),
    Column("voltage", "V", "voltage of its winding", "motor_{}_voltage"),
    Column("last_power", "W", "heat of its winding at the kick before"),
    Column("hysteresis", "N m", "torque of its spring's hysteresis"),
    Column("deflection", "rad", "deflection of its spring at the last kick; NaN before the first"),
    Column("last_hysteresis", "N m", "torque of its spring's hysteresis at the kick before"),
    Column("last_deflection", "rad", "deflection of its spring at the kick before"),
    Column("read_error", "rad", "what its sensor reads too much"),
    Column("read_push", "N m", "torque that the error of the velocity read makes, in units of the command"),
)
(
    MOTOR_POSITION, MOTOR_VELOCITY, ANCHOR, MOTOR_INTEGRAL, KICK_POSITION, MEAN_VELOCITY,
    DRIVE_TORQUE, FRICTION, LOAD, DRIVE_BEFORE, _, _, DRIVE_NEXT, _, _, DRIVE_LAST, _, _, DRIVE_PIECE, _, _,
    LAST_KICK_POSITION, LAST_MEAN_VELOCITY, HELD, LAST_HELD, CURRENT, VOLTAGE, LAST_POWER,
    HYSTERESIS, DEFLECTION, LAST_HYSTERESIS, LAST_DEFLECTION, READ_ERROR, READ_PUSH,
) = range(len(MOTOR))  # fmt: skip
PER_MOTOR = len(MOTOR)
MOTOR_PUSHES = 3
"""Columns of what does work on a motor: drive, friction, load."""

LINK = (
    Column("effort", "N m", "effort limit"),
    Column("fastest", "rad/s", "velocity limit"),
    Column("cutoff", "1", "1 if torque beyond the velocity limit is zeroed, as Gazebo does"),
    Column("lowest", "rad", "position from which on the link is at its lower stop"),
    Column("highest", "rad", "position from which on the link is at its upper stop"),
    Column("damping", "N m s/rad", "constant damping of the link"),
    Column("damping_ratio", "1", "ratio of a damping that follows the stiffness (paper section 4.2.2)"),
    Column("damping_inertia", "kg m^2", "inertia that this ratio is of"),
    Column("brake", "N m s/rad", "derivative gain of the link's controller (mode 1)"),
    Column("spring", "N m/rad", "passive spring"),
    Column("rest", "rad", "where the passive spring rests"),
    Column("coulomb", "N m", "Coulomb friction of the joint"),
    Column("stribeck", "N m", "friction above that at rest"),
    Column("fade", "s/rad", "one over the Stribeck velocity"),
    Column("share", "1", "share of the actuator's torque that adds to the friction"),
    Column("proportional", "N m/rad", "gain of the link's controller"),
    Column("integral_gain", "N m/(rad s)", "its gain on the integral"),
    Column("derivative", "N m s/rad", "its gain on the velocity, for sensors"),
    Column("motor_substeps", "1", "substeps of the motors in one of the engine's, an odd number"),
    Column("max_deflection", "rad", "largest deflection of the springs"),
    Column("hysteresis_level", "N m", "torque of the springs' hysteresis"),
    Column("hysteresis_length", "rad", "deflection over which it turns round"),
    Column("delay", "1", "substeps by which sensors are late"),
    Column("quantum", "rad", "step of what sensors read"),
)
(
    P_EFFORT, P_FASTEST, P_CUTOFF, P_LOWEST, P_HIGHEST, P_DAMPING, P_DAMPING_RATIO, P_DAMPING_INERTIA, P_BRAKE,
    P_SPRING, P_REST,
    P_COULOMB, P_STRIBECK, P_FADE, P_SHARE, P_PROPORTIONAL, P_INTEGRAL, P_DERIVATIVE, P_SUBSTEPS, P_MAX_DEFLECTION,
    P_LEVEL, P_LENGTH, P_DELAY, P_QUANTUM,
) = range(len(LINK))  # fmt: skip
LINK_OWN = len(LINK)

DRIVE = (
    # The first ones are the parameters of asrsim.actuators.motor.motor_kick, in its order.
    Column("proportional", "", "gain of the controller, N m/rad in torque; 1 where the reference is the command"),
    Column("integral_gain", "", "gain on the integral"),
    Column("derivative", "", "gain on minus the velocity"),
    Column("hold", "1", "1 if a controller compares the reference with the position"),
    Column("inertia", "kg m^2", "inertia at the link's side of the gear"),
    Column("damping", "N m s/rad", "viscous damping"),
    Column("gain", "", "torque by unit of the command"),
    Column("lag", "N m s/rad", "back-EMF where voltage is commanded"),
    Column("emf", "N m s/rad", "back-EMF at full voltage"),
    Column("stall", "N m", "torque at full voltage and rest"),
    Column("limit", "N m", "largest torque"),
    Column("coulomb", "N m", "Coulomb level of the friction"),
    Column("excess", "N m", "friction above that at rest"),
    Column("fade", "s/rad", "one over the Stribeck velocity"),
    Column("share", "1", "share of the spring's torque that adds to the level"),
    Column("bristles", "N m/rad", "stiffness of the friction's bristles"),
    Column("low", "rad", "lower stop"),
    Column("high", "rad", "upper stop"),
    Column("most", "rad/s", "speed limit"),
    Column("max_torque", "N m", "torque from which on the motor counts as saturated"),
    Column("constant", "N m/A", "torque constant at the output; 0: the motor is not electric"),
    Column("resistance", "ohm", "resistance of the winding"),
)
(
    D_PROPORTIONAL, D_INTEGRAL, D_DERIVATIVE, D_HOLD, D_INERTIA, D_DAMPING, D_GAIN, D_LAG, D_EMF, D_STALL, D_LIMIT, D_COULOMB,
    D_EXCESS, D_FADE, D_SHARE, D_BRISTLES, D_LOW, D_HIGH, D_MOST, D_MAX_TORQUE, D_CONSTANT, D_RESISTANCE,
) = range(len(DRIVE))  # fmt: skip
PER_DRIVE = len(DRIVE)


(
    KIND, MOTORS, DYNAMIC, SPRINGS, PLACED, SPRING_LAW, JOINT_STEP, CONTROLLERS, ON_LINK,
    THETAS, TORQUES, RINGS, RING, DRIVES, LAW,
) = range(15)  # fmt: skip
"""Columns of K. KIND of the joint; MOTORS: positions that the spring's law takes; DYNAMIC: those of them that have dynamics,
the others stand at their references; SPRINGS: torques that the law gives; PLACED: positions that change the springs' energy;
SPRING_LAW, JOINT_STEP: addresses of the
actuator's laws and of a stepping's own step of a joint, 0: none; CONTROLLERS with sensors; ON_LINK: 1 if they read the link;
THETAS, TORQUES, RINGS: where in S the law's positions and torques and the sensors' memory begin, RING: numbers of one sensor's;
DRIVES, LAW: where in P motors and the law's parameters begin."""
KINDS = 15

PASSIVE, DIRECT, CONTROLLED, SPRUNG = range(4)
"""Kinds of joints: without actuator, mode 0, mode 1, and those with springs."""

EXTERNAL, GOALS = 0, 1
"""Columns of an input row: external torque (N m), then the motors' goals; then for each sensor whether it samples, and its
noise."""

(STEP, NOW, PAST, FIRST_DRIFT, IMPLICITNESS, LINK_IMPLICITNESS, STAGGERED) = range(7)
"""Numbers of a stepping: s; weights of the last two velocities in that of the whole substep; part of a motor's step before its
kick; of the motors' and of the link's damping; 1 if velocities live at half steps."""

(E_POSITION, E_VELOCITY, E_TORQUE, E_DAMPING, E_FRICTION) = range(5)
"""Columns of what joints and engine exchange: see :mod:`asrsim.engines.base`."""

HEALTHY, NO_VALUE, RAN_AWAY = range(3)
"""Whether a world goes on: a law had no finite value, or a link became absurdly fast."""
