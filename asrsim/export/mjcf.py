"""A scenario's robot as MJCF: motors are bodies with armature, springs are tendons with polynomial stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from lxml import etree

from asrsim.actuators.drive import Drive
from asrsim.errors import Problem, ScenarioError
from asrsim.export.springs import Spline, spline_of
from asrsim.robot.engine_text import usable_shapes
from asrsim.robot.inertia import principal_axes
from asrsim.robot.merge import MergedRobot, merge_fixed
from asrsim.robot.model import Link, Shape
from asrsim.robot.poses import quaternion, roll_pitch_yaw
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.prepared import Prepared

TINY = "1e-9"
"""Mass (kg) and moments of inertia (kg m^2) of motor bodies: MuJoCo rejects bodies without mass. The real inertia of a motor is
the armature of its joint.
"""
HARD: Mapping[str, str] = {"solreffriction": "0.004 1", "solimpfriction": "0.99 0.999 0.01"}
"""Solver parameters with which friction is nearly Coulomb friction."""
STOP: Mapping[str, str] = {"solreflimit": "0.004 1", "solimplimit": "0.99 0.999 0.001"}
"""Solver parameters of stiff joint stops."""
MANY = 6
"""A remark on at least this number of joints gives their number instead of their names."""
GROUPS = {"visuals": "2", "collisions": "3"}
"""Groups of the model's geoms; viewers of MuJoCo show the groups 0 to 2."""


@dataclass(frozen=True, kw_only=True)
class Mjcf:
    """A model in MJCF, and the data for the files that accompany the model."""

    text: str
    meshes: Mapping[str, str]
    """Paths of the source files of meshes, by name of the mesh in the model."""
    splines: Mapping[str, tuple[Spline, ...]]
    """Splines of the springs, by joint."""
    remarks: tuple[str, ...]
    """Sentences about parts of the scenario that the model lacks."""


def model_of(
    prepared: Prepared, *, reach: Mapping[str, float], adjusters: Mapping[str, float], knots: int | None = None,
    timestep: float | None = None, folder: str = "meshes",
) -> Mjcf:  # fmt: skip
    """Model of a scenario.

    Args:
        prepared: The scenario.
        reach: Largest deflection for which the springs are fitted, rad, by joint.
        adjusters: Constant position of the adjuster, by joint.
        knots: Number of knots on each side of the splines; None: as many as the laws need.
        timestep: Time step of the model, s; None: the scenario's step.
        folder: Name of the folder of the meshes.

    Raises:
        ScenarioError: A mode or a spring law that MJCF cannot represent.
    """
    _refuse(prepared)
    scenario, merged = prepared.scenario, merge_fixed(prepared.robot)
    shaped, warnings = usable_shapes(merged.robot, visuals=True, package_paths=scenario.package_paths)
    root = etree.Element("mujoco", model=prepared.robot.name)
    root.append(etree.Comment(" Made by asrsim export. Controls are the motors' own: position, torque, voltage or current. "))
    # The option boundmass gives the motor bodies their mass.
    _add(root, "compiler", angle="radian", inertiafromgeom="false", boundmass=TINY, boundinertia=TINY, meshdir=folder,
         autolimits="true")  # fmt: skip
    _add(root, "option", timestep=timestep or scenario.step, integrator="implicitfast", gravity=scenario.gravity)
    assets, world = _add(root, "asset"), _add(root, "worldbody")
    meshes: dict[tuple[str, tuple[float, ...]], str] = {}
    _bodies(world, assets, prepared, replace(merged, robot=shaped), meshes)
    tendons, actuators = _add(root, "tendon"), _add(root, "actuator")
    splines: dict[str, tuple[Spline, ...]] = {}
    for stepped in prepared.drives:
        if (drive := stepped.drive) is not None and drive.mode.spring:
            springs = springs_of(drive, reach.get(drive.joint, math.inf), adjusters.get(drive.joint, 0.0), knots)
            splines[drive.joint] = springs
            _motors(world, tendons, actuators, drive, springs)
        elif drive is not None:
            # Modes 0 and 1: torque or PID controller on the link itself.
            gains = [
                drive.values[f"controller_1_{name}"] if drive.mode.controller else None
                for name in ("proportional", "derivative")
            ]
            _actuator(actuators, drive.joint, gains[0], gains[1] or 0.0, stepped.joint.most_effort)
    remarks = [str(warnings[0])] if warnings else []
    if len(warnings) > 1:
        remarks = [f"{len(warnings)} groups of shapes are left out; the first: {warnings[0]}"]
    _keyframe(root, prepared)
    for part in (assets, tendons, actuators):
        if not len(part):
            root.remove(part)
    etree.indent(root, "  ")
    return Mjcf(
        text=etree.tostring(root, encoding="unicode") + "\n", meshes={name: mesh for (mesh, _), name in meshes.items()},
        splines=splines, remarks=(*remarks, *_omissions(prepared, splines, adjusters)),
    )  # fmt: skip


def _refuse(prepared: Prepared) -> None:
    problems = [
        Problem(
            f"joint '{drive.name}' is in mode {drive.mode.number} ({drive.mode.name}), in which motors reach their references "
            "at once: MuJoCo has no such motor",
            key=f"modes.{drive.name}", hint="Take mode 5 or 6: --set modes=6", code="export-mode",
        )
        for drive in prepared.drives
        if drive.mode is not None and drive.mode.spring and not drive.mode.motor
    ]  # fmt: skip
    if problems:
        raise ScenarioError(problems)


def motor_name(joint: str, index: int) -> str:
    """Common name of a motor's body, joint and actuator in the model; index: number of the motor, from 1."""
    return f"{joint}/motor_{index}"


def _add(parent: Any, tag: str, **attributes: Any) -> Any:
    """Add a child element to an XML element; numbers are written with all digits, and attributes that are None are left out."""
    texts = {}
    for name, value in attributes.items():
        if value is not None:
            numbers = value if isinstance(value, Sequence | np.ndarray) else [value]
            texts[name] = value if isinstance(value, str) else " ".join(repr(float(number)) for number in numbers)
    return etree.SubElement(parent, tag, texts)


# -- bodies ----------------------------------------------------------------------------------------------------------


def _bodies(world: Any, assets: Any, prepared: Prepared, merged: MergedRobot, meshes: dict[Any, str]) -> None:
    scenario, robot = prepared.scenario, merged.robot
    links, drives = {link.name: link for link in robot.links}, {drive.name: drive for drive in prepared.drives}
    # MuJoCo reserves the name "world".
    name = robot.root.name if robot.root.name != "world" else "world_link"
    root = _add(world, "body", name=name, pos=scenario.base_position, quat=_quat(scenario.base_rpy))
    if not scenario.fixed_base:
        _add(root, "freejoint", name=f"{robot.root.name}/free")
    waiting = [(root, robot.root.name)]
    while waiting:
        body, name = waiting.pop()
        link = links[name]
        if link.mass or link.inertia is not None:
            moments, rpy = principal_axes(link)
            _add(body, "inertial", pos=link.centre_of_mass, quat=_quat(rpy), mass=link.mass or 0.0, diaginertia=moments)
        _geoms(body, assets, link, meshes)
        for other, place in merged.places.items():
            if place.body == name and other != name:
                turn = _quat(roll_pitch_yaw(place.pose.rotation))
                _add(body, "site", name=other, pos=place.pose.position, quat=turn, size="0.005", group="4")
        for joint in robot.carried.get(name, ()):
            child = _add(body, "body", name=joint.child, pos=joint.origin, quat=_quat(joint.rpy))
            spring = joint.spring_stiffness or None
            _add(child, "joint", name=joint.name, type="slide" if joint.kind == "prismatic" else "hinge", axis=joint.axis,
                 stiffness=spring, springref=joint.spring_reference if spring else None, **_limits(*joint.stops),
                 **_friction(drives[joint.name].constant_damping, joint.friction))  # fmt: skip
            waiting.append((child, joint.child))


def _geoms(body: Any, assets: Any, link: Link, meshes: dict[Any, str]) -> None:
    for kind, shapes in (("visuals", link.visuals), ("collisions", link.collisions)):
        for shape in shapes:
            form: dict[str, Any] = {"size": _size(shape)}
            if shape.kind == "mesh":
                key = shape.mesh, tuple(shape.scale)
                if key not in meshes:
                    meshes[key] = f"mesh_{len(meshes)}"
                    # MuJoCo accepts any triangles for a shell; its inertia is not used, since bodies have explicit inertia.
                    _add(assets, "mesh", name=meshes[key], file=f"{meshes[key]}.stl", scale=shape.scale, inertia="shell")
                form = {"mesh": meshes[key]}
            # The robot collides with the world and not with itself, as in asrsim.
            _add(body, "geom", type=shape.kind, pos=shape.origin, quat=_quat(shape.rpy), group=GROUPS[kind], contype="0",
                 conaffinity="1" if kind == "collisions" else "0", rgba=shape.colour or None, **form)  # fmt: skip


def _size(shape: Shape) -> Sequence[float]:
    if shape.kind == "box":
        return [0.5 * edge for edge in shape.size]
    return [shape.size[0], 0.5 * shape.size[1]] if shape.kind in ("cylinder", "capsule") else shape.size


def _limits(low: float, high: float) -> dict[str, Any]:
    if math.isinf(low) and math.isinf(high):
        return {}
    return {"range": [min(max(end, -1e6), 1e6) for end in (low, high)], **STOP}


def _friction(damping: float, friction: float) -> dict[str, Any]:
    return {"damping": damping or None, **({"frictionloss": friction, **HARD} if friction else {})}


# -- motors, springs, controllers ------------------------------------------------------------------------------------


def springs_of(drive: Drive, reach: float, adjuster: float, knots: int | None = None) -> tuple[Spline, ...]:
    """Splines of the springs of a drive, one for each motor. Raises ScenarioError for a law that depends on more than each
    motor's own deflection.
    """
    actuator, count = drive.actuator, drive.actuator.motors
    tail = [adjuster] if actuator.adjuster else [0.0] * (actuator.positions() - count)

    def torques(q: float, thetas: Sequence[float]) -> Sequence[float]:
        law: Any = actuator.elastic_torques
        return tuple(law(q, *thetas, *tail, drive.elastic))

    def of_deflection(i: int, deflection: float) -> float:
        return float(torques(0.0, [deflection if j == i else 0.0 for j in range(count)])[i])

    generator = np.random.default_rng(0)
    span = min(reach, 1.0)
    for _ in range(16):
        q, *thetas = generator.uniform(-0.5 * span, 0.5 * span, count + 1).tolist()
        alone = [of_deflection(i, thetas[i] - q) for i in range(count)]
        if not np.allclose(torques(q, thetas)[:count], alone, rtol=1e-6, atol=1e-9):
            raise ScenarioError(
                f"the springs of '{actuator.name}' on joint '{drive.joint}' depend on more than each motor's own deflection; "
                "springs of MuJoCo cannot",
                key=drive.joint, code="export-law",
            )  # fmt: skip

    def law_of(i: int) -> Callable[[float], float]:
        return lambda deflection: of_deflection(i, deflection)

    limit = drive.max_deflection
    return tuple(spline_of(law_of(i), reach=reach, limit=limit, knots=knots) for i in range(count))


def _motors(world: Any, tendons: Any, actuators: Any, drive: Drive, splines: Sequence[Spline]) -> None:
    for i, spline in enumerate(splines):
        name, electric = motor_name(drive.joint, i + 1), drive.electric[i]
        body = _add(world, "body", name=name)
        friction = _friction(drive.values[f"motor_{i + 1}_damping"], drive.motor_friction[i])
        _add(
            body,
            "joint",
            name=name,
            axis="0 0 1",
            armature=drive.motor_inertia[i],
            **_limits(*drive.motor_ranges[i]),
            **friction,
        )
        for number, piece in enumerate(spline.pieces, start=1):
            spring = _add(tendons, "fixed", name=f"{drive.joint}/spring_{i + 1}/{number}", stiffness=piece.stiffness,
                          springlength=(piece.low, piece.high))  # fmt: skip
            _add(spring, "joint", joint=name, coef="1")
            _add(spring, "joint", joint=drive.joint, coef="-1")
        if drive.mode.controller:
            _actuator(actuators, name, drive.proportional[i], drive.derivative[i] + electric.lag, drive.max_torque[i])
        else:
            _actuator(actuators, name, None, electric.lag, drive.max_torque[i], gain=electric.gain)


def _actuator(
    parent: Any, joint: str, proportional: float | None, damping: float, limit: float, *, gain: float = 1.0
) -> None:  # fmt: skip
    """Add an actuator with a position controller; if `proportional` is None, an actuator that multiplies its
    control by a gain.
    """
    gain, back = (gain, 0.0) if proportional is None else (proportional, proportional)
    _add(parent, "general", name=joint, joint=joint, gainprm=gain, biastype="affine", biasprm=(0.0, -back, -damping),
         forcerange=None if math.isinf(limit) else (-limit, limit))  # fmt: skip


def _keyframe(root: Any, prepared: Prepared) -> None:
    """Add the initial state of the scenario as a keyframe."""
    scenario = prepared.scenario
    motors = {drive.name: drive.motor_starts(drive.dynamic_motors) for drive in prepared.drives}
    starts = zip(prepared.initial_positions, prepared.initial_velocities, strict=True)
    links = dict(zip((drive.name for drive in prepared.drives), starts, strict=True))
    positions: list[float] = []
    velocities: list[float] = []
    if not scenario.fixed_base:
        positions, velocities = [*scenario.base_position, *_quat(scenario.base_rpy)], [0.0] * 6
    for joint in root.find("worldbody").iter("joint"):
        owner, _, motor = joint.get("name").rpartition("/motor_")
        position, velocity = motors[owner][int(motor) - 1][:2] if owner else links[joint.get("name")]
        positions.append(position)
        velocities.append(velocity)
    _add(_add(root, "keyframe"), "key", name="start", qpos=positions, qvel=velocities)


def _quat(rpy: Any) -> list[float]:
    x, y, z, w = quaternion(rpy)
    return [w, x, y, z]


# -- parts that the model lacks ---------------------------------------------------------------------------------------


def _omissions(prepared: Prepared, splines: Mapping[str, Sequence[Spline]], adjusters: Mapping[str, float]) -> Iterator[str]:
    """Sentences about parts of the scenario that the model lacks."""
    scenario = prepared.scenario
    found: dict[str, list[str]] = {}
    for drive in prepared.drives:
        for text, lacks in _checks(prepared, drive, splines.get(drive.name, ()), adjusters).items():
            if lacks:
                found.setdefault(text, []).append(drive.name)
    for text, joints in found.items():
        yield f"{', '.join(joints) if len(joints) < MANY else f'{len(joints)} joints'}: {text}"
    effects = (*scenario.command_effects.values(), *scenario.sensor_effects.values())
    for text, lacks in {
        "the ground and the objects of the scenario's world are not in the model": not scenario.world.empty,
        "the scenario's forces on links are neither in the model nor in the replay": bool(scenario.wrenches),
        "delays, noise and steps of commands and sensors are not in the model": any(effect.active for effect in effects),
    }.items():
        if lacks:
            yield text


def _checks(
    prepared: Prepared, stepped: SteppedJoint, springs: Sequence[Spline], adjusters: Mapping[str, float]
) -> dict[str, bool]:  # fmt: skip
    """Sentences about a joint, and whether each sentence is true."""
    joint, drive, damping = stepped.joint, stepped.drive, stepped.link_damping
    largest = sum(float(np.abs(spring.torque(np.array([-spring.reach, spring.reach]))).max()) for spring in springs)
    checks = {
        "its friction is constant: the parts that depend on speed or load are left out": joint.friction_varies,
        "its damping is constant: the part that depends on the stiffness is left out": bool(damping and damping.ratio),
        "its velocity limit does not cut off the torque": prepared.velocity_cutoff and joint.velocity is not None,
        f"its effort limit of {joint.most_effort:g} does not limit its springs, which reach {largest:.3g}": largest
        > joint.most_effort,
    }
    if springs:
        text = f"beyond a deflection of {springs[0].reach:.3g} rad its spring continues as the last cubic"
        checks[text] = not springs[0].saturates
    if drive is None:
        return checks
    if drive.mode.number == 1:
        return {**checks, "its controller has no integral action": bool(drive.values["controller_1_integral"])}
    motors = range(1, drive.dynamic_motors + 1)
    varying = any(drive.values[f"motor_{i}_{name}"] for i in motors for name in ("stribeck_friction", "load_friction"))
    position = f"{adjusters.get(drive.joint, 0.0):g} {drive.actuator.reference_2_unit}"
    return {
        **checks,
        f"its adjuster stays at {position}": drive.actuator.adjuster and drive.mode.spring,
        "its springs have no hysteresis": drive.hysteresis is not None,
        "its controllers have no integral action": any(drive.integral),
        f"its motors have no speed limit (here {min(drive.max_velocity, default=math.inf):g} rad/s)": any(
            map(math.isfinite, drive.max_velocity)
        ),
        "friction of its motors has no bristles: no pre-sliding": any(drive.motor_friction),
        "friction of its motors is constant: the parts that depend on speed or load are left out": varying,
        "the voltage limit of its motors limits their torque at rest": drive.mode.motor
        and any(math.isfinite(electric.stall) for electric in drive.electric),
    }
