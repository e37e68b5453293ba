"""A scenario's robot as MJCF: motors are bodies with armature, springs are tendons with polynomial stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.engines.mujoco_build import HARD, add_shape, assemble, couple, link_body, quaternion_wxyz
from asrsim.engines.mujoco_library import library_version, load
from asrsim.errors import ScenarioError, SimulationError, listed
from asrsim.export.springs import Spline, spline_of
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import merge_fixed
from asrsim.robot.meshes import usable_shapes
from asrsim.robot.model import Link
from asrsim.robot.poses import roll_pitch_yaw
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.prepare import Prepared

MARGIN, LEAST_REACH = 2.0, 1.0
"""Range of deflections in which springs are fitted, as a multiple of the scenario's largest deflection; smallest range, rad."""
TINY = 1e-9
"""Smallest mass (kg) and moment of inertia (kg m^2) of a body: MuJoCo rejects bodies without mass. Motors have this mass; their
inertia is the armature of their joint.
"""
FRICTION_SOLREF, FRICTION_SOLIMP = [0.004, 1.0], [0.99, 0.999, 0.01, 0.5, 2.0]
"""Solver parameters with which friction is nearly Coulomb friction."""
STOP_SOLREF, STOP_SOLIMP = [0.004, 1.0], [0.99, 0.999, 0.001, 0.5, 2.0]
"""Solver parameters of stiff joint stops."""
VISUAL_GROUP, COLLISION_GROUP, SITE_GROUP = 2, 3, 4
"""Groups of the model's elements; viewers of MuJoCo show the groups 0 to 2."""
MOST_NAMES = 5
"""Largest number of joints that a remark names."""
COUPLING_STEPS = 2.0
"""Time constant of couplings of joints, in time steps: the smallest that MuJoCo accepts."""
BRAKE = 10.0
"""Time step divided by the time constant with which a motor at its speed limit brakes. With larger values the motor
chatters about the limit; with smaller ones it passes the limit (measured at 0.25 to 1 ms)."""
STILL = 1e-9
"""Range of an adjuster's positions, in its unit, below which the adjuster does not move."""
CONSTANT = "its friction is constant: the parts that depend on speed or load are left out"
LACKS = {
    "_load_friction": "the friction of its motors does not depend on their load",
    "_max_voltage": "the voltage limit of its motors limits their torque at rest",
}
"""Effects of parameters that the model lacks, by the end of the parameter's name."""
DIRECT_LACKS = {"_max_velocity": "its motors have no speed limit", "_integral": "its controllers have no integral action"}
"""Effects that motors lack whose command is a voltage or a current, by the end of the parameter's name."""


@dataclass(frozen=True, kw_only=True)
class Mjcf:
    """A model for MuJoCo, and remarks on parts of the scenario that the model lacks."""

    spec: Any
    """The model as an MjSpec; `asrsim.engines.mujoco_library.exact_xml` gives its text."""
    splines: Mapping[str, tuple[Spline, ...]]
    """Splines of the springs, by joint."""
    remarks: tuple[str, ...]
    """Sentences about parts of the scenario that the model lacks."""


def model_of(
    prepared: Prepared, run: Mapping[str, Array], path: Path, mesh_file: Callable[[str], str], *, knots: int | None = None,
    timestep: float | None = None,
) -> Mjcf:  # fmt: skip
    """Model of a scenario.

    Args:
        prepared: The scenario.
        run: Results of the scenario's run in asrsim; springs are fitted over its deflections.
        path: Path of the model's file.
        mesh_file: Function that returns the file that MuJoCo reads in place of a mesh, relative to the folder of the model.
        knots: Number of knots on each side of the splines; None: as many as the laws need.
        timestep: Time step of the model, s; None: half of the scenario's step.

    Raises:
        ScenarioError: A mode or a spring law that MJCF cannot represent.
        SimulationError: MuJoCo refuses the model.
    """
    mujoco, scenario, merged = load(), prepared.scenario, merge_fixed(prepared.robot)
    robot, warnings = usable_shapes(merged.robot, visuals=True, package_paths=scenario.package_paths)
    spec = assemble(scenario, robot, (0.0, 0.0, 0.0), shapes=True)
    spec.modelname, spec.modelfiledir = robot.name, str(path.parent.absolute())
    spec.comment = (
        f" Made by asrsim export for MuJoCo {library_version()}. "
        "Controls are the inputs of the motors: position, torque, voltage or current. "
    )
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.timestep = timestep or 0.5 * scenario.step
    if not spec.pairs:
        # Elliptic friction cones serve contacts only, and some programs that read MJCF do not know them.
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1.0
    bodies = {link.name: spec.body(link_body(link.name)) for link in robot.links}
    couple(spec, robot, HARD, COUPLING_STEPS * spec.option.timestep)
    for link in robot.links:
        _describe(spec, bodies[link.name], link)
    for name, place in merged.places.items():
        if name not in bodies:
            turn = quaternion_wxyz(roll_pitch_yaw(place.pose.rotation))
            bodies[place.body].add_site(name=name, pos=place.pose.position, quat=turn, group=SITE_GROUP)
    remarks, splines = [f"shapes are left out ({len(warnings)} groups); the first: {warnings[0]}"] if warnings else [], {}
    lacks: dict[str, list[str]] = {}
    for j, stepped in enumerate(prepared.drives):
        # Positions and velocities (motors, n) of the motors; the last one is the adjuster, if the actuator has one.
        positions, speeds = (
            np.array([values[:, j] for name, values in run.items() if name.startswith("motor") and name.endswith(quantity)])
            for quantity in ("position", "velocity")
        )
        joint, drive = spec.joint(stepped.name), stepped.drive
        joint.stiffness[0], joint.springref = stepped.joint.spring_stiffness, stepped.joint.spring_reference
        joint.armature = stepped.joint.armature
        _set_limits(joint, stepped.joint.stops, stepped.constant_damping, stepped.joint.friction)
        if drive is not None and drive.mode.spring:
            if not drive.mode.motor:
                raise ScenarioError(
                    f"joint '{drive.joint}' is in mode {drive.mode.number} ({drive.mode.name}), in which motors reach their "
                    "references at once: MuJoCo has no such motor",
                    key=f"modes.{drive.joint}", hint="Take mode 5 or 6: --set modes=6", code="export-mode",
                )  # fmt: skip
            count = drive.actuator.motors
            deflections = positions[:count] - run["link_position"][:, j]
            reach = max(MARGIN * float(np.abs(deflections).max()), LEAST_REACH)
            splines[drive.joint] = springs_of(drive, reach, np.nan_to_num(positions[count:, 0]), knots)
            moving = drive.actuator.adjuster and float(np.ptp(positions[count])) > STILL
            _motors(spec, drive, () if moving else splines[drive.joint], _delay(stepped))
            if moving:
                _adjustable_spring(spec, drive)
        elif drive is not None:
            # Modes 0 and 1: torque or PID controller on the link itself.
            names = ("proportional", "integral", "derivative")
            gains = tuple(drive.values[f"controller_1_{name}"] for name in names) if drive.mode.controller else ()
            motor = _servo(spec, drive.joint, gains, inertia=1.0, limit=stepped.joint.most_effort, fastest=math.inf)
            _set_delay(spec, motor, _delay(stepped))
        for text in _lacks(prepared, stepped, splines.get(stepped.name, ()), positions, speeds):
            lacks.setdefault(text, []).append(stepped.name)
    remarks += [f"{listed(dict.fromkeys(joints), MOST_NAMES)}: {text}" for text, joints in lacks.items()]
    effects = (*scenario.command_effects.values(), *scenario.sensor_effects.values())
    shifted = [link.name for link in robot.links if link.gravity and link.weightless_mass not in (0.0, link.mass)]
    if shifted:
        remarks.append(
            f"{listed(shifted, MOST_NAMES)}: gravity acts on a part of the body; here a smaller gravity acts on all of it"
        )
    if scenario.wrenches:
        remarks.append("the scenario's forces on links are neither in the model nor in the replay")
    if any(replace(effect, delay=0.0).active for effect in effects):
        remarks.append("noise, sampling and steps of commands and sensors are not in the model")
    if any(effect.delay for effect in scenario.sensor_effects.values()):
        remarks.append("delays of sensors are not in the model")
    for mesh in spec.meshes:
        # MuJoCo accepts any triangles for a shell; its inertia is not used, since bodies have explicit inertia.
        mesh.inertia, mesh.file = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL, mesh_file(mesh.file)
    try:
        model = spec.compile()
    except ValueError as error:
        raise SimulationError(f"MuJoCo cannot load the model: {' '.join(str(error).split())[:300]}") from error
    _add_start(spec, model, prepared)
    return Mjcf(spec=spec, splines=splines, remarks=tuple(remarks))


def motor_name(joint: str, index: int) -> str:
    """Common name of a motor's body, joint and actuator in the model; index: number of the motor, from 1."""
    return f"{joint}.motor_{index}"


def stiffness_name(joint: str) -> str:
    """Common name of the tendon and actuator of a spring whose stiffness is a control."""
    return f"{joint}.stiffness"


def _describe(spec: Any, body: Any, link: Link) -> None:
    """Add name, inertia and visuals of a link to its body."""
    # MuJoCo reserves the name "world".
    body.name = "world_link" if link.name == "world" else link.name
    moments, rpy = principal_axes(link)
    body.mass, body.inertia = max(link.mass or 0.0, TINY), np.maximum(moments, TINY)
    body.ipos, body.iquat = link.centre_of_mass, quaternion_wxyz(rpy)
    if mass := link.weightless[0]:
        body.gravcomp = mass / body.mass
    for geom in body.geoms:
        geom.group = COLLISION_GROUP
    for index, shape in enumerate(link.visuals):
        geom = add_shape(spec, body, f"visual.{link.name}.{index}", shape)
        geom.group, geom.contype, geom.conaffinity, geom.rgba = VISUAL_GROUP, 0, 0, shape.colour or geom.rgba


def _set_limits(joint: Any, stops: tuple[float, float], damping: float, friction: float) -> None:
    """Add stops, damping and friction to a joint."""
    joint.damping[0], joint.frictionloss = damping, friction
    if friction:
        joint.solref_friction, joint.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP
    if any(map(math.isfinite, stops)):
        joint.range = np.clip(stops, -1e6, 1e6)
        joint.solref_limit, joint.solimp_limit = STOP_SOLREF, STOP_SOLIMP


# -- motors, springs, controllers ------------------------------------------------------------------------------------


def springs_of(drive: Drive, reach: float, adjuster: Array, knots: int | None = None) -> tuple[Spline, ...]:
    """Splines of the springs of a drive, one for each motor. adjuster: position of the adjuster, if the actuator has one.
    Raises ScenarioError for a law that depends on more than each motor's own deflection.
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
                f"the springs of '{actuator.name}' on joint '{drive.joint}' depend on more than each motor's own deflection; "
                "springs of MuJoCo cannot",
                key=drive.joint, code="export-law",
            )  # fmt: skip
    limit = drive.max_deflection
    return tuple(spline_of(partial(torque, i), reach=reach, limit=limit, knots=knots) for i in range(count))


def _motors(spec: Any, drive: Drive, splines: Sequence[Spline], delay: float) -> None:
    """Add the motors of a joint with their controllers and springs. splines: one for each motor; empty: the springs are added
    elsewhere. delay: delay of the commands, s."""
    for i in range(drive.actuator.motors):
        name, electric = motor_name(drive.joint, i + 1), drive.electric[i]
        body = spec.worldbody.add_body(name=name, mass=TINY, inertia=[TINY] * 3, ipos=[0.0] * 3, explicitinertial=True)
        joint = body.add_joint(name=name, armature=drive.motor_inertia[i])
        servo = drive.mode.command == "torque"
        friction = 0.0 if servo else drive.motor_friction[i]
        _set_limits(joint, drive.motor_ranges[i], drive.values[f"motor_{i + 1}_damping"], friction)
        for number, (low, high, *stiffness) in enumerate(splines[i].pieces.tolist() if splines else (), start=1):
            spring = _tendon(spec, f"{drive.joint}.spring_{i + 1}.{number}", name, drive.joint)
            spring.stiffness, spring.springlength = stiffness, [low, high]
        hysteresis = drive.stages.get("hysteresis", (None,) * (i + 1))[i]
        if hysteresis is not None:
            _hysteresis(spec, drive, i + 1, hysteresis.level, hysteresis.length)
        if servo:
            gains: tuple[float, ...] = ()
            if drive.mode.controller:
                gains = drive.proportional[i], drive.integral[i], drive.derivative[i] + electric.lag
            motor = _servo(
                spec, name, gains, inertia=drive.motor_inertia[i], limit=drive.max_torque[i], fastest=drive.max_velocity[i],
                friction=_friction(drive, i + 1),
            )  # fmt: skip
        else:
            motor = _actuator(spec, name, electric.gain, electric.lag, limit=drive.max_torque[i])
        _set_delay(spec, motor, delay)


def _tendon(spec: Any, name: str, motor: str, joint: str) -> Any:
    """Add a tendon without stiffness, whose length is the deflection between a motor and its joint."""
    tendon = spec.add_tendon(name=name)
    tendon.wrap_joint(motor, 1.0)
    tendon.wrap_joint(joint, -1.0)
    return tendon


def _friction(drive: Drive, index: int) -> tuple[float, ...]:
    """LuGre friction of motor `index` as MuJoCo takes it: stiffness (N m/rad) and damping of the bristles, torque while sliding
    and at rest (N m), Stribeck velocity (rad/s); all 0 without friction."""
    values = {name: drive.values[f"motor_{index}_{name}"] for name in ("friction_torque", "stribeck_friction")}
    sliding, sticking = values["friction_torque"], sum(values.values())
    if not sticking:
        return (0.0,) * 5
    stiffness, fade = (drive.values[f"motor_{index}_{name}"] for name in ("friction_stiffness", "stribeck_velocity"))
    return stiffness, 0.0, sliding, sticking, fade


def _servo(
    spec: Any, joint: str, gains: Sequence[float], *, inertia: float, limit: float, fastest: float,
    friction: Sequence[float] = (0.0,) * 5,
) -> Any:  # fmt: skip
    """Add a motor with a PID controller, speed limit and torque limit. gains: proportional, integral and derivative; empty: the
    command is the torque. inertia in kg m^2, limit in N m, fastest in rad/s, friction: see `_friction`.

    MuJoCo's DC motor with a torque constant of 1 N m/A limits the voltage, and so the speed; its back-EMF brakes a motor beyond
    the limit with 1 / resistance N m s/rad. Below the limit the controller compensates the back-EMF.
    """
    mujoco = load()
    proportional, integral, derivative = gains or (0.0, 0.0, 0.0)
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_dcmotor(
        motorconst=[1.0, 0.0], resistance=spec.option.timestep / (BRAKE * inertia),
        saturation=[limit if math.isfinite(limit) else 0.0, 0.0, 0.0],
        controller=[proportional, integral, derivative, 0.0, 0.0, fastest if math.isfinite(fastest) else 0.0], lugre=friction,
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS if gains else mujoco.mjtCtrlInput.mjINPUT_FF),
    )  # fmt: skip
    return actuator


def _actuator(spec: Any, joint: str, gain: float, damping: float, *, limit: float) -> Any:
    """Add an actuator with the torque gain * control - damping * velocity."""
    mujoco = load()
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0], actuator.biasprm[2] = gain, -damping
    if math.isfinite(limit):
        actuator.forcerange = [-limit, limit]
    return actuator


def _hysteresis(spec: Any, drive: Drive, index: int, level: float, length: float) -> None:
    """Add the hysteresis of spring `index`: bristles between motor and joint that bend by `length` (rad) before they slip at
    the torque `level` (N m)."""
    mujoco, name = load(), f"{drive.joint}.hysteresis_{index}"
    _tendon(spec, name, motor_name(drive.joint, index), drive.joint)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    # The motor itself has no effect: only its friction is used.
    actuator.set_to_dcmotor(motorconst=[1e-6, 0.0], resistance=1.0, lugre=[level / length, 0.0, level, level, 1.0])


def _adjustable_spring(spec: Any, drive: Drive) -> None:
    """Add a linear spring whose stiffness in N m/rad is a control."""
    mujoco, name = load(), stiffness_name(drive.joint)
    _tendon(spec, name, motor_name(drive.joint, 1), drive.joint)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    actuator.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
    actuator.gainprm[:3] = [0.0, -1.0, 0.0]


def _delay(stepped: SteppedJoint) -> float:
    """Delay of the commands of a joint, s."""
    return stepped.command_effects.delay if stepped.command_effects is not None else 0.0


def _set_delay(spec: Any, actuator: Any, delay: float) -> None:
    """Delay the control of an actuator by `delay` s, rounded to whole time steps."""
    steps = round(delay / spec.option.timestep)
    if steps:
        # Half a step less: rounding must not let the actuator read an earlier sample.
        actuator.delay, actuator.nsample = (steps - 0.5) * spec.option.timestep, steps + 1


def _add_start(spec: Any, model: Any, prepared: Prepared) -> None:
    """Add the initial state of the scenario as a keyframe. model: the compiled model."""
    positions, velocities = model.qpos0.copy(), np.zeros(model.nv)
    for drive, *start in zip(prepared.drives, prepared.initial_positions, prepared.initial_velocities, strict=True):
        for i, (position, velocity, *_) in enumerate([start, *drive.motor_starts(drive.dynamic_motors)]):
            joint = model.joint(motor_name(drive.name, i) if i else drive.name)
            positions[joint.qposadr], velocities[joint.dofadr] = position, velocity
    spec.add_key(name="start", qpos=positions, qvel=velocities)


# -- parts that the model lacks ---------------------------------------------------------------------------------------


def _lacks(
    prepared: Prepared, stepped: SteppedJoint, springs: Sequence[Spline], positions: Array, speeds: Array
) -> Iterator[str]:  # fmt: skip
    """Sentences about parts of a joint that the model lacks. positions, speeds: of its motors in the run (motors, n)."""
    joint, drive = stepped.joint, stepped.drive
    largest = sum(float(np.abs(spring.torque(np.array([-spring.reach, spring.reach]))).max()) for spring in springs)
    if joint.friction_varies:
        yield CONSTANT
    if stepped.link_damping and stepped.link_damping.ratio:
        yield "its damping is constant: the part that depends on the stiffness is left out"
    if prepared.velocity_cutoff and joint.velocity is not None:
        yield "its velocity limit does not cut off the torque"
    if largest > joint.most_effort:
        yield f"its effort limit of {joint.most_effort:g} does not limit its springs, which reach {largest:.3g}"
    if drive is None:
        return
    lacks = LACKS if drive.mode.command not in ("voltage", "current") else LACKS | DIRECT_LACKS
    for name, value in drive.values.items():
        used = drive.mode.controller if name.startswith("controller") else drive.mode.spring
        if used and value and math.isfinite(value):
            yield from (text for end, text in lacks.items() if name.endswith(end))
    if drive.mode.spring and drive.actuator.adjuster:
        place, unit = positions[drive.actuator.motors], drive.actuator.reference_2_unit
        if float(np.ptp(place)) > STILL:
            yield "its spring is linear; its stiffness is the control that ends in 'stiffness'"
        else:
            yield f"its adjuster stays at {place[0]:g} {unit}"
