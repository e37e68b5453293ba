"""Meaning, unit and log name of every column in the tables that describe a simulated world.

A world has three tables with one row per joint: the state S and the parameters P, both of floats, and the integers K. S
determines how the run continues, and contains the values of the last substep that are recorded. P is constant during a run. K
gives the kind of each joint. A row begins with columns of the joint, followed by a block of columns for each motor. The parts
without a fixed length are last: motor positions and torques of the spring's law, the memory of sensors, and the parameters of
the spring's law.
"""

from __future__ import annotations

# S: columns of the joint. The torques that do work on the link form blocks of four columns: their values at the whole substep,
# and their means over half kicks.
(
    POSITION,  # rad; position of the link
    ENGINE_VELOCITY,  # rad/s; velocity of the link in the engine: half a substep late in staggered steppings
    LAST_ENGINE_VELOCITY,  # rad/s; velocity of the link in the engine one substep before
    VELOCITY,  # rad/s; velocity of the link at the whole substep
    INTEGRAL,  # N m; integral action of the link's controller (mode 1)
    LAST_POSITION,  # rad; position of the link one substep before
    BRAKE,  # N m s/rad; derivative gain of the link's controller that acts in this kick; 0 beyond the effort limit
    DRAG,  # N m s/rad; viscous damping of the link in this kick
    JUMPED,  # 1; 1 if an input jumped in the last substep
    APPLIED,  # N m; torque of the actuator on the link, after the effort limit
    TORQUE,  # N m; torque of the actuator on the link, before the effort limit
    DAMPING,  # N m; torque of the link's damping
    PUSH,  # N m; sum of the external torque and the torque of the passive spring
    APPLIED_BEFORE,  # N m; mean over the half kick before: applied, torque, damping, push
    _,
    _,
    _,
    APPLIED_NEXT,  # N m; mean over the half kick after: applied, torque, damping, push
    _,
    _,
    _,
    APPLIED_LAST,  # N m; APPLIED_NEXT of the previous kick: applied, torque, damping, push
    _,
    _,
    _,
    FREE,  # 1; 1 if the brake acts at the time of the whole substep
    FREE_BEFORE,  # 1; share of the half kick before in which the brake acts
    FREE_AFTER,  # 1; share of the half kick after in which the brake acts
    LINK_WORK,  # J; work of the actuator on the link since the start
    LIMIT_LOSS,  # J; work that the effort limit prevented
    DAMPING_LOSS,  # J; energy lost in the link's damping
    MOTOR_WORK,  # J; work of the motors
    FRICTION_LOSS,  # J; energy lost by the motors' friction and damping, and at their limits
    WINDING_LOSS,  # J; heat of the windings
    HYSTERESIS_LOSS,  # J; energy lost in the springs' hysteresis
    SPRING_ENERGY,  # J; energy stored in the springs
    MOTOR_ENERGY,  # J; kinetic energy of the motors
    START_ENERGY,  # J; energy of springs and motors at the start
    RESIDUAL,  # J; motor work - losses - change of the stored energy - link work
    NET_LINK_WORK,  # J; work of actuator and external torques on the link, minus the damping loss of the link
    TURNOVER,  # J; sum of the magnitudes of all work at the joint
    EXCESS,  # J; largest value so far of |RESIDUAL| - asrsim.simulation.ledger.SHARE * TURNOVER
    STIFFNESS,  # N m/rad; stiffness of the spring
    LAW_ENERGY,  # J; result of the spring's energy law in its last call, without hysteresis
    STIFFEST,  # N m/rad; largest stiffness so far
    EFFORT_COUNT,  # 1; substeps in which the effort limit clipped the torque
    VELOCITY_COUNT,  # 1; substeps beyond the link's velocity limit
    SATURATION_COUNT,  # 1; substeps with a motor at its torque limit
    MOTOR_STOP_COUNT,  # 1; substeps with a motor at its position stop
    MOTOR_SPEED_COUNT,  # 1; substeps with a motor at its speed limit
    DEFLECTION_COUNT,  # 1; substeps with a spring beyond its largest deflection
    STOP_COUNT,  # 1; substeps with the link at its position stop
    FIRST_MOTOR,  # column at which the block of the first motor begins
) = range(53)
PUSHES = 4
"""Number of columns in a block of torques that do work on the link: applied, torque, damping, push."""

# S: columns of a motor. The torques that do work on it form blocks of three columns.
(
    MOTOR_POSITION,  # rad; position of the motor at the beginning of the next substep
    MOTOR_VELOCITY,  # rad/s; velocity of the motor after the last kick
    ANCHOR,  # rad; position at which the bristles of the friction stick (Dahl's w)
    MOTOR_INTEGRAL,  # N m; integral action of the motor's controller, in units of the command
    KICK_POSITION,  # rad; position of the motor at the kick
    MEAN_VELOCITY,  # rad/s; mean velocity of the motor over the kick
    DRIVE_TORQUE,  # N m; torque of the motor after its limit
    FRICTION,  # N m; friction torque on the motor
    LOAD,  # N m; torque of the motor's spring
    DRIVE_BEFORE,  # N m; mean over the half kick before: drive, friction, load
    _,
    _,
    DRIVE_NEXT,  # N m; mean over the half kick after: drive, friction, load
    _,
    _,
    DRIVE_LAST,  # N m; DRIVE_NEXT of the previous kick: drive, friction, load
    _,
    _,
    DRIVE_PIECE,  # N m; values in one piece of a kick that is split by a jump of an input: drive, friction, load
    _,
    _,
    LAST_KICK_POSITION,  # rad; position of the motor at the previous kick
    LAST_MEAN_VELOCITY,  # rad/s; mean velocity of the motor over the previous kick
    AT_LIMIT,  # 1; 1 if a stop or the speed limit of the motor acted in this kick
    LAST_AT_LIMIT,  # 1; 1 if a stop or the speed limit of the motor acted in the previous kick
    CURRENT,  # A; current of the winding
    VOLTAGE,  # V; voltage of the winding
    LAST_POWER,  # W; heat loss of the winding at the previous kick
    HYSTERESIS,  # N m; hysteresis torque of the motor's spring
    DEFLECTION,  # rad; deflection of the motor's spring at the last kick; NaN before the first kick
    LAST_HYSTERESIS,  # N m; hysteresis torque of the motor's spring at the previous kick
    LAST_DEFLECTION,  # rad; deflection of the motor's spring at the previous kick
    READ_ERROR,  # rad; position error of the motor's sensor: measured minus true position
    READ_PUSH,  # N m; torque caused by the error of the measured velocity, in units of the command
    PER_MOTOR,  # number of columns per motor
) = range(35)
MOTOR_PUSHES = 3
"""Number of columns in a block of torques that do work on a motor: drive, friction, load."""

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
"""Column of a joint -> name of the quantity in logs."""
LOGGED_OF_MOTORS = {
    KICK_POSITION: "motor_{}_position",
    MEAN_VELOCITY: "motor_{}_velocity",
    DRIVE_TORQUE: "motor_{}_torque",
    FRICTION: "friction_torque_{}",
    LOAD: "elastic_torque_{}",
    CURRENT: "motor_{}_current",
    VOLTAGE: "motor_{}_voltage",
}
"""Column of a motor -> name of the quantity in logs; {} stands for the number of the motor."""

# P: columns of the link.
(
    P_EFFORT,  # N m; effort limit
    P_FASTEST,  # rad/s; velocity limit
    P_CUTOFF,  # 1; 1 if torque beyond the velocity limit is zeroed, as Gazebo does
    P_LOWEST,  # rad; largest position at which the link counts as being at its lower stop
    P_HIGHEST,  # rad; smallest position at which the link counts as being at its upper stop
    P_DAMPING,  # N m s/rad; constant damping of the link
    P_DAMPING_RATIO,  # 1; damping ratio of a damping that varies with the stiffness (paper section 4.2.2)
    P_DAMPING_INERTIA,  # kg m^2; inertia to which the damping ratio refers
    P_BRAKE,  # N m s/rad; derivative gain of the link's controller (mode 1)
    P_SPRING,  # N m/rad; stiffness of the passive spring
    P_REST,  # rad; rest position of the passive spring
    P_COULOMB,  # N m; Coulomb friction of the joint
    P_STRIBECK,  # N m; Stribeck excess: static friction of the joint minus Coulomb friction
    P_FADE,  # s/rad; reciprocal of the Stribeck velocity
    P_SHARE,  # 1; share of the actuator's torque that adds to the friction
    P_PROPORTIONAL,  # N m/rad; proportional gain of the link's controller
    P_INTEGRAL,  # N m/(rad s); integral gain of the link's controller
    P_DERIVATIVE,  # N m s/rad; derivative gain of the link's controller, for sensors
    P_SUBSTEPS,  # 1; number of motor substeps per substep of the engine, an odd number
    P_MAX_DEFLECTION,  # rad; largest deflection of the springs
    P_LEVEL,  # N m; level of the springs' hysteresis torque
    P_LENGTH,  # rad; deflection over which the hysteresis torque reverses
    P_DELAY,  # 1; delay of the sensors in substeps
    P_QUANTUM,  # rad; resolution of the sensors
    FIRST_DRIVE,  # column at which the block of the first motor begins
) = range(25)

# P: columns of a motor, beginning with the parameters of asrsim.actuators.motor.motor_kick in the order of that function.
(
    D_PROPORTIONAL,  # command/rad; proportional gain of the controller; 1 if the reference is the command
    D_INTEGRAL,  # command/(rad s); integral gain of the controller
    D_DERIVATIVE,  # command s/rad; derivative gain of the controller, on the negative velocity
    D_HOLD,  # 1; 1 if a controller compares the reference with the position
    D_INERTIA,  # kg m^2; inertia at the link's side of the gear
    D_DAMPING,  # N m s/rad; viscous damping
    D_GAIN,  # N m/command; torque per unit of the command
    D_LAG,  # N m s/rad; damping by the back-EMF if the command is a voltage
    D_EMF,  # N m s/rad; damping by the back-EMF at full voltage
    D_STALL,  # N m; torque at full voltage and rest
    D_LIMIT,  # N m; largest torque
    D_COULOMB,  # N m; Coulomb level of the friction
    D_EXCESS,  # N m; Stribeck excess: static friction minus Coulomb friction
    D_FADE,  # s/rad; reciprocal of the Stribeck velocity
    D_SHARE,  # 1; share of the spring's torque that adds to the Coulomb level
    D_BRISTLES,  # N m/rad; stiffness of the friction's bristles
    D_LOW,  # rad; lower stop
    D_HIGH,  # rad; upper stop
    D_MOST,  # rad/s; speed limit
    D_MAX_TORQUE,  # N m; smallest torque at which the motor counts as saturated
    D_CONSTANT,  # N m/A; torque constant at the output; 0: the motor is not electric
    D_RESISTANCE,  # ohm; resistance of the winding
    PER_DRIVE,  # number of columns per motor
) = range(23)

(
    KIND, MOTORS, DYNAMIC, SPRINGS, PLACED, SPRING_LAW, JOINT_STEP, CONTROLLERS, ON_LINK,
    THETAS, TORQUES, RINGS, RING, LAW,
) = range(14)  # fmt: skip
"""Columns of K. KIND: kind of the joint. MOTORS: number of positions that the spring's law takes. DYNAMIC: number of positions
with motor dynamics; the others equal their references. SPRINGS: number of torques that the law gives. PLACED: number of
positions that change the springs' energy. SPRING_LAW, JOINT_STEP: addresses of the actuator's laws and of the stepping's
function for a joint, 0 if there is none. CONTROLLERS: number of controllers with sensors. ON_LINK: 1 if the sensors measure the
link. THETAS, TORQUES, RINGS: first columns in S of the law's positions, of its torques and of the sensors' memory. RING: number
of columns of one sensor's memory. LAW: first column in P of the law's parameters."""
KINDS = 14
"""Number of columns of K."""

PASSIVE, DIRECT, CONTROLLED, SPRUNG = range(4)
"""Kinds of joints: without actuator, in mode 0, in mode 1, with springs."""

EXTERNAL, GOALS = 0, 1
"""First columns of an input row: external torque (N m), and goals of the motors. Two columns for each sensor follow: whether it
takes a sample, and its noise."""

(STEP, WEIGHT_NOW, WEIGHT_LAST, FIRST_DRIFT, IMPLICITNESS, LINK_IMPLICITNESS, STAGGERED) = range(7)
"""Constants of a stepping: substep in s; weights of the present and the previous engine velocity in the velocity at the whole
substep; share of a motor's step before its kick; implicitness of the motors' damping; implicitness of the link's damping; 1 if
velocities belong to half steps."""

(E_POSITION, E_VELOCITY, E_TORQUE, E_DAMPING, E_FRICTION) = range(5)
"""Columns of the array that joints and engine exchange; see `asrsim.engines.base`."""

HEALTHY, NO_VALUE, RAN_AWAY = range(3)
"""State of a world: it can continue; a law gave a value that is not finite; a link became impossibly fast."""
