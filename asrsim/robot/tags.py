"""The toolbox's tag names and our parameter names: the one place where they meet.

The released toolbox calls the parameters of one-motor actuators `mot_*`, `ctrl_*` and those of two-motor actuators
`mot_1_*`, `mot_2_*`, `ctrl_1_*`, `ctrl_2_*`. Parameters that only asrsim has are named in the same way. The spring parameters
of a user's own actuator have their own names as tags.
"""

from __future__ import annotations

from asrsim.actuators import Actuator

SPRING_TAGS: dict[str, dict[str, str]] = {
    "sea": {"spring_stiffness": "spring_k", "max_deflection": "max_def"},
    "qbmove": {
        "spring_a_1": "spring_a1",
        "spring_k_1": "spring_k1",
        "spring_a_2": "spring_a2",
        "spring_k_2": "spring_k2",
        "max_deflection": "max_def",
    },
    "bavs": {
        "spring_a": "spring_a",
        "spring_b": "spring_b",
        "spring_k": "spring_k",
        "spring_exponent": "spring_k_e",
        "max_deflection": "max_def",
    },
    "awas_ii": {
        "spring_stiffness": "spring_Ks",
        "lever_length": "spring_L",
        "pulley_radius": "spring_r_t",
        "spring_rest_length": "spring_l_0",
        "max_deflection": "max_def",
    },
}
"""Actuator name -> parameter name -> tag."""

_MOTOR_TAGS = {
    "inertia": "J",
    "damping": "D",
    "max_torque": "tauMax",
    "max_velocity": "maxVel",
    "min_position": "minPos",
    "max_position": "maxPos",
    "friction_torque": "tauFric",
    "stribeck_friction": "tauStribeck",
    "stribeck_velocity": "velStribeck",
    "load_friction": "fricLoad",
    "friction_stiffness": "fricStiff",
    "torque_constant": "kt",
    "resistance": "R",
    "gear_ratio": "gear",
    "max_voltage": "voltMax",
    "max_current": "currMax",
}
_HYSTERESIS_TAGS = {"hysteresis_torque": "hyst_tau", "hysteresis_deflection": "hyst_def"}
_CONTROLLER_TAGS = {"proportional": "P", "integral": "I", "derivative": "D"}

JOINT_TAGS = {
    "spring_stiffness": "springStiffness",
    "spring_reference": "springReference",
    "stribeck_friction": "stribeckFriction",
    "stribeck_velocity": "stribeckVelocity",
    "load_friction": "loadFriction",
}
"""Field of a joint -> tag in its `<gazebo reference>`. Springs are Gazebo's; friction is ours, and Gazebo passes it by."""

REQUIRED_TAGS = ("joint", "operation_mode", "pub_eltau", "pub_state", "sub_ext_tau")
"""Tags without which the released code crashes; asrsim can do without the last three."""

BLOCK_TAGS = (*REQUIRED_TAGS, "namespace", "t_sample")
"""Tags that are not numbers of the actuator; the last two belong to the later dialect (AlterEgo)."""

FOREIGN_QBMOVE_TAGS = ("command_topic", "pos_topic")
"""Tags that give away the older plugin of the same file name (l1va/qbmove_ros)."""


def parameter_tags(actuator: type[Actuator]) -> dict[str, str]:
    """Parameter name -> tag, for every parameter of the actuator, in the order of `all_parameters`."""
    springs = SPRING_TAGS.get(actuator.name, {})
    own = {parameter.name for parameter in actuator.parameters}
    tags = {}
    for parameter in actuator.all_parameters():
        name = parameter.name
        tags[name] = springs.get(name, name) if name in own else _motion_tag(name, actuator.motors)
    return tags


def _motion_tag(name: str, motors: int) -> str:
    if name in _HYSTERESIS_TAGS:
        return _HYSTERESIS_TAGS[name]
    part, index, rest = name.split("_", 2)
    prefix, table = ("mot", _MOTOR_TAGS) if part == "motor" else ("ctrl", _CONTROLLER_TAGS)
    return f"{prefix}_{table[rest]}" if motors == 1 else f"{prefix}_{index}_{table[rest]}"


def tag_parameters(actuator: type[Actuator]) -> dict[str, str]:
    """Tag -> parameter name: :func:`parameter_tags` turned round.

    A user's own `max_deflection` is also found under the toolbox's `max_def`.
    """
    tags = {tag: name for name, tag in parameter_tags(actuator).items()}
    if "max_deflection" in tags and "max_def" not in tags:
        tags["max_def"] = "max_deflection"
    return tags


def parameter_name(actuator: type[Actuator], key: str) -> str | None:
    """The parameter that a scenario means by our name or by the toolbox's tag; None if there is none."""
    names = {parameter.name for parameter in actuator.all_parameters()}
    return key if key in names else tag_parameters(actuator).get(key)
