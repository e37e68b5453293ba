"""Meaning, unit and log name of every column in the tables that describe a simulated world.

A world has three tables with one row per joint: the state S and the parameters P, both of floats, and the integers K. S
determines how the run continues, and contains the values of the last substep that are recorded. P is constant during a run. K
contains the kind of each joint, the addresses of its functions, and the lengths and first columns of the parts of its rows.

A row of S or P begins with columns of the joint, followed by a block of columns for each motor. The parts without a fixed
length are last: motor positions and torques of the spring's law, the memory of sensors, and the parameters of the spring's law.
"""

from __future__ import annotations

# S: columns of the joint. The torques that do work on the link form blocks of four columns: their values at the whole substep,
# and their means over half kicks.
(
    POSITION,  # position of the link, rad
    ENGINE_VELOCITY,  # velocity of the link in the engine, rad/s: half a substep late in staggered steppings
    LAST_ENGINE_VELOCITY,  # velocity of the link in the engine at the previous substep, rad/s
    VELOCITY,  # velocity of the link at the whole substep, rad/s
    INTEGRAL,  # integral action of the link's controller (mode 1), N m
    LAST_POSITION,  # position of the link at the previous substep, rad
    BRAKE,  # derivative gain of the link's controller that acts in this kick, N m s/rad; 0 beyond the effort limit
    DRAG,  # viscous damping of the link in this kick, N m s/rad
    JUMPED,  # flag: 1 if an input jumped in the last substep, else 0
    APPLIED,  # torque of the actuator on the link, after the effort limit, N m
    TORQUE,  # torque of the actuator on the link, before the effort limit, N m
    DAMPING,  # torque of the link's damping, N m
    PUSH,  # sum of the external torque and the torque of the passive spring, N m
    APPLIED_BEFORE,  # means over the half kick before the whole substep, N m: applied, torque, damping, push
    _,
    _,
    _,
    APPLIED_NEXT,  # means over the half kick after the whole substep, N m: applied, torque, damping, push
    _,
    _,
    _,
    APPLIED_LAST,  # APPLIED_NEXT of the previous kick, N m: applied, torque, damping, push
    _,
    _,
    _,
    FREE,  # flag: 1 if the derivative action (BRAKE) acts at the time of the whole substep, else 0
    FREE_BEFORE,  # fraction of the half kick before the whole substep in which the derivative action acts
    FREE_AFTER,  # fraction of the half kick after the whole substep in which the derivative action acts
    LINK_WORK,  # work of the actuator on the link since the start, J
    LIMIT_LOSS,  # work that the effort limit prevented, J
    DAMPING_LOSS,  # energy lost in the link's damping, J
    MOTOR_WORK,  # work of the motors, J
    FRICTION_LOSS,  # energy lost by the motors' friction and damping, and at their limits, J
    WINDING_LOSS,  # heat of the windings, J
    HYSTERESIS_LOSS,  # energy lost in the springs' hysteresis, J
    SPRING_ENERGY,  # energy stored in the springs, J
    MOTOR_ENERGY,  # kinetic energy of the motors, J
    START_ENERGY,  # energy of springs and motors at the start, J
    RESIDUAL,  # motor work - losses - change of the stored energy - link work, J
    NET_LINK_WORK,  # work of actuator and external torques on the link, minus the damping loss of the link, J
    TURNOVER,  # sum of the magnitudes of all work at the joint, J
    EXCESS,  # largest value so far of |RESIDUAL| - asrsim.simulation.kernel.SHARE * TURNOVER, J
    STIFFNESS,  # stiffness of the spring, N m/rad
    LAW_ENERGY,  # result of the spring's energy law in its last call, without hysteresis, J
    STIFFEST,  # largest stiffness so far, N m/rad
    EFFORT_COUNT,  # number of substeps in which the effort limit clipped the torque
    VELOCITY_COUNT,  # number of substeps beyond the link's velocity limit
    SATURATION_COUNT,  # number of substeps with a motor at its torque limit
    MOTOR_STOP_COUNT,  # number of substeps with a motor at its position stop
    MOTOR_SPEED_COUNT,  # number of substeps with a motor at its speed limit
    DEFLECTION_COUNT,  # number of substeps with a spring beyond its largest deflection
    STOP_COUNT,  # number of substeps with the link at its position stop
    FIRST_MOTOR,  # column at which the block of the first motor begins
) = range(53)
PUSHES = 4
"""Number of columns in a block of torques that do work on the link: applied, torque, damping, push."""

# S: columns of a motor.
(
    MOTOR_POSITION,  # position of the motor at the beginning of the next substep, rad
    MOTOR_VELOCITY,  # velocity of the motor after the last kick, rad/s
    ANCHOR,  # position at which the bristles of the friction stick (Dahl's w), rad
    MOTOR_INTEGRAL,  # integral action of the motor's controller, in units of the command, N m
    KICK_POSITION,  # position of the motor at the kick, rad
    MEAN_VELOCITY,  # mean velocity of the motor over the kick, rad/s
    DRIVE_TORQUE,  # torque of the motor after its limit, N m
    FRICTION,  # friction torque on the motor, N m
    LOAD,  # torque of the motor's spring, N m
    WORK,  # work since the last whole substep, J: of the motor's torque, lost to friction and damping, against the spring
    _,
    _,
    ROW_WORK,  # values of WORK between the last two whole substeps, J
    _,
    _,
    LAST_KICK_POSITION,  # position of the motor at the previous kick, rad
    KINETIC,  # kinetic energy of the motor at its mean velocity, J
    AT_LIMIT,  # number of coming energy balances that a stop or the speed limit affects: 2 after a kick in which it acted
    CURRENT,  # current of the winding, A
    VOLTAGE,  # voltage of the winding, V
    LAST_POWER,  # heat loss of the winding at the previous kick, W
    HYSTERESIS,  # hysteresis torque of the motor's spring, N m
    DEFLECTION,  # deflection of the motor's spring at the last kick, rad; NaN before the first kick
    LAST_HYSTERESIS,  # hysteresis torque of the motor's spring at the previous kick, N m
    LAST_DEFLECTION,  # deflection of the motor's spring at the previous kick, rad
    READ_ERROR,  # position error of the motor's sensor, rad: measured minus true position
    READ_PUSH,  # torque caused by the error of the measured velocity, in units of the command, N m
    PER_MOTOR,  # number of columns per motor
) = range(28)
MOTOR_WORKS = 3
"""Number of columns in WORK: work of the motor's torque, work lost to friction and damping, work against the spring."""

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
"""Name in logs of the quantity in each column of a joint."""
LOGGED_OF_MOTORS = {
    KICK_POSITION: "motor_{}_position",
    MEAN_VELOCITY: "motor_{}_velocity",
    DRIVE_TORQUE: "motor_{}_torque",
    FRICTION: "friction_torque_{}",
    LOAD: "elastic_torque_{}",
    CURRENT: "motor_{}_current",
    VOLTAGE: "motor_{}_voltage",
}
"""Name in logs of the quantity in each column of a motor; {} stands for the number of the motor."""

# P: columns of the link.
(
    P_EFFORT,  # effort limit, N m
    P_FASTEST,  # velocity limit, rad/s
    P_CUTOFF,  # flag: 1 if torque beyond the velocity limit is zeroed, as Gazebo does, else 0
    P_LOWEST,  # largest position at which the link counts as being at its lower stop, rad
    P_HIGHEST,  # smallest position at which the link counts as being at its upper stop, rad
    P_DAMPING,  # constant damping of the link, N m s/rad
    P_DAMPING_RATIO,  # damping ratio of a damping that varies with the stiffness (paper section 4.2.2)
    P_DAMPING_INERTIA,  # inertia to which the damping ratio refers, kg m^2
    P_BRAKE,  # derivative gain of the link's controller (mode 1), N m s/rad
    P_SPRING,  # stiffness of the passive spring, N m/rad
    P_REST,  # rest position of the passive spring, rad
    P_COULOMB,  # Coulomb friction of the joint, N m
    P_STRIBECK,  # Stribeck excess, N m: static friction of the joint minus Coulomb friction
    P_FADE,  # reciprocal of the Stribeck velocity, s/rad
    P_SHARE,  # fraction of the actuator's torque that adds to the friction
    P_PROPORTIONAL,  # proportional gain of the link's controller, N m/rad
    P_INTEGRAL,  # integral gain of the link's controller, N m/(rad s)
    P_DERIVATIVE,  # derivative gain of the link's controller, for sensors, N m s/rad
    P_SUBSTEPS,  # number of motor substeps per substep of the engine, an odd number
    P_MAX_DEFLECTION,  # largest deflection of the springs, rad
    P_LEVEL,  # level of the springs' hysteresis torque, N m
    P_LENGTH,  # deflection over which the hysteresis torque reverses, rad
    P_SAMPLED,  # flag: 1 if the sensors measure at ticks and hold the measurements, 0 if they measure at all times
    P_DELAY,  # delay of the sensors in substeps
    P_QUANTUM,  # resolution of the sensors, rad
    FIRST_DRIVE,  # column at which the block of the first motor begins
) = range(26)

# P: columns of a motor, beginning with the parameters of asrsim.actuators.motor.motor_kick in the order of that function.
(
    D_PROPORTIONAL,  # proportional gain of the controller, command/rad; 1 if the reference is the command
    D_INTEGRAL,  # integral gain of the controller, command/(rad s)
    D_DERIVATIVE,  # derivative gain of the controller, on the negative velocity, command s/rad
    D_HOLD,  # flag: 1 if a controller compares the reference with the position, else 0
    D_INERTIA,  # inertia at the link's side of the gear, kg m^2
    D_DAMPING,  # viscous damping, N m s/rad
    D_GAIN,  # torque per unit of the command, N m/command
    D_LAG,  # damping by the back-EMF if the command is a voltage, N m s/rad
    D_EMF,  # damping by the back-EMF at full voltage, N m s/rad
    D_STALL,  # torque at full voltage and rest, N m
    D_LIMIT,  # largest torque, N m
    D_COULOMB,  # Coulomb level of the friction, N m
    D_EXCESS,  # Stribeck excess, N m: static friction minus Coulomb friction
    D_FADE,  # reciprocal of the Stribeck velocity, s/rad
    D_SHARE,  # fraction of the spring's torque that adds to the Coulomb level
    D_BRISTLES,  # stiffness of the friction's bristles, N m/rad
    D_LOW,  # lower stop, rad
    D_HIGH,  # upper stop, rad
    D_MOST,  # speed limit, rad/s
    D_MAX_TORQUE,  # smallest torque at which the motor counts as saturated, N m
    D_CONSTANT,  # torque constant at the output, N m/A; 0: the motor is not electric
    D_RESISTANCE,  # resistance of the winding, ohm
    PER_DRIVE,  # number of columns per motor
) = range(23)

(
    KIND, MOTORS, DYNAMIC, SPRINGS, PLACED, SPRING_LAW, JOINT_STEP, CONTROLLERS, ON_LINK,
    THETAS, TORQUES, RINGS, RING, LAW,
) = range(14)  # fmt: skip
"""Columns of K. KIND: kind of the joint. MOTORS: number of positions that the spring's law takes. DYNAMIC: number of positions
with motor dynamics; the others equal their references. SPRINGS: number of springs, one for each motor. PLACED:
number of positions that change the springs' energy. SPRING_LAW, JOINT_STEP: addresses of the actuator's laws and of the
stepping's function for a joint, 0 if there is none. CONTROLLERS: number of controllers with sensors. ON_LINK: 1 if the sensors
measure the link. THETAS, TORQUES, RINGS: first columns in S of the law's positions, of its torques and of the sensors' memory.
RING: number of columns of one sensor's memory. LAW: first column in P of the law's parameters."""
KINDS = 14
"""Number of columns of K."""

PASSIVE, DIRECT, CONTROLLED, SPRUNG = range(4)
"""Kinds of joints: without actuator, in mode 0, in mode 1, with springs."""

EXTERNAL, GOALS = 0, 1
"""First columns of an input row: external torque (N m), and goals of the motors. Two columns for each sensor follow: whether
the sensor takes a sample at the beginning of the kick or piece, and the noise."""

(STEP, WEIGHT_NOW, WEIGHT_LAST, FIRST_DRIFT, IMPLICITNESS, LINK_IMPLICITNESS, STAGGERED) = range(7)
"""Constants of a stepping: substep in s; weights of the present and the previous engine velocity in the velocity at the whole
substep; fraction of a motor's step before its kick; implicitness of the motors' damping; implicitness of the link's damping; 1
if velocities belong to half steps."""

(E_POSITION, E_VELOCITY, E_TORQUE, E_DAMPING, E_FRICTION) = range(5)
"""Columns of the array that joints and engine exchange; see `asrsim.engines.base`."""

HEALTHY, NO_VALUE, RAN_AWAY = range(3)
"""Health of a world: the world can continue; a law gave a value that is not finite; a link became impossibly fast."""
