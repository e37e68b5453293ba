"""Values of actuator blocks: defaults, changes of modes and parameters, and checks whether calculations are possible."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

from asrsim.actuators import ACTUATORS, MODES, Parameter
from asrsim.actuators.electric import missing_constants
from asrsim.actuators.parameters import LINK_CONTROLLER_DEFAULTS
from asrsim.actuators.stages import Stage
from asrsim.errors import Problem, ScenarioError, hint_of_own
from asrsim.robot.findings import LARGEST_NUMBER, SMALLEST
from asrsim.robot.model import UNREAD, ActuatorBlock, Origin, ParameterValue, Robot
from asrsim.robot.tags import parameter_tags

MODE_CHOICES = tuple(f"{mode.number} ({mode.name})" for mode in MODES.values())
DEFLECTION = 1e-3
"""Deflection at which an actuator's laws are evaluated for a check, rad; the deflection limit is used instead if it is smaller.
"""


def default_value(parameter: Parameter, mode: int | None) -> tuple[float, Origin]:
    """Default of a parameter in a mode. In mode 1, controller 1 acts on the link and has other gains."""
    if mode == 1 and parameter.name in LINK_CONTROLLER_DEFAULTS:
        return LINK_CONTROLLER_DEFAULTS[parameter.name], "mode default"
    return parameter.default, "default"


def default_parameter(parameter: Parameter, mode: int | None, tag: str) -> ParameterValue:
    """Parameter with its default value, since nothing sets it."""
    value, origin = default_value(parameter, mode)
    return ParameterValue(name=parameter.name, value=value, unit=parameter.unit, origin=origin, tag=tag)


def block_for(joint: str, actuator: str, mode: int, namespace: str = "") -> ActuatorBlock:
    """Block of an actuator with default values. Raises InputError if the actuator is unknown."""
    cls = ACTUATORS.get(actuator)
    tags = parameter_tags(cls)
    parameters = {one.name: default_parameter(one, mode, tags[one.name]) for one in cls.all_parameters()}
    return ActuatorBlock(actuator=actuator, joint=joint, mode=mode, namespace=namespace, parameters=parameters)


def with_mode(block: ActuatorBlock, mode: int) -> ActuatorBlock:
    """Block in another mode. The defaults of controllers follow the mode."""
    if mode == block.mode:
        return block
    values = dict(block.parameters)
    for parameter in ACTUATORS.get(block.actuator).all_parameters():
        old = values[parameter.name]
        if old.origin in ("default", "mode default"):
            number, origin = default_value(parameter, mode)
            if (number, origin) != (old.value, old.origin):
                values[parameter.name] = replace(old, value=number, origin=origin)
    return replace(block, mode=mode, parameters=values)


def with_values(block: ActuatorBlock, given: Mapping[str, float], scope: str) -> tuple[ActuatorBlock, list[Problem]]:
    """Block with other values of parameters, which a scenario gives by name or tag, and the problems of invalid values.

    scope: the joint that the scenario names, or `"*"` for all joints, under which a parameter that this actuator lacks is
    ignored. A parameter with an invalid value becomes `UNREAD`.
    """
    actuator = ACTUATORS.get(block.actuator)
    declared = {parameter.name: parameter for parameter in actuator.all_parameters()}
    values = dict(block.parameters)
    seen: dict[str, str] = {}
    problems: list[Problem] = []
    for key, number in given.items():
        place = f"parameters.{scope}.{key}"
        name = block.names.get(key)
        if name is None:
            problems += [] if scope == "*" else [_unknown_parameter(place, key, block.names)]
        elif name in seen:
            message, hint = f"states the same parameter as {seen[name]}", f"Give {seen[name]}"
            problems.append(Problem(message, key=place, hint=hint, code="duplicate-parameter"))
        else:
            seen[name] = key
            fault = None if number is UNREAD else parameter_fault(declared[name], float(number))
            if fault:
                problems.append(Problem(fault, key=place, value=number, code="out-of-range"))
            value = UNREAD if fault else float(number)
            values[name] = replace(values[name], value=value, origin="scenario", line=None, text="")
    return replace(block, parameters=values), problems


def _unknown_parameter(place: str, key: str, known: Collection[str]) -> Problem:
    """Problem of a parameter that none of the concerned actuators has. place: dotted key in the scenario; known: valid
    names.
    """
    names = tuple(sorted(known))
    hint = hint_of_own(key, names, "actuators and stages")
    return Problem("no such parameter", key=place, hint=hint, choices=names, code="unknown-parameter")


def parameter_fault(parameter: Parameter, value: float) -> str | None:
    """Reason why a parameter cannot have the value; None if the value is valid. Values that are too large or too small would
    overflow."""
    fault = parameter.fault(value)
    if fault is None and math.isfinite(value) and value:
        if abs(value) > LARGEST_NUMBER:
            return f"is larger than {LARGEST_NUMBER:g}, too large for an actuator"
        if abs(value) < SMALLEST:
            return f"is closer to 0 than {SMALLEST:g}, too small for an actuator"
    return fault


def law_fault(block: ActuatorBlock) -> str | None:
    """Reason why the actuator's laws give no number near rest with its parameters; None if they give numbers.

    Other errors of a user's laws are reported where the laws are used.
    """
    actuator, values = ACTUATORS.get(block.actuator), block.values()
    if not MODES[block.mode].spring or any(map(math.isnan, values.values())):
        return None
    parameters = actuator.law_values(values)
    away = min(DEFLECTION, values.get("max_deflection", DEFLECTION))
    motors: tuple[float, ...] = ()
    laws: tuple[Any, ...] = actuator.elastic_torques, actuator.stiffness, actuator.elastic_energy
    for law in laws:
        try:
            motors = motors or actuator.motor_references(0.0, actuator.typical_preset)
            total = 0.0
            for q in (-away, 0.0, away):
                result = law(q, *motors, parameters)
                total += sum(result) if isinstance(result, tuple) else result
            if not math.isfinite(total):
                return f"its {law.__name__.replace('_', ' ')} is not finite"
        except ArithmeticError as error:
            return f"its {law.__name__.replace('_', ' ')} cannot be computed ({error})"
        except Exception:
            return None
    return None


def together_faults(block: ActuatorBlock) -> Iterator[Problem]:
    """Problems of a block's values that are valid separately but contradict each other."""
    for index in range(1, ACTUATORS.get(block.actuator).motors + 1):
        low, high = (block.parameters[f"motor_{index}_{end}_position"] for end in ("min", "max"))
        if low.value > high.value:
            yield Problem(
                f"the lower stop of motor {index} is above its upper stop",
                line=low.line or high.line,
                key=f"parameters.{block.joint}",
                value=f"{low.value:g} > {high.value:g}",
                code="limits-crossed",
            )
    mode = MODES[block.mode]
    # In modes that command a voltage or a current, the motors need the constants of electric motors.
    lacking = missing_constants(block.values(), ACTUATORS.get(block.actuator).motors, mode) if mode.command != "torque" else ()
    if lacking:
        message = f"mode {mode.number} ({mode.name}) cannot drive its motors: {' and '.join(lacking)} must be larger than 0"
        yield Problem(message, key=f"modes.{block.joint}", code="operation-mode")
    fault = law_fault(block)
    if fault is not None:
        given = ", ".join(f"{one.name} = {one.value:g}" for one in block.parameters.values() if one.origin == "scenario")
        yield Problem(f"with these parameters {fault}", key=f"parameters.{block.joint}", value=given or None, code="law")


def has_spring(block: ActuatorBlock) -> bool:
    """Whether the springs give a torque at some deflection within the limit."""
    actuator, values = ACTUATORS.get(block.actuator), block.values()
    parameters = actuator.law_values(values)
    reach = min(values.get("max_deflection", 1.0), 1.0)
    motors = actuator.motor_references(0.0, actuator.typical_preset)
    try:
        return any(any(actuator.elastic_torques(-part * reach, *motors, parameters)) for part in (0.01, 0.1, 1.0))
    except Exception:
        return True


def stage_acts(stage: type[Stage], block: ActuatorBlock) -> bool:
    """Whether a stage acts at a motor of this actuator, with the values of its parameters and in its operation mode."""
    motors, mode = range(1, ACTUATORS.get(block.actuator).motors + 1), MODES[block.mode]
    return mode.spring and any(stage.constants(block.values(), i, mode) is not None for i in motors)


def with_overrides(
    robot: Robot,
    *,
    modes: Mapping[str, int] | None = None,
    parameters: Mapping[str, Mapping[str, float]] | None = None,
) -> Robot:
    """Robot with other modes and parameters for joints. `"*"` stands for all joints; a joint's own entry takes precedence.

    Parameters have the names of asrsim or the tags of the toolbox. Under `"*"`, parameters that an actuator lacks are ignored
    if another actuator has them. The defaults of controllers follow the mode, since mode 1 has other defaults. Raises
    ScenarioError with all problems: unknown joints, modes and parameters, values out of range, and inconsistent values.
    """
    changed, problems = overridden(robot, modes or {}, parameters or {})
    problems += block_faults(changed, robot)
    if problems:
        raise ScenarioError(problems)
    return changed


def overridden(
    robot: Robot, modes: Mapping[str, int], parameters: Mapping[str, Mapping[str, float]]
) -> tuple[Robot, list[Problem]]:
    """Robot as from `with_overrides` without the invalid entries, and the problem of each invalid mode and parameter.

    A parameter with an invalid value becomes `UNREAD`. `block_faults` checks whether the values of a block fit together.
    """
    problems: list[Problem] = []
    joints = tuple(block.joint for block in robot.actuators)
    for section, keys in (("modes", modes), ("parameters", parameters)):
        problems.extend(
            Problem(
                "no actuator is on this joint",
                key=f"{section}.{joint}",
                choices=joints,
                meant=joint,
                code="unknown-joint",
            )
            for joint in keys
            if joint != "*" and joint not in joints and joint not in robot.unread
        )
    problems.extend(
        Problem(
            "there is no such operation mode",
            key=f"modes.{joint}",
            value=mode,
            choices=MODE_CHOICES,
            code="operation-mode",
        )
        for joint, mode in modes.items()
        if mode not in MODES
    )
    everyone = {name for block in robot.actuators for name in block.names}
    if not robot.unread:
        common = parameters.get("*", {})
        problems.extend(_unknown_parameter(f"parameters.*.{key}", key, everyone) for key in common if key not in everyone)
    blocks = []
    for block in robot.actuators:
        mode = modes.get(block.joint, modes.get("*", block.mode))
        changed = with_mode(block, mode) if mode in MODES else block
        for scope in ("*", block.joint):
            changed, faults = with_values(changed, parameters.get(scope, {}), scope)
            problems += [fault for fault in faults if fault not in problems]  # several blocks have the same problems of `*`
        blocks.append(changed)
    return replace(robot, actuators=tuple(blocks)), problems


def block_faults(robot: Robot, before: Robot) -> list[Problem]:
    """Problems of inconsistent values in actuator blocks. A problem is attributed to the robot file if the block in `before`
    also has it.
    """
    earlier = {block.joint: block for block in before.actuators}
    found = []
    for block in robot.actuators:
        if block.joint in robot.unread:
            continue
        old = earlier.get(block.joint)
        for fault in together_faults(block):
            if old is not None and old.actuator == block.actuator and fault in together_faults(old):
                fault = replace(fault, file=robot.path, line=fault.line or old.line, key=old.plugin_name or block.joint)
            found.append(fault)
    return found
