"""What a time step means for a robot, estimated from its file: stiff springs, damping and gains past their limits.

Estimates: the inertia is that of the zero pose with a fixed base, the stiffness the largest that the deflection limit and the
motors' torque let a spring reach. The simulation itself works with exact mass matrices and chooses its substeps by them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from typing import Any

from asrsim.actuators import ACTUATORS, MODES, Actuator
from asrsim.actuators.electric import electric_of
from asrsim.errors import Problem
from asrsim.robot.inertia import zero_pose_inertia
from asrsim.robot.model import ActuatorBlock, Joint, Robot

RESOLUTION = 0.2
"""omega h at which a spring counts as resolved."""
FREE_RANGE = 0.5
"""rad, deflection assumed for an actuator without `max_deflection`."""


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """How one joint and one step go together; dimensionless unless said."""

    joint: str
    inertia: float
    """kg m^2, effective (all other joints free), at the zero pose."""
    stiffness: float
    """N m/rad, the largest reachable; 0 in modes without spring."""
    natural: float
    """Hz, of the link on its unloaded spring, the motors held; an adjuster or preset at its typical value; 0 without spring."""
    spring: float
    """omega h of the link on its spring; the explicit scheme is stable below 2."""
    substeps: int
    """Steps a step that resolve the spring (omega h at most 0.2 each)."""
    damping: float
    """c h / I of the URDF's damping; explicit damping diverges above 2."""
    link_gain: float
    """h (ctrl_D + c) / I in mode 1; diverges above 2."""
    motor_gain: float
    """Largest h (ctrl_D + d) / J of the motors in modes 5 and 6; diverges above 2."""


def step_figures(robot: Robot, *, step: float) -> tuple[StepFigures, ...]:
    """Figures of every moving joint at a step in s, in file order."""
    effective = zero_pose_inertia(robot).effective
    blocks = {block.joint: block for block in robot.actuators}
    return tuple(_figures(joint, blocks.get(joint.name), effective[joint.name], step) for joint in robot.moving_joints)


def step_findings(robot: Robot, *, step: float, figures: Sequence[StepFigures] | None = None) -> tuple[Problem, ...]:
    """Warnings about a step in s: what diverges without substeps in an explicit scheme, and what diverges at all.

    figures: of :func:`step_figures`, where they are there already.
    """
    findings = []
    for entry in step_figures(robot, step=step) if figures is None else figures:
        joint = robot.joint(entry.joint)
        block = next((block for block in robot.actuators if block.joint == entry.joint), None)
        findings.extend(_findings(robot, joint, block, entry, step))
    return tuple(findings)


def largest_stiffness(actuator: type[Actuator], parameters: Mapping[str, float], *, motors: bool) -> float:
    """Largest stiffness in N m/rad that can be reached; an adjuster stands at the actuator's typical preset.

    Deflections go up to the limit; where motors have dynamics (`motors`), up to twice their largest torque, which a
    sudden load can bring them to.
    """
    values = actuator.law_values(parameters)
    most = [2.0 * parameters[f"motor_{i + 1}_max_torque"] if motors else math.inf for i in range(actuator.motors)]
    bounds = (*most, *[math.inf] * (2 - len(most)))
    kind: Any = actuator  # For mypy a class of classes cannot be hashed.
    return _largest_within(kind, values, parameters.get("max_deflection", FREE_RANGE), bounds)


@lru_cache
def _largest_within(actuator: Any, values: tuple[float, ...], limit: float, bounds: tuple[float, ...]) -> float:
    """limit: rad of deflection; bounds: N m of each motor. The joints of a robot often have the same springs."""
    sides = (-1.0, 0.0, 1.0)
    rays = list(product(sides, repeat=actuator.motors))
    others = [actuator.typical_preset if actuator.adjuster else 0.0] * (actuator.positions() - actuator.motors)

    def positions(ray: tuple[float, ...], part: float) -> list[float]:
        return [*(part * limit * side for side in ray), *others]

    def holds(ray: tuple[float, ...], part: float) -> bool:
        torques = actuator.elastic_torques(0.0, *positions(ray, part), values)
        return all(abs(torque) <= bound for torque, bound in zip(torques, bounds, strict=True))

    largest = 0.0
    try:
        for ray in rays:
            reach = 1.0 if holds(ray, 1.0) else _largest_part(partial(holds, ray))
            largest = max(
                [largest, *(actuator.stiffness(0.0, *positions(ray, reach * k / 8), values) for k in range(9))],
            )
    except (ArithmeticError, ValueError):
        return math.inf
    return largest


def _largest_part(holds: Callable[[float], bool]) -> float:
    """Largest part of 1 up to which `holds`, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _figures(joint: Joint, block: ActuatorBlock | None, inertia: float, step: float) -> StepFigures:
    stiffness = natural = motor_gain = link_gain = 0.0
    mobility = 1.0 / inertia if inertia > 0.0 else math.inf
    if block is not None:
        mode, values = MODES[block.mode], block.values()
        actuator = ACTUATORS.get(block.actuator)
        if mode.spring:
            stiffness = largest_stiffness(actuator, values, motors=mode.motor)
            unloaded = actuator.motor_references(0.0, actuator.typical_preset)
            stiffness_at_rest = actuator.stiffness(0.0, *unloaded, actuator.law_values(values))
            natural = math.sqrt(max(stiffness_at_rest, 0.0) * mobility) / math.tau
        elif mode.controller:
            link_gain = step * (values["controller_1_derivative"] + joint.damping) * mobility
        if mode.motor:
            indices = range(1, actuator.motors + 1)
            # Motor and link swing against each other: 1/I + 1/J.
            spring_mobility = mobility + max(1.0 / values[f"motor_{i}_inertia"] for i in indices)
            if mode.controller:
                losses = []
                for i in indices:
                    electric = electric_of(values, i, mode)
                    brake = electric.gain * values[f"controller_{i}_derivative"] + electric.lag
                    losses.append((brake + values[f"motor_{i}_damping"]) / values[f"motor_{i}_inertia"])
                motor_gain = step * max(losses)
        else:
            spring_mobility = mobility
        spring = step * math.sqrt(stiffness * spring_mobility) if stiffness > 0.0 else 0.0
    else:
        spring = 0.0
    return StepFigures(
        joint=joint.name,
        inertia=inertia,
        stiffness=stiffness,
        natural=natural,
        spring=spring,
        substeps=max(1, math.ceil(spring / RESOLUTION - 1e-9)) if math.isfinite(spring) else 0,
        damping=joint.damping * step * mobility if joint.damping else 0.0,
        link_gain=link_gain,
        motor_gain=motor_gain,
    )


def _findings(robot: Robot, joint: Joint, block: ActuatorBlock | None, figures: StepFigures, step: float) -> list[Problem]:
    at = f"at a step of {step * 1e3:g} ms"
    found = []

    def warn(message: str, code: str, line: int | None, value: str, hint: str | None = None) -> None:
        found.append(Problem(message, file=robot.path, line=line, key=joint.name, value=value, hint=hint, code=code))

    if figures.inertia <= 0.0:
        return found
    line = block.line if block is not None else joint.line
    if figures.spring >= 2.0:
        cure = f"asrsim takes about {figures.substeps} substeps" if figures.substeps else "no number of substeps resolves it"
        warn(
            f"the spring is too stiff {at}: omega h reaches 2 or more (approximate: zero pose, largest "
            "reachable deflection); the toolbox would be unstable or settle wrongly",
            "stiff-spring", line, f"omega h = {figures.spring:.3g}", cure,
        )  # fmt: skip
    if figures.damping > 2.0:
        warn(
            f"the joint's damping diverges in an explicit step {at}: c h / I is above 2 (approximate, zero pose)",
            "explicit-damping", joint.line, f"c h / I = {figures.damping:.3g}",
        )  # fmt: skip
    if figures.link_gain > 2.0:
        warn(
            f"the gains of mode 1 diverge {at}: h (ctrl_D + c) / I is above 2 (approximate, zero pose)",
            "link-gains", line, f"h (ctrl_D + c) / I = {figures.link_gain:.3g}",
        )  # fmt: skip
    if figures.motor_gain > 2.0:
        warn(
            f"the motors' controllers diverge {at}: h (ctrl_D + mot_D) / mot_J is above 2",
            "motor-gains", line, f"h (ctrl_D + mot_D) / mot_J = {figures.motor_gain:.3g}",
        )  # fmt: skip
    return found
