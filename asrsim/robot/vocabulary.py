"""Every word (element or attribute) of a robot file that asrsim knows, and what asrsim does with it.

The table `WORDS` is the only list of these words. A word is read, or has no physics, or acts only where bodies touch, or is
left out. If a word is left out, one warning for the file states what the word would do, with its number. A value that changes
nothing (0, false) gets no warning. To add a word, add it to its parent in `WORDS`; the documentation's page follows.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

from asrsim.robot.model import INERTIAS
from asrsim.robot.numbers import plain_number
from asrsim.robot.xmlfile import elements, name_of, text_of

Use = Literal["read", "no physics", "contacts", "left out"]


class Effect(NamedTuple):
    """Effect of a word that is left out."""

    text: str
    size: float = 0.0
    """Magnitude of the word's number; if a file uses the word several times, the warning shows the largest number."""


ROTOR = ("motorInertia", "motor_inertia", "rotor_inertia", "rotorInertia")
"""Words for the inertia of a motor in a transmission, kg m^2."""
RATIO = ("mechanicalReduction", "mechanical_reduction", "gear_ratio")
"""Words for the ratio of a transmission, in ROS 1, ros2_control and Drake."""

EffectReader = Callable[[Any, str], Effect | None]
"""Function of an element and the text of its value: effect of the word, or None if this value changes nothing."""


@dataclass(frozen=True, kw_only=True)
class Word:
    """Meaning of an element or attribute below one parent."""

    use: Use
    effect: EffectReader | None = None
    """Effect of a word that is left out."""
    doc: str = ""
    """What the word would do, for the documentation."""
    hint: str | None = None
    inside: str | None = None
    """Parent under which the children and attributes of this element stand in `WORDS`; None: they are not examined."""


READ, SILENT, CONTACT = Word(use="read"), Word(use="no physics"), Word(use="contacts", doc="acts in contacts")


def number_of(text: str) -> float | None:
    """Number in the text; None if the text is not a number."""
    try:
        value = plain_number(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def left(message: str, *, neutral: float | None = 0.0, hint: str | None = None) -> Word:
    """Word that is left out. message: warning in which `{}` stands for the value; neutral: number that changes nothing."""

    def effect(_element: Any, text: str) -> Effect | None:
        value = number_of({"true": "1", "false": "0"}.get(text.lower(), text))
        if neutral is not None and value == neutral:
            return None
        return Effect(message.replace("{}", text), abs(value or 0.0))

    return Word(use="left out", effect=effect, doc=message.replace("{}", "..."), hint=hint)


def special(effect: EffectReader, doc: str, *, hint: str | None = None) -> Word:
    """Word that is left out, with a warning whose numbers come from several elements."""
    return Word(use="left out", effect=effect, doc=doc, hint=hint)


def _words(word: Word, names: str) -> dict[str, Word]:
    return dict.fromkeys(names.split(), word)


def _within(*parents: str) -> dict[str, Word]:
    """Elements that are read; their children are listed under a parent with the same name."""
    return {parent: Word(use="read", inside=parent) for parent in parents}


# -- effects with numbers from several elements ------------------------------------------------------------------------


def _soft_limits(tag: Any, _text: str) -> Effect | None:
    limits = elements(tag.getparent(), "limit")
    soft = [number_of(tag.get(f"soft_{side}_limit", "0")) or 0.0 for side in ("lower", "upper")]
    hard = [number_of(limits[0].get(side, "0")) or 0.0 for side in ("lower", "upper")] if limits else soft
    beyond = max(soft[0] - hard[0], hard[1] - soft[1]) if limits else 0.0
    if soft[0] >= soft[1] or (limits and beyond <= 0.0):
        return None
    return Effect(f"soft limits from {soft[0]:g} to {soft[1]:g} are not enforced: the joint moves up to its <limit>", beyond)


def _rotor_inertia(actuator: Any, _text: str) -> Effect | None:
    """Inertia of a motor in a transmission of several joints, as it acts on a joint (motor inertia times the square of the
    reduction). `asrsim.robot.mechanics` reads transmissions of a single joint.
    """
    if len(elements(actuator.getparent(), "joint")) == 1:
        return None
    inertia = _of_actuator(actuator, ROTOR) or 0.0
    ratio = _of_actuator(actuator, RATIO) or 1.0
    at_joint = inertia * ratio**2
    shown = f"rotor inertia of {at_joint:.3g} kg m^2 at the joint ({inertia:g} x {ratio:g}^2) is left out"
    return Effect(shown, at_joint) if at_joint else None


_BASE = "State `base: {rpy: [...]}` in the scenario"
"""Hint for a robot that Gazebo turns."""


def _model_pose(tag: Any, text: str) -> Effect | None:
    """Orientation of the whole robot in Gazebo.

    A position has no effect on the motion. A `<gazebo>` with a reference places only a part of a link.
    """
    angles = [number_of(part) or 0.0 for part in text.split()[3:6]]
    if tag.getparent().get("reference") or not any(angles):
        return None
    shown = ", ".join(f"{angle:g}" for angle in angles)
    message = (
        f"Gazebo turns the robot by rpy [{shown}]; in asrsim the robot keeps its orientation, so gravity acts in another "
        "direction"
    )
    return Effect(message, max(map(abs, angles)))


def _of_actuator(actuator: Any, names: Collection[str]) -> float | None:
    """Number in a child of an `<actuator>` or its `<transmission>` with one of the names, in any name space."""
    for tag in (*elements(actuator), *elements(actuator.getparent())):
        if tag.tag.rpartition("}")[2] in names:
            return number_of(tag.get("value") or text_of(tag))
    return None


def _spring(tag: Any, text: str) -> Effect | None:
    stiffness = number_of(text)
    return Effect(f"a spring of {text} N m/rad (N/m) is left out", abs(stiffness)) if stiffness else None


def _traits(tag: Any, _text: str) -> Effect | None:
    return _spring(tag, tag.get("spring_k", ""))


def _from_shapes(_compiler: Any, text: str) -> Effect | None:
    return Effect("MuJoCo computes masses from shapes; asrsim uses the masses in the file") if text == "true" else None


def _mimic_plugin(plugin: Any, _text: str) -> Effect | None:
    """Effect of a mimic plugin whose words `asrsim.robot.mechanics` does not read."""
    if {"joint", "mimicJoint"} <= {tag.tag for tag in elements(plugin)}:
        return None
    return Effect("the plugin couples joints; in asrsim they move freely")


def _joint_of(tag: Any) -> Any:
    """The robot's joint that a joint of ros2_control, or an element in it, is about; None if the robot has no such joint."""
    control = tag if tag.tag == "joint" else tag.getparent()
    joints = elements(control.getroottree().getroot(), "joint")
    return next((joint for joint in joints if name_of(joint) == name_of(control)), None)


def _coupling(tag: Any, text: str) -> Effect | None:
    """Effect of a contradiction between ros2_control and the joint about whether the joint follows another joint."""
    joint, said = _joint_of(tag), text.lower()
    if joint is None or (tag.tag == "param" and name_of(tag) != "mimic"):
        return None
    coupled = bool(elements(joint, "mimic"))
    if said in ("false", "0") and coupled:
        return Effect("ros2_control does not couple this joint; in asrsim it follows another joint because of its <mimic>")
    if said in ("true", "1") and not coupled:
        return Effect("ros2_control couples this joint, but its <joint> has no <mimic>; in asrsim it moves freely")
    return None


def _command_range(interface: Any, _text: str) -> Effect | None:
    """Range of a command in ros2_control that is narrower than the joint's limits."""
    joint, kind = _joint_of(interface), name_of(interface)
    given = {name_of(tag): number_of(text_of(tag)) for tag in elements(interface, "param")}
    low, high = given.get("min"), given.get("max")
    least, most = _range_of(joint, kind)
    beyond = max(0.0 if low is None else low - least, 0.0 if high is None else most - high)
    if beyond <= 1e-6:
        return None
    shown = " to ".join("..." if one is None else f"{one:g}" for one in (low, high))
    return Effect(f"commands of the {kind} are not limited to {shown}: the joint's <limit> alone acts in asrsim", beyond)


def _range_of(joint: Any, kind: str) -> tuple[float, float]:
    """Range of a joint's `position`, `velocity` or `effort`. A quantity without limits in the file has an empty range, which
    lies within every other range.
    """
    nothing = math.inf, -math.inf
    if joint is None or kind not in ("position", "velocity", "effort"):
        return nothing
    if kind == "position" and joint.get("type") == "continuous":
        return -math.inf, math.inf
    limit = next(iter(elements(joint, "limit")), None)
    if limit is None:
        return nothing
    low, high, most = (number_of(limit.get(name, "0")) or 0.0 for name in ("lower", "upper", kind))
    return (low, high) if kind == "position" else (-most, most)


def _limits_off(tag: Any, _text: str) -> Effect | None:
    if tag.get("enable", "true").lower() in ("true", "1"):
        return None
    return Effect("ros2_control does not enforce the joint's limits; in asrsim the joint stops at its <limit>")


# -- the table ---------------------------------------------------------------------------------------------------------

_SPRING = special(
    _spring,
    "a spring of ... N m/rad is left out",
    hint="Gazebo and asrsim read springs from <gazebo reference='JOINT'> <springStiffness>, <springReference>",
)
_DRIVE = _words(READ, " ".join((*ROTOR, *RATIO, "drake:rotor_inertia", "drake:gear_ratio")))
_STOP = "the joint's stop is elastic or damped ({}) in the file; in asrsim it is rigid"
_MASS = "MuJoCo changes masses and inertias of the file (here: {}); asrsim uses them unchanged"
_SDF = left("<gazebo> changes it by elements of SDF; this has no effect in asrsim", neutral=None)

WORDS: Mapping[str, Mapping[str, Word]] = {
    "robot": {
        "fixed_frame": SILENT,
        **_words(READ, "@name"), **_words(SILENT, "@version @type @verbose verbose sensor group gripper @gripper_name"),
        **_words(SILENT, "frame parameter bullet @xsi:* schedule_topic_creator_file xacro:*"),
        **_within("link", "joint", "material", "gazebo", "transmission", "ros2_control", "mujoco"),
        **_words(CONTACT, "self_collision_checking collision_filter_group drake:collision_filter_group"),
        "force_element": left("the spring or damper between two links is left out", neutral=None),
        "cable": left("the cable is left out: its links move freely", neutral=None),
        **_words(left("the body is left out: asrsim has rigid bodies only", neutral=None), "deformable reduced_deformable"),
        "loop_joint": READ,
        "drake:ball_constraint": left("the constraint is left out: its links move freely", neutral=None),
        "drake:tendon_constraint": left("the constraint is left out: its joints move freely", neutral=None),
        "drake:linear_spring_damper": left("the spring between two links is left out", neutral=None),
        "drake:linear_bushing_rpy": left("the bushing between two links is left out", neutral=None),
        "drake:joint": left("the joint is left out", neutral=None),
    },
    "link": {
        **_words(READ, "@name"), **_words(SILENT, "@type @verbose @concave verbose sensor bullet audio_source"
                                                 " self_filter xacro:*"),
        **_within("inertial", "visual", "collision"),
        "kinematic": left("Gazebo moves this link without forces (kinematic); in asrsim, forces move it"),
        **_words(CONTACT, "contact surface inertia_scaling self_collision_checking collision_checking"),
        "gravity": READ,
    },
    "inertial": _within("origin", "mass", "inertia"),
    "mass": _words(READ, "@value"),
    "inertia": _words(READ, " ".join(f"@{name}" for name in INERTIAS)),
    "visual": {**_words(SILENT, "@name @group bullet xacro:*"), **_within("origin", "geometry", "material"),
               **_words(SILENT, "drake:perception_properties")},
    "collision": {
        **_words(SILENT, "@name verbose"), **_within("origin", "geometry"), **_words(CONTACT, "@group @mask @concave"),
        **_words(CONTACT, "contact_coefficients material max_contacts drake:proximity_properties"),
    },
    "geometry": {
        "@name": SILENT, **_words(READ, "drake:capsule drake:ellipsoid"),
        **_within("box", "sphere", "cylinder", "capsule", "mesh"),
    },
    "box": _words(READ, "@size"),
    "sphere": _words(READ, "@radius"),
    "cylinder": _words(READ, "@radius @length"),
    "capsule": _words(READ, "@radius @length"),
    "mesh": {**_words(READ, "@filename @scale"), "drake:declare_convex": SILENT},
    "material": {**_words(READ, "@name"), **_within("color"), **_words(SILENT, "texture specular drake:diffuse_map")},
    "color": _words(READ, "@rgba"),
    "joint": {
        **_words(READ, "@name @type"), **_words(SILENT, "@dont_collapse calibration hardwareInterface controller_gains anchor"),
        "traits": special(_traits, "a spring of ... N m/rad is left out"),
        **_within("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
        "safety_controller": special(_soft_limits, "soft limits are not enforced: the joint moves up to its <limit>"),
        "limits_soft": left("soft limits are not enforced: the joint moves up to its <limit>", neutral=None),
        "joint_properties": Word(use="read", inside="joint_properties"),
        "drake:screw_thread_pitch": left("the pitch {} of the screw joint is left out: the joint turns without translation"),
    },
    "origin": _words(READ, "@xyz @rpy"),
    "parent": _words(READ, "@link"),
    "child": _words(READ, "@link"),
    "axis": {"@xyz": READ, "@rpy": SILENT},
    "limit": {
        **_words(READ, "@lower @upper @effort @velocity"),
        **_words(SILENT, "@acceleration @drake:acceleration @jerk @deceleration @has_velocity_limits @has_position_limits"
                         " @has_acceleration_limits @has_effort_limits @command_effort @current @gear_velocity"),
    },
    "dynamics": {
        **_words(READ, "@damping @friction"),
        "@armature": READ,
        "@spring_stiffness": _SPRING, "@spring_reference": SILENT,
        "@K": left("a series spring of {} N m/rad is left out",
                   hint="`asrsim init FILE --actuator sea` puts springs in joints"),
        **_words(left("damping of {} is left out", hint="Write it as damping='...'"), "@D @mu_viscous @viscous"),
        **_words(left("friction of {} is left out", hint="Write it as friction='...'"), "@mu_coulomb @frictionloss @coulomb"),
    },
    "joint_properties": {
        "@damping": left("damping of {} is left out", hint="Write it as <dynamics damping='...'/>"),
        "@friction": left("friction of {} is left out", hint="Write it as <dynamics friction='...'/>"),
    },
    "mimic": _words(READ, "@joint @multiplier @offset"),
    "transmission": {
        "joint": Word(use="read", inside="transmission joint"),
        **_words(SILENT, "@name @type type plugin leftActuator rightActuator"
                         " flexJoint rollJoint gap_joint use_simulated_gripper_joint simulated_actuated_joint"
                         " passive_joint compensator robotNamespace simulated_reduction"
                         " motorTorqueConstant screw_reduction init_joint_size final_joint_size"),
        **_DRIVE,
        "actuator": replace(
            special(_rotor_inertia, "the rotor inertia is read for one joint; left out for several joints"), inside="actuator"
        ),
    },
    "transmission joint": {
        **_DRIVE, **_words(SILENT, "@name @type @role hardwareInterface role type offset differential_type xacro:*"),
    },
    "actuator": {
        **_DRIVE,
        **_words(SILENT, "@name @type @role hardwareInterface role type offset motorTorqueConstant drake:* xacro:*"),
    },
    "ros2_control": {
        **_words(SILENT, "@name @type @rw_rate @is_async @thread_priority hardware sensor gpio"), **_within("transmission"),
        "joint": Word(use="read", inside="ros2_control joint"),
    },
    "ros2_control joint": {
        **_words(READ, "@name state_interface"), **_words(SILENT, "@type xacro:* properties"),
        "@mimic": special(_coupling, "a coupling that contradicts the joint's <mimic>: the <mimic> is used"),
        "param": special(_coupling, "a coupling that contradicts the joint's <mimic>: the <mimic> is used"),
        "command_interface": replace(
            special(_command_range, "`min` and `max` inside of the joint's limits have no effect"), inside="command_interface"
        ),
        "limits": special(_limits_off, "limits that ros2_control switches off act in asrsim"),
    },
    "command_interface": {
        **_words(SILENT, "@name @data_type @size param"),
        "limits": special(_limits_off, "limits that ros2_control switches off act in asrsim"),
    },
    "mujoco": {
        **_words(SILENT, "size visual asset statistic"), **_within("compiler"),
        **{word: left("MuJoCo's options have no effect: the scenario states step, gravity and engine", neutral=None)
           for word in ("option", "default")},
    },
    "compiler": {
        **_words(left(_MASS), "@boundmass @boundinertia"), "@settotalmass": left(_MASS, neutral=-1.0),
        "@inertiafromgeom": special(_from_shapes, "MuJoCo computes masses from shapes; asrsim uses the masses in the file"),
        **_words(SILENT, "@angle @autolimits @balanceinertia @coordinate @convexhull @discardvisual @eulerseq @exactmeshinertia"
                         " @fitaabb @fusestatic @meshdir @texturedir @assetdir @strippath @usethread @alignfree @saveinertial"
                         " @inertiagrouprange @name lengthrange"),
    },
    "gazebo": {
        "@reference": READ, "plugin": Word(use="read", inside="plugin"),
        **_words(SILENT, "sensor:* controller:* interface:* xacro:* gripper"),
        **_words(left("this joint closes a loop in older versions of Gazebo; it is left out", neutral=None), "joint:*"),
        **_words(SILENT, "@name @xmlns @version sensor controller material laserRetro provideFeedback disableFixedJointLumping"
                         " preserveFixedJoint implicitSpringDamper visual light include frame ignition:model"
                         " stopCfm stopErp cfmDamping fudgeFactor physics canonicalBody @parent audio_sink"
                         " audio_source projector rendering script_url genTexCoord transparency mass inertial_precision"),
        **_words(CONTACT, "mu mu1 mu2 kp kd maxVel minDepth fdir1 maxContacts max_contacts selfCollide self_collide"
                          " surface collision slip1 slip2 soft_cfm soft_erp restitution_coefficient threshold"),
        **_words(READ, "springStiffness springReference stribeckFriction stribeckVelocity loadFriction"),
        **_words(READ, "turnGravityOff gravity"),
        **_words(left(_STOP), "stopKp stopKd"),
        "dampingFactor": left("Gazebo slows the link in every step by a factor of {}; in asrsim it moves without this loss"),
        "velocity_decay": left("Gazebo slows the link in every step; in asrsim it moves without this loss", neutral=None),
        "pose": special(_model_pose, "Gazebo turns the robot; in asrsim the robot keeps its orientation", hint=_BASE),
        "static": left("Gazebo holds the whole robot in place (static); in asrsim it moves"),
        "kinematic": left("Gazebo moves this link without forces (kinematic); in asrsim, forces move it"),
        "enable_wind": left("wind does not act in asrsim"),
        "joint": READ, **_words(_SDF, "inertial axis limit link model"),
    },
}  # fmt: skip
"""Words by parent and name; `@` marks attributes. Words in the name space of another program have its prefix (`drake:capsule`);
`sensor:*` means all of them.
"""

PLUGINS: tuple[tuple[tuple[str, ...], Word], ...] = (
    (("mimic",), special(_mimic_plugin, "a plugin with <joint> and <mimicJoint> is read; otherwise the joints move freely")),
    (
        ("buoyancy", "liftdrag", "lift_drag", "hydrodynamic", "wind", "vacuum", "suction", "grasp", "attacher", "planar_move",
         "diff_drive", "skid_steer", "motor_model", "propeller", "thruster", "ros_force.", "joint_force",
         "link_force", "external_force", "apply_force",
         "joint_damp", "spring", "gearbox", "disable", "detachable", "velocity_control", "mecanum", "ackermann", "tracked",
         "wrench", "harness", "conveyor", "joint_torque"),
        left("the plugin acts on the robot in Gazebo; in asrsim it has no effect", neutral=None),
    ),
)  # fmt: skip
"""Plugins of Gazebo that move or couple bodies, by a part of their file's name."""
SILENT_PLUGINS = re.compile(
    "control|imu|camera|laser|lidar|ray|depth|kinect|openni|realsense|astra|zed|gps|navsat|sonar|range|bumper|contact|ft_sensor"
    "|force_?torque|f3d|p3d|pose|odom|truth|state|publisher|video|template|api|factory|properties|sensor|magnet|baro|altimeter"
    "|thermal|battery|mavlink|bag|prosilica|projector|label|display|audio|sound|physics|user_commands|scene|touch|tactile|skin"
    "|rfid|radar|uwb|ultrasonic|encoder|clock|yarp|rosbridge|tf_"
)
"""Pattern in the names of plugins that publish, measure or control, and therefore have no physics."""
UNKNOWN_PLUGIN = special(
    lambda plugin, _text: Effect(
        f"the plugin '{plugin.get('filename', '')}' is unknown: its effect in Gazebo does not exist in asrsim"
    ),
    "a plugin that is neither an actuator of asrsim nor a known plugin of Gazebo: it has no effect",
)
"""Any other plugin in `<gazebo>`."""
