"""A scenario's robot as MJCF: motors are bodies with armature, springs are tendons with polynomial stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators.drive import Drive
from asrsim.engines.mujoco_build import add_shape, assemble, link_body, quaternion_wxyz
from asrsim.engines.mujoco_library import load
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
CONSTANT = "its friction is constant: the parts that depend on speed or load are left out"
LACKS = {
    "_integral": "its controllers have no integral action",
    "_stribeck_friction": CONSTANT,
    "_load_friction": CONSTANT,
    "_friction_torque": "the friction of its motors has no pre-sliding",
    "_max_velocity": "its motors have no speed limit",
    "_max_voltage": "the voltage limit of its motors limits their torque at rest",
    "hysteresis_torque": "its springs have no hysteresis",
}
"""Effects of parameters that the model lacks, by the end of the parameter's name."""


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
        timestep: Time step of the model, s; None: the scenario's step.

    Raises:
        ScenarioError: A mode or a spring law that MJCF cannot represent.
        SimulationError: MuJoCo refuses the model.
    """
    mujoco, scenario, merged = load(), prepared.scenario, merge_fixed(prepared.robot)
    robot, warnings = usable_shapes(merged.robot, visuals=True, package_paths=scenario.package_paths)
    spec = assemble(scenario, robot, (0.0, 0.0, 0.0), shapes=True)
    spec.modelname, spec.modelfiledir = robot.name, str(path.parent.absolute())
    spec.comment = " Made by asrsim export. Controls are the inputs of the motors: position, torque, voltage or current. "
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.timestep = timestep or scenario.step
    bodies = {link.name: spec.body(link_body(link.name)) for link in robot.links}
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
            _motors(spec, drive, splines[drive.joint])
        elif drive is not None:
            # Modes 0 and 1: torque or PID controller on the link itself.
            gain, damping = (drive.values[f"controller_1_{name}"] for name in ("proportional", "derivative"))
            gains = (gain, gain, damping) if drive.mode.controller else (1.0, 0.0, 0.0)
            _actuator(spec, drive.joint, *gains, limit=stepped.joint.most_effort)
        for text in _lacks(prepared, stepped, splines.get(stepped.name, ()), positions, speeds):
            lacks.setdefault(text, []).append(stepped.name)
    remarks += [f"{listed(dict.fromkeys(joints), MOST_NAMES)}: {text}" for text, joints in lacks.items()]
    effects = (*scenario.command_effects.values(), *scenario.sensor_effects.values())
    if scenario.wrenches:
        remarks.append("the scenario's forces on links are neither in the model nor in the replay")
    if any(effect.active for effect in effects):
        remarks.append("delays, noise and steps of commands and sensors are not in the model")
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
    return f"{joint}/motor_{index}"


def _describe(spec: Any, body: Any, link: Link) -> None:
    """Add name, inertia and visuals of a link to its body."""
    # MuJoCo reserves the name "world".
    body.name = "world_link" if link.name == "world" else link.name
    moments, rpy = principal_axes(link)
    body.mass, body.inertia = max(link.mass or 0.0, TINY), np.maximum(moments, TINY)
    body.ipos, body.iquat = link.centre_of_mass, quaternion_wxyz(rpy)
    for geom in body.geoms:
        geom.group = COLLISION_GROUP
    for index, shape in enumerate(link.visuals):
        geom = add_shape(spec, body, f"visual/{link.name}/{index}", shape)
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


def _motors(spec: Any, drive: Drive, splines: Sequence[Spline]) -> None:
    """Add the motors of a joint with their springs and controllers."""
    for i, spline in enumerate(splines):
        name, electric = motor_name(drive.joint, i + 1), drive.electric[i]
        body = spec.worldbody.add_body(name=name, mass=TINY, inertia=[TINY] * 3, ipos=[0.0] * 3, explicitinertial=True)
        joint = body.add_joint(name=name, armature=drive.motor_inertia[i])
        _set_limits(joint, drive.motor_ranges[i], drive.values[f"motor_{i + 1}_damping"], drive.motor_friction[i])
        for number, (low, high, *stiffness) in enumerate(spline.pieces.tolist(), start=1):
            spring = spec.add_tendon(name=f"{drive.joint}/spring_{i + 1}/{number}", stiffness=stiffness)
            spring.springlength = [low, high]
            spring.wrap_joint(name, 1.0)
            spring.wrap_joint(drive.joint, -1.0)
        gains = electric.gain, 0.0, electric.lag
        if drive.mode.controller:
            gains = drive.proportional[i], drive.proportional[i], drive.derivative[i] + electric.lag
        _actuator(spec, name, *gains, limit=drive.max_torque[i])


def _actuator(spec: Any, joint: str, gain: float, stiffness: float, damping: float, *, limit: float) -> None:
    """Add an actuator with the torque gain * control - stiffness * position - damping * velocity."""
    mujoco = load()
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0], actuator.biasprm[:3] = gain, [0.0, -stiffness, -damping]
    if math.isfinite(limit):
        actuator.forcerange = [-limit, limit]


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
    for name, value in drive.values.items():
        used = drive.mode.controller if name.startswith("controller") else drive.mode.spring
        if used and value and math.isfinite(value):
            yield from (text for end, text in LACKS.items() if name.endswith(end))
    if drive.mode.spring and drive.actuator.adjuster:
        yield f"its adjuster stays at {positions[drive.actuator.motors, 0]:g} {drive.actuator.reference_2_unit}"
    if any((np.abs(speed) > 0.999 * limit).any() for speed, limit in zip(speeds, drive.max_velocity, strict=False)):
        yield "its motors reach their speed limit in this scenario, which makes the error large"
