"""Will the learned input work on the hardware? The stand-in: plants that differ from the learned one, by stated amounts.

A draw names what differs: spring parameters, masses, damping and friction of joints, the delay of the commands. The learned
input is played to each drawn plant, feed-forward.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from asrsim.actuators import ACTUATORS
from asrsim.errors import Problem, ScenarioError
from asrsim.learning.plant import Plant
from asrsim.robot.model import INERTIAS
from asrsim.robot.tags import parameter_name
from asrsim.robot.vary import varied_robot
from asrsim.samples import Array
from asrsim.scenario.data import Effects, for_joint
from asrsim.scenario.learning_keys import PlantSet
from asrsim.workers import Executor, in_order

if TYPE_CHECKING:
    from asrsim.robot.model import Robot

ADDED = ("delay", "added_friction", "added_damping")
"""Factors that are added, from 0 on, and do not scale: s, N m, N m s/rad."""
CONFIDENCE = 0.95
"""Of the interval of a share."""
Draw = Mapping[str, float]
"""Factor -> relative change (0.1: a tenth more); those of :data:`ADDED`: what is added, in SI."""


@dataclass(frozen=True, kw_only=True)
class TransferReport:
    """What became of the learned input on the drawn plants."""

    tolerance: float
    """In `unit`."""
    draws: tuple[Draw, ...]
    largest: Array = field(repr=False)
    """(draws, joints) rad, largest absolute error of each joint; infinite where a plant diverged."""
    joints: tuple[str, ...]
    unit: str = "rad"
    """Of errors; `rad or m` where joints are of both kinds."""

    @property
    def worst(self) -> Array:
        """(draws,) rad, largest error over the joints."""
        return np.asarray(self.largest.max(axis=1))

    @property
    def within(self) -> float:
        """Share of draws in which every joint stays within the tolerance."""
        return float(np.mean(self.worst <= self.tolerance))

    @property
    def within_interval(self) -> tuple[float, float]:
        """95 % interval of that share (Clopper and Pearson 1934)."""
        from scipy.stats import binomtest

        within = int(np.sum(self.worst <= self.tolerance))
        low, high = binomtest(within, len(self.worst)).proportion_ci(CONFIDENCE)
        return float(low), float(high)

    def quantiles(self, shares: Sequence[float] = (0.05, 0.25, 0.5, 0.75, 0.95)) -> dict[float, float]:
        """Quantiles of the largest error in rad; diverged draws count as infinite."""
        return {share: float(np.quantile(self.worst, share, method="inverted_cdf")) for share in shares}


def draw_plants(others: PlantSet, joints: Sequence[str], count: int | None = None) -> tuple[Draw, ...]:
    """`count` plants (None: as many as the scenario says); the same seed gives the same plants, more draws only add to them.

    Every joint varies on its own; the delay is common to all.
    """
    spread = others.spread
    factors: dict[str, float] = {"delay": spread.delay}
    for joint in joints:
        factors |= {f"parameters.{joint}.{name}": amount for name, amount in spread.parameters.items()}
        factors |= {f"{what}.{joint}": getattr(spread, what) for what in ("mass", "damping", "friction", *ADDED[1:])}
    draws = []
    for index in range(count or others.draws):
        generator = np.random.default_rng([others.seed, index])
        draw = {}
        for name in sorted(name for name, amount in factors.items() if amount > 0.0):
            amount = factors[name]
            if name.partition(".")[0] in ADDED:
                draw[name] = float(generator.uniform(0.0, amount))
            elif others.distribution == "uniform":
                draw[name] = float(generator.uniform(-amount, amount))
            else:
                # Three standard deviations at most, and never a negative mass.
                draw[name] = float(max(np.clip(generator.normal(0.0, amount), -3.0 * amount, 3.0 * amount), -0.95))
        draws.append(draw)
    return tuple(draws)


def transfer(
    reference: Array,
    draws: Sequence[Draw],
    outputs: Sequence[Array],
    *,
    joints: tuple[str, ...],
    tolerance: float,
    unit: str = "rad",
) -> TransferReport:
    """What the draws' link positions `outputs`, (n, joints) each, make of the motion `reference` (n, joints) in rad."""
    largest = np.array([np.abs(reference - output).max(axis=0) for output in outputs])
    largest = np.where(np.isfinite(largest), largest, np.inf)
    return TransferReport(tolerance=tolerance, draws=tuple(draws), largest=largest, joints=joints, unit=unit)


def outputs_of(plant: Plant, inputs: Array, draws: Sequence[Draw], workers: Executor) -> list[Array]:
    """Link positions (n, joints) in rad of each drawn plant with these inputs, in the order of the draws; NaN where a plant
    diverged. Raises ScenarioError for parameters that the plant does not have."""
    return in_order(workers, partial(_one, plant, inputs), draws)


def _one(plant: Plant, inputs: Array, draw: Draw) -> Array:
    return perturbed(plant, draw).outputs(inputs)


def perturbed(plant: Plant, draw: Draw) -> Plant:
    """The plant with a draw's changes.

    A mass goes with its inertia, and that of the links that are fixed to it; friction is that of joint and motors; what is
    added to friction and damping is the joint's. Raises ScenarioError for parameters that the plant does not have.
    """
    from asrsim.scenario import apply_to_robot

    blocks = {block.joint: block for block in apply_to_robot(plant.scenario, plant.robot).actuators}
    parameters = {joint: dict(values) for joint, values in plant.scenario.parameters.items()}
    numbers: dict[str, dict[str, float]] = {}
    problems = []
    for factor, change in draw.items():
        what, _, rest = factor.partition(".")
        joint, _, name = rest.partition(".")
        scaled = [name] if what == "parameters" else []
        if what == "mass":
            numbers |= _heavier(plant.robot, joint, 1.0 + change)
        elif what in ("friction", "damping", *ADDED[1:]):
            loss = what.removeprefix("added_")
            own = numbers.setdefault(joint, {})
            before = own.get(loss, getattr(plant.robot.joint(joint), loss))
            own[loss] = before + change if what in ADDED else before * (1.0 + change)
        if what == "friction":
            scaled = [name for name in blocks[joint].parameters if name.endswith("_friction_torque")]
        for name in scaled:
            known = parameter_name(ACTUATORS.get(blocks[joint].actuator), name)
            if known is None:
                choices = tuple(blocks[joint].parameters)
                message = f"the {blocks[joint].actuator} has no such parameter"
                problems.append(Problem(message, key=f"spread.parameters.{name}", choices=choices, code="unknown-parameter"))
                continue
            given = parameters.setdefault(joint, {})
            given.pop(name, None)
            given[known] = blocks[joint].parameters[known].value * (1.0 + change)
    if problems:
        raise ScenarioError(list(dict.fromkeys(problems)))
    effects = dict(plant.scenario.command_effects)
    for joint in plant.joints if draw.get("delay") else ():
        effect = for_joint(plant.scenario.command_effects, joint, Effects())
        effects[joint] = replace(effect, delay=effect.delay + draw["delay"])
    scenario = replace(plant.scenario, parameters=parameters, command_effects=effects)
    return replace(plant, scenario=scenario, robot=varied_robot(plant.robot, numbers))


def _heavier(robot: Robot, joint: str, factor: float) -> dict[str, dict[str, float]]:
    """Masses and inertias, by link, of what the joint moves as one body, heavier by a factor."""
    body, waiting = {robot.joint(joint).child}, [robot.joint(joint).child]
    while waiting:
        fixed = [item.child for item in robot.carried.get(waiting.pop(), ()) if item.kind == "fixed"]
        body.update(fixed)
        waiting += fixed
    return {
        link.name: {"mass": link.mass * factor} | dict(zip(INERTIAS, (factor * value for value in link.inertia), strict=True))
        for link in robot.links
        if link.name in body and link.mass is not None and link.inertia is not None
    }
