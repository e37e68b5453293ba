"""Names of parameters, and the tags of the toolbox for these parameters.

The toolbox calls the parameters of one-motor actuators `mot_*` and `ctrl_*`, and the parameters of two-motor actuators
`mot_1_*`, `mot_2_*`, `ctrl_1_*`, `ctrl_2_*`. Parameters that exist only in asrsim have similar tags. For the spring parameters
of a user's actuator, and for the parameters of stages, the tag is the name of the parameter.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from asrsim.actuators import Actuator
from asrsim.actuators.stages import STAGES

SPRING_TAGS: dict[str, dict[str, str]] = {
    "sea": {"spring_stiffness": "spring_k", "spring_cubic": "spring_k3", "max_deflection": "max_def"},
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
"""Tags of the spring parameters: name of the actuator -> name of the parameter -> tag."""

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
_STAGE_TAGS = {"hysteresis_torque": "hyst_tau", "hysteresis_deflection": "hyst_def"}
_CONTROLLER_TAGS = {"proportional": "P", "integral": "I", "derivative": "D"}

JOINT_TAGS = {
    "spring_stiffness": "springStiffness",
    "spring_reference": "springReference",
    "stribeck_friction": "stribeckFriction",
    "stribeck_velocity": "stribeckVelocity",
    "load_friction": "loadFriction",
}
"""Tags in `<gazebo reference>` by field of the joint. Gazebo defines the tags of springs; asrsim defines the tags of friction,
which Gazebo ignores.
"""

REQUIRED_TAGS = ("joint", "operation_mode", "pub_eltau", "pub_state", "sub_ext_tau")
"""Required tags. Without one of these tags the toolbox crashes. asrsim does not need the last three."""

BLOCK_TAGS = (*REQUIRED_TAGS, "namespace", "t_sample")
"""Tags of a block that are no parameters of its actuator; the last two belong to the toolbox's later dialect (AlterEgo)."""


def parameter_tags(actuator: type[Actuator]) -> Mapping[str, str]:
    """Tags by parameter, for all parameters of the actuator, in the order of `all_parameters`."""
    own: Any = actuator  # the type Any, since mypy regards classes as not hashable
    return _tags(own, STAGES.loaded())


@lru_cache
def _tags(actuator: Any, stages: tuple[Any, ...]) -> Mapping[str, str]:
    """Tags by parameter. stages: all stages, whose parameters have tags too."""
    springs = SPRING_TAGS.get(actuator.name, {})
    own = {parameter.name for parameter in actuator.parameters}
    of_stages = {parameter.name for stage in stages for parameter in stage.parameters}
    tags = {}
    for parameter in actuator.all_parameters():
        name = parameter.name
        if name in own:
            tags[name] = springs.get(name, name)
        else:
            tags[name] = _STAGE_TAGS.get(name, name) if name in of_stages else _motion_tag(name, actuator.motors)
    return MappingProxyType(tags)


def _motion_tag(name: str, motors: int) -> str:
    part, index, rest = name.split("_", 2)
    prefix, table = ("mot", _MOTOR_TAGS) if part == "motor" else ("ctrl", _CONTROLLER_TAGS)
    return f"{prefix}_{table[rest]}" if motors == 1 else f"{prefix}_{index}_{table[rest]}"


def tag_parameters(actuator: type[Actuator]) -> dict[str, str]:
    """Parameters by tag, the inverse of `parameter_tags`. The toolbox's `max_def` also means a user's `max_deflection`."""
    tags = {tag: name for name, tag in parameter_tags(actuator).items()}
    if "max_deflection" in tags and "max_def" not in tags:
        tags["max_def"] = "max_deflection"
    return tags
