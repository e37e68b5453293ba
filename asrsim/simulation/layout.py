"""The one table of a world's numbers: what every column of a joint's row is, in which unit, and under which name it is logged.

A world has two tables of floats, one row a joint. The state S is everything that decides how the run goes on, and what the
last substep left for the record. The parameters P do not change while a run is stepped. A third table K of integers says of
which kind a joint is. A row begins with the joint's own columns; a block of columns for each of its motors follows. What has no
fixed length stands behind: positions and torques as the spring's law takes and gives them, what sensors saw, and the parameters
of the spring's law.
"""

from __future__ import annotations

# S, of the joint. What does work on the link is a block of four columns: at the whole substep, and its means over half kicks.
(
    POSITION,  # rad; position of the link
    ENGINE_VELOCITY,  # rad/s; velocity of the link as the engine has it: half a substep late in staggered steppings
    LAST_ENGINE_VELOCITY,  # rad/s; the same one substep before
    VELOCITY,  # rad/s; velocity of the link at the whole substep
    INTEGRAL,  # N m; integral action of the link's controller (mode 1)
    LAST_POSITION,  # rad; position of the link one substep before
    BRAKE,  # N m s/rad; derivative gain of the link's controller, as far as it acts in this kick
    DRAG,  # N m s/rad; viscous damping of the link in this kick
    JUMPED,  # 1; 1 if an input jumped in the last substep
    APPLIED,  # N m; torque of the actuator on the link, after the effort limit
    TORQUE,  # N m; the same before the limit
    DAMPING,  # N m; torque of the link's damping
    PUSH,  # N m; external torque and passive spring
    APPLIED_BEFORE,  # N m; mean over the half kick before: applied, torque, damping, push
    _,
    _,
    _,
    APPLIED_NEXT,  # N m; mean over the half kick after: applied, torque, damping, push
    _,
    _,
    _,
    APPLIED_LAST,  # N m; the same of the kick before: applied, torque, damping, push
    _,
    _,
    _,
    FREE,  # 1; 1 if the brake acts at the whole substep's time
    FREE_BEFORE,  # 1; share of the half kick before in which the brake acts
    FREE_AFTER,  # 1; share of the half kick after in which the brake acts
    LINK_WORK,  # J; work of the actuator on the link since the start
    LIMIT_LOSS,  # J; energy that the effort limit kept from the link
    DAMPING_LOSS,  # J; energy lost in the link's damping
    MOTOR_WORK,  # J; work of the motors
    FRICTION_LOSS,  # J; energy lost in the motors' friction, damping and at their limits
    WINDING_LOSS,  # J; heat of the windings
    HYSTERESIS_LOSS,  # J; energy lost in the springs' hysteresis
    SPRING_ENERGY,  # J; energy that the springs hold
    MOTOR_ENERGY,  # J; kinetic energy of the motors
    START_ENERGY,  # J; energy of springs and motors at the start
    RESIDUAL,  # J; motor work - losses - stored - link work
    NET_LINK_WORK,  # J; work of actuator and external torques on the link, less what its damping took
    TURNOVER,  # J; sizes of all work at the joint
    EXCESS,  # J; most by which the residual was larger than the share of the turnover that a resolved run may have
    STIFFNESS,  # N m/rad; stiffness of the spring
    LAW_ENERGY,  # J; energy by the spring's law alone, of the last call
    STIFFEST,  # N m/rad; largest stiffness so far
    EFFORT_COUNT,  # 1; substeps in which the effort limit clipped the torque
    VELOCITY_COUNT,  # 1; substeps beyond the link's velocity limit
    SATURATION_COUNT,  # 1; substeps with a motor at its torque limit
    MOTOR_STOP_COUNT,  # 1; substeps with a motor at its position stop
    MOTOR_SPEED_COUNT,  # 1; substeps with a motor at its speed limit
    DEFLECTION_COUNT,  # 1; substeps with a spring beyond its largest deflection
    STOP_COUNT,  # 1; substeps with the link at its position stop
    FIRST_MOTOR,
) = range(53)
PUSHES = 4
"""Columns of what does work on the link: applied, torque, damping, push."""

# S, of a motor. What does work on it is a block of three columns.
(
    MOTOR_POSITION,  # rad; position of the motor, which its velocity has not reached yet
    MOTOR_VELOCITY,  # rad/s; its velocity after the last kick
    ANCHOR,  # rad; where the bristles of its friction stick (Dahl's w)
    MOTOR_INTEGRAL,  # N m; integral action of its controller, in units of the command
    KICK_POSITION,  # rad; its position at the kick
    MEAN_VELOCITY,  # rad/s; its mean velocity over the kick
    DRIVE_TORQUE,  # N m; torque of the motor after its limit
    FRICTION,  # N m; friction torque on the motor
    LOAD,  # N m; torque of its spring
    DRIVE_BEFORE,  # N m; mean over the half kick before: drive, friction, load
    _,
    _,
    DRIVE_NEXT,  # N m; mean over the half kick after: drive, friction, load
    _,
    _,
    DRIVE_LAST,  # N m; the same of the kick before: drive, friction, load
    _,
    _,
    DRIVE_PIECE,  # N m; in a piece of a kick that a jump cuts: drive, friction, load
    _,
    _,
    LAST_KICK_POSITION,  # rad; its position at the kick before
    LAST_MEAN_VELOCITY,  # rad/s; its mean velocity over the kick before
    AT_LIMIT,  # 1; 1 if a limit of position or speed cut this kick short
    LAST_AT_LIMIT,  # 1; the same of the kick before
    CURRENT,  # A; current of its winding
    VOLTAGE,  # V; voltage of its winding
    LAST_POWER,  # W; heat of its winding at the kick before
    HYSTERESIS,  # N m; torque of its spring's hysteresis
    DEFLECTION,  # rad; deflection of its spring at the last kick; NaN before the first
    LAST_HYSTERESIS,  # N m; torque of its spring's hysteresis at the kick before
    LAST_DEFLECTION,  # rad; deflection of its spring at the kick before
    READ_ERROR,  # rad; what its sensor reads too much
    READ_PUSH,  # N m; torque that the error of the velocity read makes, in units of the command
    PER_MOTOR,
) = range(35)
MOTOR_PUSHES = 3
"""Columns of what does work on a motor: drive, friction, load."""

LOGGED = {
    POSITION: "link_position",
    VELOCITY: "link_velocity",
    APPLIED: "link_torque",
    DAMPING: "damping_torque",
    LINK_WORK: "link_work",
    LIMIT_LOSS: "limit_loss",
    DAMPING_LOSS: "damping_loss",
    MOTOR_WORK: "motor_work",
    FRICTION_LOSS: "friction_loss",
    WINDING_LOSS: "winding_loss",
    HYSTERESIS_LOSS: "hysteresis_loss",
    SPRING_ENERGY: "spring_energy",
    RESIDUAL: "energy_residual",
    STIFFNESS: "stiffness",
}
"""Column of a joint -> quantity that it is logged as."""
LOGGED_OF_MOTORS = {
    KICK_POSITION: "motor_{}_position",
    MEAN_VELOCITY: "motor_{}_velocity",
    DRIVE_TORQUE: "motor_{}_torque",
    FRICTION: "friction_torque_{}",
    LOAD: "elastic_torque_{}",
    CURRENT: "motor_{}_current",
    VOLTAGE: "motor_{}_voltage",
}
"""The same of motors, with {} for the motor's number."""

# P, of the link.
(
    P_EFFORT,  # N m; effort limit
    P_FASTEST,  # rad/s; velocity limit
    P_CUTOFF,  # 1; 1 if torque beyond the velocity limit is zeroed, as Gazebo does
    P_LOWEST,  # rad; position from which on the link is at its lower stop
    P_HIGHEST,  # rad; position from which on the link is at its upper stop
    P_DAMPING,  # N m s/rad; constant damping of the link
    P_DAMPING_RATIO,  # 1; ratio of a damping that follows the stiffness (paper section 4.2.2)
    P_DAMPING_INERTIA,  # kg m^2; inertia that this ratio is of
    P_BRAKE,  # N m s/rad; derivative gain of the link's controller (mode 1)
    P_SPRING,  # N m/rad; passive spring
    P_REST,  # rad; where the passive spring rests
    P_COULOMB,  # N m; Coulomb friction of the joint
    P_STRIBECK,  # N m; friction above that at rest
    P_FADE,  # s/rad; one over the Stribeck velocity
    P_SHARE,  # 1; share of the actuator's torque that adds to the friction
    P_PROPORTIONAL,  # N m/rad; gain of the link's controller
    P_INTEGRAL,  # N m/(rad s); its gain on the integral
    P_DERIVATIVE,  # N m s/rad; its gain on the velocity, for sensors
    P_SUBSTEPS,  # 1; substeps of the motors in one of the engine's, an odd number
    P_MAX_DEFLECTION,  # rad; largest deflection of the springs
    P_LEVEL,  # N m; torque of the springs' hysteresis
    P_LENGTH,  # rad; deflection over which it turns round
    P_DELAY,  # 1; substeps by which sensors are late
    P_QUANTUM,  # rad; step of what sensors read
    LINK_CONSTANTS,
) = range(25)

# P, of a motor; the first ones are the parameters of asrsim.actuators.motor.motor_kick, in its order.
(
    D_PROPORTIONAL,  # gain of the controller, N m/rad in torque; 1 where the reference is the command
    D_INTEGRAL,  # gain on the integral
    D_DERIVATIVE,  # gain on minus the velocity
    D_HOLD,  # 1; 1 if a controller compares the reference with the position
    D_INERTIA,  # kg m^2; inertia at the link's side of the gear
    D_DAMPING,  # N m s/rad; viscous damping
    D_GAIN,  # torque by unit of the command
    D_LAG,  # N m s/rad; back-EMF where voltage is commanded
    D_EMF,  # N m s/rad; back-EMF at full voltage
    D_STALL,  # N m; torque at full voltage and rest
    D_LIMIT,  # N m; largest torque
    D_COULOMB,  # N m; Coulomb level of the friction
    D_EXCESS,  # N m; friction above that at rest
    D_FADE,  # s/rad; one over the Stribeck velocity
    D_SHARE,  # 1; share of the spring's torque that adds to the level
    D_BRISTLES,  # N m/rad; stiffness of the friction's bristles
    D_LOW,  # rad; lower stop
    D_HIGH,  # rad; upper stop
    D_MOST,  # rad/s; speed limit
    D_MAX_TORQUE,  # N m; torque from which on the motor counts as saturated
    D_CONSTANT,  # N m/A; torque constant at the output; 0: the motor is not electric
    D_RESISTANCE,  # ohm; resistance of the winding
    PER_DRIVE,
) = range(23)

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

(STEP, WEIGHT_NOW, WEIGHT_LAST, FIRST_DRIFT, IMPLICITNESS, LINK_IMPLICITNESS, STAGGERED) = range(7)
"""Numbers of a stepping: s; weights of the last two velocities in that of the whole substep; part of a motor's step before its
kick; of the motors' and of the link's damping; 1 if velocities live at half steps."""

(E_POSITION, E_VELOCITY, E_TORQUE, E_DAMPING, E_FRICTION) = range(5)
"""Columns of what joints and engine exchange: see :mod:`asrsim.engines.base`."""

HEALTHY, NO_VALUE, RAN_AWAY = range(3)
"""Whether a world goes on: a law had no finite value, or a link became absurdly fast."""
