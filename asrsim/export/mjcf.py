"""A scenario's robot as MJCF: motors are bodies with armature, springs are tendons with polynomial stiffness."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
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
from asrsim.robot.model import Joint, Link, Robot, Shape
from asrsim.robot.poses import quaternion, roll_pitch_yaw
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.prepared import Prepared

TINY = "1e-9"
"""kg, kg m^2: MuJoCo wants some mass in every moving body; a motor's inertia is its joint's armature."""
HARD: Mapping[str, str] = {"solreffriction": "0.004 1", "solimpfriction": "0.99 0.999 0.01"}
"""Friction that holds nearly as Coulomb's does."""
STOP: Mapping[str, str] = {"solreflimit": "0.004 1", "solimplimit": "0.99 0.999 0.001"}
"""Stops that give way by little."""
MANY = 6
"""Joints that are counted instead of named."""
GROUPS = {"visuals": "2", "collisions": "3"}
"""MuJoCo's group of the geoms: viewers show the first three."""


@dataclass(frozen=True, kw_only=True)
class Mjcf:
    """A model in MJCF, and what stands beside it."""

    text: str
    meshes: Mapping[str, str]
    """Name of a mesh in the file -> path of the file that it is made of."""
    splines: Mapping[str, tuple[Spline, ...]]
    """Joint -> its springs."""
    remarks: tuple[str, ...]
    """What of the scenario the file does not have."""


def model_of(
    prepared: Prepared, *, reach: Mapping[str, float], adjusters: Mapping[str, float], knots: int = 4,
    timestep: float | None = None, folder: str = "meshes",
) -> Mjcf:  # fmt: skip
    """The model of a scenario.

    reach: joint -> rad, largest deflection for which its springs are fitted; adjusters: joint -> position of its adjuster,
    which stays there; knots: on each side of a spring's spline; timestep: s, None: the scenario's; folder: of the
    meshes, beside the file. Raises ScenarioError for what MJCF cannot have at all.
    """
    _refuse(prepared)
    scenario = prepared.scenario
    shaped, warnings = usable_shapes(merge_fixed(prepared.robot).robot, visuals=True, package_paths=scenario.package_paths)
    merged = replace(merge_fixed(prepared.robot), robot=shaped)
    remarks = _meshless(warnings)
    root = etree.Element("mujoco", model=prepared.robot.name)
    root.append(etree.Comment(" Made by asrsim export. Controls are the motors' own: position, torque, voltage or current. "))
    # boundmass: bodies of motors have no other.
    etree.SubElement(
        root, "compiler", angle="radian", inertiafromgeom="false", boundmass=TINY, boundinertia=TINY, meshdir=folder,
        autolimits="true",
    )  # fmt: skip
    etree.SubElement(
        root, "option", timestep=_text(timestep or scenario.step), integrator="implicitfast", gravity=_text(*scenario.gravity)
    )
    assets, world = etree.SubElement(root, "asset"), etree.SubElement(root, "worldbody")
    meshes = _Meshes(assets)
    drives = {drive.name: drive for drive in prepared.drives}
    _bodies(world, scenario, merged, drives, meshes)
    tendons, actuators = etree.SubElement(root, "tendon"), etree.SubElement(root, "actuator")
    splines: dict[str, tuple[Spline, ...]] = {}
    for drive in prepared.drives:
        if drive.drive is None:
            continue
        if drive.drive.mode.spring:
            found = springs_of(drive.drive, reach.get(drive.name, math.inf), adjusters.get(drive.name, 0.0), knots)
            splines[drive.name] = found
            _motors(world, tendons, actuators, drive.drive, found)
        else:
            _direct(actuators, drive)
    remarks += _unsaid(prepared, splines, adjusters)
    _keyframe(root, prepared)
    for part in (assets, tendons, actuators):
        if not len(part):
            root.remove(part)
    etree.indent(root, "  ")
    text = etree.tostring(root, encoding="unicode") + "\n"
    return Mjcf(text=text, meshes=meshes.files, splines=splines, remarks=tuple(remarks))


def _meshless(warnings: Sequence[Problem]) -> list[str]:
    """What of the robot's shapes is not in the file."""
    if not warnings:
        return []
    return (
        [f"{len(warnings)} groups of shapes are left out; the first: {warnings[0]}"]
        if len(warnings) > 1
        else [str(warnings[0])]
    )


def _refuse(prepared: Prepared) -> None:
    problems = [
        Problem(
            f"joint '{drive.name}' is in mode {drive.mode.number} ({drive.mode.name}), in which motors stand at their "
            "references at once: no motor of MuJoCo does",
            key=f"modes.{drive.name}", hint="Take mode 5 or 6: --set modes=6", code="export-mode",
        )
        for drive in prepared.drives
        if drive.mode is not None and drive.mode.spring and not drive.mode.motor
    ]  # fmt: skip
    if problems:
        raise ScenarioError(problems)


def motor_name(joint: str, index: int) -> str:
    """Of the body, joint and actuator of a motor (1, 2, ...)."""
    return f"{joint}/motor_{index}"


# -- bodies ----------------------------------------------------------------------------------------------------------


class _Meshes:
    """The meshes of the file, each once."""

    def __init__(self, assets: Any) -> None:
        self._assets = assets
        self._names: dict[tuple[str, tuple[float, ...]], str] = {}
        self.files: dict[str, str] = {}

    def name_of(self, shape: Shape) -> str:
        """Name of a shape's mesh in the file."""
        key = shape.mesh, tuple(shape.scale)
        if key not in self._names:
            name = self._names[key] = f"mesh_{len(self._names)}"
            self.files[name] = shape.mesh
            # A shell has an inertia whatever its triangles are; the bodies' own count.
            etree.SubElement(self._assets, "mesh", name=name, file=f"{name}.stl", scale=_text(*shape.scale), inertia="shell")
        return self._names[key]


def _bodies(world: Any, scenario: Any, merged: MergedRobot, drives: Mapping[str, SteppedJoint], meshes: _Meshes) -> None:
    robot = merged.robot
    links = {link.name: link for link in robot.links}
    root = etree.SubElement(
        world, "body", name=_root_name(robot), pos=_text(*scenario.base_position), quat=_quat(scenario.base_rpy)
    )
    if not scenario.fixed_base:
        etree.SubElement(root, "freejoint", name=f"{robot.root.name}/free")
    waiting = [(root, robot.root.name)]
    while waiting:
        body, name = waiting.pop()
        link = links[name]
        _inertial(body, link)
        for shape in (*link.visuals, *link.collisions):
            _geom(body, shape, meshes, "visuals" if shape in link.visuals else "collisions")
        for other, place in merged.places.items():
            if place.body == name and other != name:
                pose = place.pose
                rpy = roll_pitch_yaw(pose.rotation)
                etree.SubElement(body, "site", name=other, pos=_text(*pose.position), quat=_quat(rpy), size="0.005", group="4")
        for joint in robot.carried.get(name, ()):
            child = etree.SubElement(body, "body", name=joint.child, pos=_text(*joint.origin), quat=_quat(joint.rpy))
            _joint(child, joint, drives[joint.name])
            waiting.append((child, joint.child))


def _root_name(robot: Robot) -> str:
    """Of the root's body: the world of MuJoCo is called "world" itself."""
    return robot.root.name if robot.root.name != "world" else "world_link"


def _inertial(body: Any, link: Link) -> None:
    if link.mass or link.inertia is not None:
        moments, rpy = principal_axes(link)
        etree.SubElement(
            body, "inertial", pos=_text(*link.centre_of_mass), quat=_quat(rpy), mass=_text(link.mass or 0.0),
            diaginertia=_text(*moments),
        )  # fmt: skip


def _geom(body: Any, shape: Shape, meshes: _Meshes, kind: str) -> None:
    sizes: Sequence[float] = shape.size
    if shape.kind == "box":
        sizes = [0.5 * edge for edge in shape.size]
    elif shape.kind in ("cylinder", "capsule"):
        sizes = [shape.size[0], 0.5 * shape.size[1]]
    form = {"mesh": meshes.name_of(shape)} if shape.kind == "mesh" else {"size": _text(*sizes)}
    colour = {"rgba": _text(*shape.colour)} if shape.colour else {}
    # The robot meets the world and not itself, as in asrsim.
    etree.SubElement(
        body, "geom", type=shape.kind, pos=_text(*shape.origin), quat=_quat(shape.rpy), group=GROUPS[kind], contype="0",
        conaffinity="1" if kind == "collisions" else "0", **form, **colour,
    )  # fmt: skip


def _joint(body: Any, joint: Joint, drive: SteppedJoint) -> None:
    kind = "slide" if joint.kind == "prismatic" else "hinge"
    element = etree.SubElement(body, "joint", name=joint.name, type=kind, axis=_text(*joint.axis))
    _limit(element, *joint.stops)
    _friction(element, drive.constant_damping, joint.friction)
    if joint.spring_stiffness:
        element.set("stiffness", _text(joint.spring_stiffness))
        element.set("springref", _text(joint.spring_reference))


def _limit(element: Any, low: float, high: float) -> None:
    if math.isinf(low) and math.isinf(high):
        return
    element.set("range", _text(*(min(max(end, -1e6), 1e6) for end in (low, high))))
    element.attrib.update(STOP)


def _friction(element: Any, damping: float, friction: float) -> None:
    if damping:
        element.set("damping", _text(damping))
    if friction:
        element.set("frictionloss", _text(friction))
        element.attrib.update(HARD)


# -- motors, springs, controllers ------------------------------------------------------------------------------------


def springs_of(drive: Drive, reach: float, adjuster: float, knots: int) -> tuple[Spline, ...]:
    """The spring of each motor. Raises ScenarioError for a law that is no function of each motor's deflection alone."""
    actuator, count = drive.actuator, drive.actuator.motors
    tail = [adjuster] if actuator.adjuster else [0.0] * (actuator.positions() - count)

    def torques(q: float, thetas: Sequence[float]) -> Sequence[float]:
        law: Any = actuator.elastic_torques
        return tuple(law(q, *thetas, *tail, drive.elastic))

    generator = np.random.default_rng(0)
    span = min(reach, 1.0)
    for _ in range(16):
        q, *thetas = generator.uniform(-0.5 * span, 0.5 * span, count + 1).tolist()
        whole = torques(q, thetas)[:count]
        alone = [torques(0.0, [thetas[i] - q if j == i else 0.0 for j in range(count)])[i] for i in range(count)]
        if not np.allclose(whole, alone, rtol=1e-6, atol=1e-9):
            raise ScenarioError(
                f"the springs of '{actuator.name}' on joint '{drive.joint}' are no functions of each motor's deflection alone, "
                "as springs of MuJoCo are",
                key=drive.joint, code="export-law",
            )  # fmt: skip

    def law_of(i: int) -> Spline:
        def law(deflection: float) -> float:
            return float(torques(0.0, [deflection if j == i else 0.0 for j in range(count)])[i])

        return spline_of(law, reach=reach, limit=drive.max_deflection, knots=knots)

    return tuple(law_of(i) for i in range(count))


def _motors(world: Any, tendons: Any, actuators: Any, drive: Drive, splines: Sequence[Spline]) -> None:
    for i, spline in enumerate(splines, start=1):
        name = motor_name(drive.joint, i)
        body = etree.SubElement(world, "body", name=name)
        joint = etree.SubElement(body, "joint", name=name, axis="0 0 1", armature=_text(drive.motor_inertia[i - 1]))
        _limit(joint, *drive.motor_ranges[i - 1])
        _friction(joint, drive.values[f"motor_{i}_damping"], drive.motor_friction[i - 1])
        for number, piece in enumerate(spline.pieces, start=1):
            spring = etree.SubElement(
                tendons, "fixed", name=f"{drive.joint}/spring_{i}/{number}", stiffness=_text(*piece.stiffness),
                springlength=_text(piece.low, piece.high),
            )  # fmt: skip
            etree.SubElement(spring, "joint", joint=name, coef="1")
            etree.SubElement(spring, "joint", joint=drive.joint, coef="-1")
        electric, most = drive.electric[i - 1], drive.max_torque[i - 1]
        if drive.mode.controller:
            gain, brake = drive.proportional[i - 1], drive.derivative[i - 1] + electric.lag
        else:
            gain, brake = electric.gain, electric.lag
        hold = gain if drive.mode.controller else 0.0
        _actuator(actuators, name, name, gain, hold, brake, most)


def _direct(actuators: Any, stepped: SteppedJoint) -> None:
    """Modes 0 and 1: torque or PID on the link itself."""
    drive = stepped.drive
    assert drive is not None
    gain, brake = 1.0, 0.0
    if drive.mode.controller:
        gain, brake = drive.values["controller_1_proportional"], drive.values["controller_1_derivative"]
    _actuator(
        actuators, drive.joint, drive.joint, gain, gain if drive.mode.controller else 0.0, brake, stepped.joint.most_effort
    )


def _actuator(parent: Any, name: str, joint: str, gain: float, hold: float, brake: float, most: float) -> None:
    limit = {} if math.isinf(most) else {"forcerange": _text(-most, most)}
    etree.SubElement(
        parent, "general", name=name, joint=joint, gainprm=_text(gain), biastype="affine", biasprm=_text(0.0, -hold, -brake),
        **limit,
    )  # fmt: skip


def _keyframe(root: Any, prepared: Prepared) -> None:
    """The start of the scenario, under which MuJoCo's data are to be set."""
    scenario = prepared.scenario
    starts = {drive.name: drive.motor_starts(drive.dynamic_motors) for drive in prepared.drives}
    links = dict(
        zip(
            (d.name for d in prepared.drives),
            zip(prepared.initial_positions, prepared.initial_velocities, strict=True),
            strict=True,
        )
    )
    positions: list[float] = []
    velocities: list[float] = []
    if not scenario.fixed_base:
        x, y, z, w = quaternion(scenario.base_rpy)
        positions, velocities = [*scenario.base_position, w, x, y, z], [0.0] * 6
    for joint in root.find("worldbody").iter("joint"):
        owner, _, motor = joint.get("name").rpartition("/motor_")
        at, speed = starts[owner][int(motor) - 1][:2] if owner else links[joint.get("name")]
        positions.append(at)
        velocities.append(speed)
    frame = etree.SubElement(root, "keyframe")
    etree.SubElement(frame, "key", name="start", qpos=_text(*positions), qvel=_text(*velocities))


# -- what the file does not say --------------------------------------------------------------------------------------


def _unsaid(prepared: Prepared, splines: Mapping[str, Sequence[Spline]], adjusters: Mapping[str, float]) -> Iterator[str]:
    """Sentences about what of the scenario the file does not have."""
    scenario = prepared.scenario
    found: dict[str, list[str]] = {}
    for drive in prepared.drives:
        for text in (*_unsaid_of_link(prepared, drive, splines.get(drive.name, ())), *_unsaid_of_motors(drive, adjusters)):
            found.setdefault(text, []).append(drive.name)
    for text, joints in found.items():
        yield f"{', '.join(joints) if len(joints) < MANY else f'{len(joints)} joints'}: {text}"
    if not scenario.world.empty:
        yield "the ground and the objects of the scenario's world are not in the file"
    if scenario.wrenches:
        yield "the scenario's forces on links are not in the file, nor in the replay"
    if any(effects.active for effects in (*scenario.command_effects.values(), *scenario.sensor_effects.values())):
        yield "delays, noise and steps of commands and sensors are not in the file"


def _unsaid_of_link(prepared: Prepared, drive: SteppedJoint, springs: Sequence[Spline]) -> Iterator[str]:
    joint, damping = drive.joint, drive.link_damping
    if joint.friction_varies:
        yield "its friction is constant: the parts that follow speed or load are left out"
    if damping is not None and damping.ratio:
        yield "its damping is constant: the part that follows the stiffness is left out"
    if prepared.velocity_cutoff and joint.velocity is not None:
        yield "its velocity limit does not cut off the torque"
    most = sum(float(np.abs(one.torque(np.array([-one.reach, one.reach]))).max()) for one in springs)
    if most > joint.most_effort:
        yield f"its effort limit of {joint.most_effort:g} does not hold back the springs, which reach {most:.3g}"
    for one in springs[:1]:
        if not one.saturates:
            yield f"beyond a deflection of {one.reach:.3g} rad its spring goes on as the last cubic"


def _unsaid_of_motors(stepped: SteppedJoint, adjusters: Mapping[str, float]) -> Iterator[str]:
    drive = stepped.drive
    if drive is None:
        return
    if drive.actuator.adjuster and drive.mode.spring:
        yield f"its adjuster stays at {adjusters.get(drive.joint, 0.0):g} {drive.actuator.reference_2_unit}"
    if drive.hysteresis is not None:
        yield "its springs have no hysteresis"
    if any(drive.integral) or (drive.mode.number == 1 and drive.values["controller_1_integral"]):
        yield "its controllers have no integral action"
    if drive.mode.number == 1:
        return
    if any(math.isfinite(speed) for speed in drive.max_velocity):
        yield f"its motors have no speed limit (here {min(drive.max_velocity):g} rad/s)"
    if any(drive.motor_friction):
        yield "friction of its motors holds without bristles: no pre-sliding"
    motors = range(1, drive.dynamic_motors + 1)
    if any(drive.values[f"motor_{i}_{name}"] for i in motors for name in ("stribeck_friction", "load_friction")):
        yield "friction of its motors is constant: the parts that follow speed or load are left out"
    if any(math.isfinite(one.stall) for one in drive.electric) and drive.mode.motor:
        yield "the voltage limit of its motors is a limit of their torque at rest"


def _text(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)


def _quat(rpy: Any) -> str:
    x, y, z, w = quaternion(rpy)
    return _text(w, x, y, z)


__all__ = ["Mjcf", "Robot", "model_of", "motor_name", "springs_of"]
