"""Motors, springs and controllers of a joint in MJCF, made of constructs that the program of the file simulates correctly."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.engines.mujoco_library import load
from asrsim.errors import ScenarioError
from asrsim.exports.constructs import Constructs
from asrsim.exports.springs import Spline, spline_of
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.prepared import Prepared

TINY = 1e-9
"""Mass (kg) and moments of inertia (kg m^2) of the body of a motor. They are nearly 0, since MuJoCo rejects bodies without
mass. The inertia of the motor is the armature of the body's joint.
"""
FRICTION_SOLREF, FRICTION_SOLIMP = [0.004, 1.0], [0.99, 0.999, 0.01, 0.5, 2.0]
"""Parameters of MuJoCo's solver with which its friction is nearly Coulomb friction."""
STOP_SOLREF, STOP_SOLIMP = [0.004, 1.0], [0.99, 0.999, 0.001, 0.5, 2.0]
"""Parameters of MuJoCo's solver with which joint stops are stiff."""
BRAKE = 10.0
"""Time step, divided by the time constant with which a motor above its speed limit is braked. With larger values the motor
chatters about the limit; with smaller values it exceeds the limit (measured with time steps of 0.25 to 1 ms).
"""
IMPLICIT = 0.9
"""Fraction of a motor's inertia that implicit damping replaces, if damping limits the motor's speed. In each time step, the
speed above the limit falls by this fraction.
"""


def motor_name(joint: str, index: int) -> str:
    """Common name of a motor's body, joint and actuator in the model; index: number of the motor, from 1."""
    return f"{joint}.motor_{index}"


def starts_of(prepared: Prepared) -> Iterator[tuple[str, float, float]]:
    """Name of the model's joint, initial position and initial velocity, for each joint and each motor; rad (m), rad/s (m/s)."""
    for drive, *start in zip(prepared.drives, prepared.initial_positions, prepared.initial_velocities, strict=True):
        for i, (position, velocity, *_) in enumerate([start, *drive.motor_starts(drive.dynamic_motors)]):
            yield motor_name(drive.name, i) if i else drive.name, float(position), float(velocity)


def stiffness_name(joint: str) -> str:
    """Common name of the tendon and actuator of a spring whose stiffness is a control."""
    return f"{joint}.stiffness"


def set_limits(joint: Any, stops: tuple[float, float], damping: float, friction: float) -> None:
    """Add stops, damping and friction to a joint of the model."""
    joint.damping[0], joint.frictionloss = damping, friction
    if friction:
        joint.solref_friction, joint.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP
    if any(map(math.isfinite, stops)):
        joint.range = np.clip(stops, -1e6, 1e6)
        joint.solref_limit, joint.solimp_limit = STOP_SOLREF, STOP_SOLIMP


def refused(stepped: SteppedJoint, constructs: Constructs) -> Iterator[str]:
    """Parts of a joint that a program with only the constructs `constructs` cannot step, in words."""
    drive = stepped.drive
    if not constructs.delays and delay_of(stepped):
        yield "delay of its commands"
    if drive is None or constructs.dc_motors:
        return
    parts = {"_integral": "integral action of its controllers"} if drive.mode.controller else {}
    if drive.mode.spring:
        parts["_stribeck_friction"] = "Stribeck friction of its motors"
    found = {text for name, value in drive.values.items() for end, text in parts.items() if value and name.endswith(end)}
    yield from sorted(found)
    if "hysteresis" in drive.stages:
        yield "hysteresis of its springs"


def springs_of(
    drive: Drive, reach: float, adjuster: Array, knots: int | None = None, *, curved: bool = True
) -> tuple[Spline, ...]:
    """Splines of the springs of a drive, one for each motor. adjuster: positions of the adjuster, if the actuator has one;
    curved: whether the pieces are cubic; False: they are linear. Raises ScenarioError for a spring whose torque depends on more
    than the deflection of its own motor.
    """
    actuator, count = drive.actuator, drive.actuator.motors
    tail = [*adjuster, 0.0][: actuator.positions() - count]
    law: Any = actuator.elastic_torques

    def torque(i: int, deflection: float) -> float:
        motors = [deflection if j == i else 0.0 for j in range(count)]
        return float(law(0.0, *motors, *tail, drive.elastic)[i])

    generator = np.random.default_rng(0)
    for q, *motors in generator.uniform(-0.5 * min(reach, 1.0), 0.5 * min(reach, 1.0), (16, count + 1)).tolist():
        alone = [torque(i, motor - q) for i, motor in enumerate(motors)]
        if not np.allclose(law(q, *motors, *tail, drive.elastic)[:count], alone, rtol=1e-6, atol=1e-9):
            raise ScenarioError(
                f"the springs of '{actuator.name}' on joint '{drive.joint}' depend on more than the deflection between motor "
                "and link, which springs of MuJoCo cannot represent",
                key=drive.joint,
                code="export-law",
            )
    limit = drive.max_deflection
    return tuple(spline_of(partial(torque, i), reach=reach, limit=limit, knots=knots, curved=curved) for i in range(count))


def add_motors(spec: Any, drive: Drive, splines: Sequence[Spline], delay: float, constructs: Constructs) -> None:
    """Add the motors of a joint with their controllers and springs. splines: a spline for each motor; empty: other code adds
    the springs. delay: delay of the motors' commands, s.
    """
    for i in range(drive.actuator.motors):
        name, electric = motor_name(drive.joint, i + 1), drive.electric[i]
        body = spec.worldbody.add_body(name=name, mass=TINY, inertia=[TINY] * 3, ipos=[0.0] * 3, explicitinertial=True)
        joint = body.add_joint(name=name, armature=drive.motor_inertia[i])
        servo = drive.mode.command == "torque"
        bristles = servo and constructs.dc_motors
        friction = 0.0 if bristles else drive.motor_friction[i]
        set_limits(joint, drive.motor_ranges[i], drive.values[f"motor_{i + 1}_damping"], friction)
        for number, (low, high, *stiffness) in enumerate(splines[i].pieces.tolist() if splines else (), start=1):
            spring = _tendon(spec, f"{drive.joint}.spring_{i + 1}.{number}", name, drive.joint)
            spring.stiffness, spring.springlength = stiffness, [low, high]
        for stage, own in drive.stages.items():
            if stage in STAGES_OF_MUJOCO and own[i] is not None:
                STAGES_OF_MUJOCO[stage](spec, drive, i + 1, own[i])
        if servo:
            gains: tuple[float, ...] = ()
            if drive.mode.controller:
                gains = drive.proportional[i], drive.integral[i], drive.derivative[i] + electric.lag
            motor = add_servo(
                spec,
                name,
                gains,
                constructs,
                inertia=drive.motor_inertia[i],
                limit=drive.max_torque[i],
                fastest=drive.max_velocity[i],
                friction=_friction(drive, i + 1),
            )
        else:
            motor = _actuator(spec, name, electric.gain, electric.lag, limit=drive.max_torque[i])
        set_delay(spec, motor, delay)


def _tendon(spec: Any, name: str, motor: str, joint: str) -> Any:
    """Add a tendon without stiffness, whose length is the deflection between a motor and its joint."""
    tendon = spec.add_tendon(name=name)
    tendon.wrap_joint(motor, 1.0)
    tendon.wrap_joint(joint, -1.0)
    return tendon


def _friction(drive: Drive, index: int) -> tuple[float, ...]:
    """LuGre friction of motor `index`, as MuJoCo's parameters: stiffness (N m/rad) and damping of the bristles, torque while
    sliding and torque at rest (N m), Stribeck velocity (rad/s); all 0 without friction.
    """
    values = {name: drive.values[f"motor_{index}_{name}"] for name in ("friction_torque", "stribeck_friction")}
    sliding, sticking = values["friction_torque"], sum(values.values())
    if not sticking:
        return (0.0,) * 5
    stiffness, fade = (drive.values[f"motor_{index}_{name}"] for name in ("friction_stiffness", "stribeck_velocity"))
    return stiffness, 0.0, sliding, sticking, fade


def add_servo(
    spec: Any,
    joint: str,
    gains: Sequence[float],
    constructs: Constructs,
    *,
    inertia: float,
    limit: float,
    fastest: float,
    friction: Sequence[float] = (0.0,) * 5,
) -> Any:
    """Add a motor with a PID controller, a speed limit and a torque limit. gains: proportional, integral and derivative gain;
    empty: the motor has no controller, and its command is the torque. inertia in kg m^2; limit: torque limit in N m; fastest:
    speed limit in rad/s; friction: see `_friction`.
    """
    proportional, integral, derivative = gains or (0.0, 0.0, 0.0)
    if not constructs.dc_motors:
        actuator = _actuator(spec, joint, proportional if gains else 1.0, derivative, limit=limit)
        actuator.biasprm[1] = -proportional
        if math.isfinite(fastest):
            _brake(spec, joint, inertia, fastest, limit)
        return actuator
    # The torque constant of MuJoCo's DC motor is 1 N m/A here, so that the limit of its voltage limits its speed. Above this
    # speed, the back-EMF brakes the motor with 1 / resistance N m s/rad. Below this speed, the controller compensates the
    # back-EMF.
    mujoco = load()
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_dcmotor(
        motorconst=[1.0, 0.0],
        resistance=spec.option.timestep / (BRAKE * inertia),
        saturation=[limit if math.isfinite(limit) else 0.0, 0.0, 0.0],
        controller=[proportional, integral, derivative, 0.0, 0.0, fastest if math.isfinite(fastest) else 0.0],
        lugre=friction,
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS if gains else mujoco.mjtCtrlInput.mjINPUT_FF),
    )
    return actuator


def _brake(spec: Any, name: str, inertia: float, fastest: float, limit: float) -> None:
    """Limit the speed of a motor to `fastest` (rad/s) by viscous damping. An actuator without control cancels this damping up
    to the limit. inertia: inertia of the motor, kg m^2; limit: largest torque of the motor, N m.

    MuJoCo's Euler integrator takes the damping implicitly, as if the inertia were larger by time step times damping. The
    armature is reduced by this product, so that the effective inertia is the inertia of the motor. The damping begins to act
    below the limit, so that the largest torque drives the motor exactly to the limit.
    """
    mujoco = load()
    joint, step = spec.joint(name), spec.option.timestep
    damping = IMPLICIT * inertia / step
    joint.armature = (1.0 - IMPLICIT) * inertia
    joint.damping[0] += damping
    actuator = spec.add_actuator(name=f"{name}.speed_limit", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    # Use a very small gain, since with a gain of exactly 0 MuJoCo would interpret the bias as a damping ratio.
    actuator.gainprm[0], actuator.biastype, actuator.biasprm[2] = 1e-9, mujoco.mjtBias.mjBIAS_AFFINE, damping
    begin = max(damping * fastest - limit, 0.0) if math.isfinite(limit) else damping * fastest
    actuator.forcerange, actuator.ctrlrange = [-begin, begin], [0.0, 1e-9]


def _actuator(spec: Any, joint: str, gain: float, damping: float, *, limit: float) -> Any:
    """Add an actuator with the torque gain * control - damping * velocity, up to `limit` N m."""
    mujoco = load()
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0], actuator.biasprm[2] = gain, -damping
    if math.isfinite(limit):
        actuator.forcerange = [-limit, limit]
    return actuator


def _hysteresis(spec: Any, drive: Drive, index: int, own: Any) -> None:
    """Add the hysteresis of spring `index`, as bristles between motor and joint. The bristles bend by `own.length` (rad) before
    they slip at the torque `own.level` (N m).
    """
    level, length = own.level, own.length
    mujoco, name = load(), f"{drive.joint}.hysteresis_{index}"
    _tendon(spec, name, motor_name(drive.joint, index), drive.joint)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    # Use only the bristles of the DC motor, as the hysteresis. The motor has no other effect.
    actuator.set_to_dcmotor(motorconst=[1e-6, 0.0], resistance=1.0, lugre=[level / length, 0.0, level, level, 1.0])


def _damper(spec: Any, drive: Drive, index: int, own: Any) -> None:
    """Add the damper of spring `index` between motor and joint."""
    tendon = _tendon(spec, f"{drive.joint}.damper_{index}", motor_name(drive.joint, index), drive.joint)
    tendon.damping[0] = own.damping


STAGES_OF_MUJOCO: Mapping[str, Callable[[Any, Drive, int, Any], None]] = {"hysteresis": _hysteresis, "damper": _damper}
"""Functions that add a stage at motor 1, 2, ... to a model, by name of the stage. Other stages are not exported."""


def add_adjustable_spring(spec: Any, drive: Drive) -> None:
    """Add a linear spring whose stiffness in N m/rad is a control."""
    mujoco, name = load(), stiffness_name(drive.joint)
    _tendon(spec, name, motor_name(drive.joint, 1), drive.joint)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    actuator.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
    actuator.gainprm[:3] = [0.0, -1.0, 0.0]


def delay_of(stepped: SteppedJoint) -> float:
    """Delay of a joint's commands, s."""
    return stepped.command_imperfections.delay if stepped.command_imperfections is not None else 0.0


def set_delay(spec: Any, actuator: Any, delay: float) -> None:
    """Delay the control of an actuator by `delay` s, rounded to whole time steps of the model."""
    steps = round(delay / spec.option.timestep)
    if steps:
        # Make the delay half a step shorter, so that rounding errors cannot select an earlier sample.
        actuator.delay, actuator.nsample = (steps - 0.5) * spec.option.timestep, steps + 1
