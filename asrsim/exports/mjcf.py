"""A scenario's robot as MJCF: motors are bodies with armature, and springs are tendons with polynomial stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.actuators.stages import STAGES
from asrsim.engines.mujoco_build import HARD, add_shape, assemble, couple, link_body, quaternion_wxyz
from asrsim.engines.mujoco_library import library_version, load
from asrsim.errors import Problem, ScenarioError, SimulationError, listed
from asrsim.exports.motors import (
    STAGES_OF_MUJOCO,
    TINY,
    add_adjustable_spring,
    add_motors,
    add_servo,
    delay_of,
    refused,
    set_delay,
    set_limits,
    springs_of,
    starts_of,
)
from asrsim.exports.programs.base import Program
from asrsim.exports.springs import Spline
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import merge_fixed
from asrsim.robot.meshes import usable_shapes
from asrsim.robot.model import Link
from asrsim.robot.poses import roll_pitch_yaw
from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.prepared import Prepared

MARGIN, LEAST_REACH = 2.0, 1.0
"""Range of deflections over which springs are fitted. It is `MARGIN` times the largest deflection in the scenario's run, but at
least `LEAST_REACH` rad."""
VISUAL_GROUP, COLLISION_GROUP, SITE_GROUP = 2, 3, 4
"""VISUAL_GROUP, COLLISION_GROUP, SITE_GROUP: groups of the model's visuals, collision shapes and sites. MuJoCo's viewers show
the groups 0 to 2."""
MOST_NAMES = 5
"""Largest number of joints that a remark names."""
COUPLING_STEPS = 2.0
"""Time constant of couplings of joints, in time steps. It is the smallest value that MuJoCo accepts."""
STILL = 1e-9
"""Range of an adjuster's positions in the run, in the unit of the positions, below which the adjuster counts as being at
rest."""
CONSTANT = "its friction is constant: the parts that depend on speed or load are left out"
LACKS = {
    "_load_friction": "the friction of its motors does not depend on load",
    "_max_voltage": "the voltage limit of its motors limits their torque at rest",
}
"""Parts that the model lacks if a parameter is set, by the end of the parameter's name, in words for a remark."""
DIRECT_LACKS = {"_max_velocity": "its motors have no speed limit", "_integral": "its controllers have no integral action"}
"""Parts that the model lacks for motors whose command is a voltage or a current, by the end of the parameter's name."""


@dataclass(frozen=True, kw_only=True)
class Mjcf:
    """A model for MuJoCo, and remarks on parts of the scenario that the model lacks."""

    spec: Any
    """The model as an MjSpec; `asrsim.engines.mujoco_library.exact_xml` gives its text."""
    splines: Mapping[str, tuple[Spline, ...]]
    """Splines of the springs, by joint."""
    remarks: tuple[str, ...]
    """Sentences about the parts of the scenario that the model lacks."""


def model_of(
    prepared: Prepared,
    run: Mapping[str, Array],
    path: Path,
    mesh_file: Callable[[str], str],
    *,
    knots: int | None = None,
    timestep: float | None = None,
    program: Program,
) -> Mjcf:
    """Model of a scenario.

    Args:
        prepared: The scenario.
        run: Results of the scenario's run in asrsim; springs are fitted over the deflections in this run.
        path: Path of the file that the model is for.
        mesh_file: Function that returns the file that MuJoCo reads in place of a mesh, relative to the folder of the model.
        knots: Number of knots on each side of the splines; None: as many as the laws need.
        timestep: Time step of the model, s; None: half of the scenario's step.
        program: Program that the model is for; the model has only constructs that this program simulates correctly.

    Raises:
        ScenarioError: A mode or a spring law that MJCF cannot represent, or a part that needs other constructs.
        SimulationError: MuJoCo refuses the model, or is too old for DC motors.
    """
    constructs = program.constructs
    _check(prepared, program)
    mujoco, scenario, merged = load(), prepared.scenario, merge_fixed(prepared.robot)
    if constructs.dc_motors and not hasattr(mujoco, "mjtCtrlInput"):
        # Versions of MuJoCo before 4 interpret the gains of DC motors in volts.
        raise SimulationError(
            f"files with DC motors need MuJoCo 4, but MuJoCo {library_version()} is imported here: install mujoco-core 4 in an "
            "environment without mujoco 3, or write for mjx or mjlab, whose files have no DC motors"
        )
    robot, warnings = usable_shapes(merged.robot, visuals=True, package_paths=scenario.package_paths)
    spec = assemble(scenario, robot, (0.0, 0.0, 0.0), shapes=True)
    spec.modelname, spec.modelfiledir = robot.name, str(path.parent.absolute())
    spec.comment = (
        f" Made by asrsim export for MuJoCo {library_version()}. "
        "Controls are the inputs of the motors: position, torque, voltage or current. "
    )
    spec.compiler.degree = False
    if constructs.dc_motors:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.timestep = timestep or 0.5 * scenario.step
    if not spec.pairs:
        # Only contacts need elliptic friction cones, and some programs that read MJCF do not support such cones.
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
        # Positions and velocities (motors, n) of the motors in the run. If the actuator has an adjuster, the last row belongs
        # to it.
        positions, speeds = (
            np.array([values[:, j] for name, values in run.items() if name.startswith("motor") and name.endswith(quantity)])
            for quantity in ("position", "velocity")
        )
        joint, drive = spec.joint(stepped.name), stepped.drive
        joint.stiffness[0], joint.springref = stepped.joint.spring_stiffness, stepped.joint.spring_reference
        joint.armature = stepped.joint.armature
        set_limits(joint, stepped.joint.stops, stepped.constant_damping, stepped.joint.friction)
        if drive is not None and drive.mode.spring:
            if not drive.mode.motor:
                raise ScenarioError(
                    f"joint '{drive.joint}' is in mode {drive.mode.number} ({drive.mode.name}), in which motors reach their "
                    "references at once: MuJoCo has no such motor",
                    key=f"modes.{drive.joint}",
                    hint="Take mode 5 or 6: --set modes=6",
                    code="export-mode",
                )
            count = drive.actuator.motors
            deflections = positions[:count] - run["link_position"][:, j]
            reach = max(MARGIN * float(np.abs(deflections).max()), LEAST_REACH)
            splines[drive.joint] = springs_of(
                drive, reach, np.nan_to_num(positions[count:, 0]), knots, curved=constructs.curved_springs
            )
            moving = drive.actuator.adjuster and float(np.ptp(positions[count])) > STILL
            add_motors(spec, drive, () if moving else splines[drive.joint], delay_of(stepped), constructs)
            if moving and not constructs.stiffness_controls:
                raise ScenarioError(
                    f"the stiffness of joint '{drive.joint}' would be the control of a tendon, which "
                    f"{program.title} does not simulate correctly",
                    key=drive.joint,
                    code="export-construct",
                )
            if moving:
                add_adjustable_spring(spec, drive)
        elif drive is not None:
            # In modes 0 and 1, a torque or a PID controller acts on the link itself.
            names = ("proportional", "integral", "derivative")
            gains = tuple(drive.values[f"controller_1_{name}"] for name in names) if drive.mode.controller else ()
            most = stepped.joint.most_effort
            motor = add_servo(spec, drive.joint, gains, constructs, inertia=1.0, limit=most, fastest=math.inf)
            set_delay(spec, motor, delay_of(stepped))
        for text in _lacks(prepared, stepped, splines.get(stepped.name, ()), positions, speeds):
            lacks.setdefault(text, []).append(stepped.name)
    remarks += [f"{listed(dict.fromkeys(joints), MOST_NAMES)}: {text}" for text, joints in lacks.items()]
    imperfections = (*scenario.command_imperfections.values(), *scenario.sensor_imperfections.values())
    shifted = [link.name for link in robot.links if link.gravity and link.weightless_mass not in (0.0, link.mass)]
    if shifted:
        remarks.append(
            f"{listed(shifted, MOST_NAMES)}: gravity acts on a part of the body; in the file, a reduced gravity acts on the "
            "whole body"
        )
    if scenario.wrenches:
        remarks.append("the scenario's forces on links are neither in the model nor in the replay")
    if any(replace(one, delay=0.0).active for one in imperfections):
        remarks.append("noise, sampling and steps of commands and sensors are not in the model")
    if any(one.delay for one in scenario.sensor_imperfections.values()):
        remarks.append("delays of sensors are not in the model")
    for mesh in spec.meshes:
        # MuJoCo accepts a mesh of any triangles only as a shell. The inertia of the mesh is not used, since each body states
        # its inertia.
        mesh.inertia, mesh.file = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL, mesh_file(mesh.file)
    try:
        model = spec.compile()
    except ValueError as error:
        raise SimulationError(f"MuJoCo cannot load the model: {' '.join(str(error).split())[:300]}") from error
    _add_start(spec, model, prepared)
    return Mjcf(spec=spec, splines=splines, remarks=tuple(remarks))


def _check(prepared: Prepared, program: Program) -> None:
    """Raise ScenarioError if the scenario has parts that the program does not simulate correctly."""
    problems = [
        Problem(f"joint '{stepped.name}': {program.title} does not simulate the {part} correctly", code="export-construct")
        for stepped in prepared.drives
        for part in refused(stepped, program.constructs)
    ]
    if not program.constructs.contacts and not prepared.scenario.world.empty:
        message = f"{program.title} does not simulate the contacts of ground and objects correctly"
        problems.append(Problem(message, code="export-construct"))
    if problems:
        raise ScenarioError(problems)


def _describe(spec: Any, body: Any, link: Link) -> None:
    """Add the name, inertia and visuals of a link to the link's body in the model."""
    # MuJoCo reserves the body name "world".
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


def _add_start(spec: Any, model: Any, prepared: Prepared) -> None:
    """Add the initial state of the scenario to the model as a keyframe. model: the compiled model, as MjModel."""
    positions, velocities = model.qpos0.copy(), np.zeros(model.nv)
    for name, position, velocity in starts_of(prepared):
        joint = model.joint(name)
        positions[joint.qposadr], velocities[joint.dofadr] = position, velocity
    spec.add_key(name="start", qpos=positions, qvel=velocities)


# -- parts that the model lacks ---------------------------------------------------------------------------------------


def _lacks(
    prepared: Prepared, stepped: SteppedJoint, springs: Sequence[Spline], positions: Array, speeds: Array
) -> Iterator[str]:
    """Sentences about the parts of a joint that the model lacks. positions, speeds: positions and speeds (motors, n) of the
    joint's motors in the run."""
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
    yield from (f"{STAGES.get(name).title.lower()}: left out" for name in drive.stages if name not in STAGES_OF_MUJOCO)
    lacks = LACKS if drive.mode.command not in ("voltage", "current") else LACKS | DIRECT_LACKS
    for name, value in drive.values.items():
        used = drive.mode.controller if name.startswith("controller") else drive.mode.spring
        if used and value and math.isfinite(value):
            yield from (text for end, text in lacks.items() if name.endswith(end))
    if drive.mode.spring and drive.actuator.adjuster:
        place, unit = positions[drive.actuator.motors], drive.actuator.reference_2_unit
        if float(np.ptp(place)) > STILL:
            yield "its spring is linear; its stiffness is the control whose name ends in 'stiffness'"
        else:
            yield f"its adjuster stays at {place[0]:g} {unit}"
