"""Random values of an episode, drawn from distributions that are stated in the same way as in sweeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from asrsim.errors import InputError, Problem
from asrsim.scenario.data import Imperfections
from asrsim.scenario.overrides import split_path
from asrsim.simulation.drives import COMMAND_DELAY, SENSOR_DELAY
from asrsim.sweeps.keys import KeyPlan, plan_keys
from asrsim.sweeps.laws import Distribution, Values
from asrsim.sweeps.study import axis_of, present_name

if TYPE_CHECKING:
    from asrsim.scenario.data import Scenario
    from asrsim.simulation.prepared import Prepared


class Draws:
    """Laws of random values. For each episode, one value per key is drawn from them."""

    def __init__(self, laws: Mapping[str, Any]) -> None:
        """laws: list of values, range or distribution by key, as in sweeps; `key & key`: the two keys get the same value.
        Raises InputError.
        """
        self._axes = [axis_of(present_name(name), value) for name, value in laws.items()]
        problems = [
            Problem("must be finite numbers", key=" & ".join(axis.keys), code="sweep-values")
            for axis in self._axes
            if isinstance(axis.law, Values)
            and not all(_is_number(one) for value in axis.law.values for one in axis.assign(value).values())
        ]
        if problems:
            raise InputError(problems)

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys, in the order of the laws."""
        return tuple(key for axis in self._axes for key in axis.keys)

    def draw(self, chance: np.random.Generator) -> dict[str, float]:
        """Random values of one episode, by key; `chance` is the generator."""
        return {key: float(value) for axis in self._axes for key, value in axis.assign(_drawn(axis.law, chance)).items()}

    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper bound of the values of each key, in the order of the keys; infinite for a law without a bound."""
        rows: list[list[float]] = []
        for axis in self._axes:
            ends = axis.law.values if isinstance(axis.law, Values) else axis.law.quantile(np.array([0.0, 1.0])).tolist()
            rows += [[float(axis.assign(value)[key]) for value in ends] for key in axis.keys]
        return [min(row) for row in rows], [max(row) for row in rows]


def plan(keys: Sequence[str], prepared: Prepared) -> KeyPlan:
    """Parts of the scenario that the keys change. Raises InputError for a key whose change requires reading the scenario
    again."""
    late = {key: name for key in keys if (name := _delay(key))}
    found = plan_keys([key for key in keys if key not in late], dict.fromkeys(keys, True), prepared.scenario, prepared.robot)
    numbers = {**found.numbers, **{key: _late_joints(key, name, prepared) for key, name in late.items()}}
    wrong = [key for key in keys if key not in numbers and key not in found.references]
    # Some keys could be drawn if the scenario did not start at equilibrium, which depends on them. The error states this.
    freed = replace(prepared.scenario, initial_equilibrium=False) if prepared.scenario.initial_equilibrium else None
    able = plan_keys(wrong, dict.fromkeys(wrong, True), freed, prepared.robot).numbers if freed and wrong else {}
    problems = [
        Problem("cannot change from episode to episode: the scenario would have to be read again", key=key, code="randomise")
        for key in wrong
        if key not in able
    ]
    start = "cannot change from episode to episode: the start, `initial: equilibrium`, depends on it: state another `initial`"
    problems += [Problem(start, key=key, code="randomise") for key in able]
    joints = ("*", *(drive.name for drive in prepared.drives))
    why = "has no effect: none of these joints has a controller that reads a sensor"
    problems += [Problem(why, key=key, choices=joints, code="randomise") for key in late if not numbers[key]]
    if problems:
        raise InputError(problems)
    return replace(found, numbers=numbers)


def with_longest_delays(scenario: Scenario, draws: Draws) -> Scenario:
    """The scenario with the longest delays of commands and sensors that can be drawn, since worlds reserve memory for the
    longest delay. Raises InputError.
    """
    for key, longest, shortest in zip(draws.keys, *reversed(draws.bounds()), strict=True):
        if not (name := _delay(key)):
            continue
        if not (shortest >= 0.0 and math.isfinite(longest)):
            raise InputError(
                "must be at least 0 s and have an upper bound", key=key, value=(shortest, longest), code="randomise"
            )
        joint = split_path(key)[2]
        own = scenario.command_imperfections if name == COMMAND_DELAY else scenario.sensor_imperfections
        table = {**own, joint: replace(own.get(joint, Imperfections()), delay=longest)}
        if name == COMMAND_DELAY:
            scenario = replace(scenario, command_imperfections=table)
        else:
            scenario = replace(scenario, sensor_imperfections=table)
    return scenario


def _delay(key: str) -> str:
    """Name of the delay that a key of the scenario sets (`imperfections.sensors.joint_1.delay`); empty for other keys."""
    parts = split_path(key)
    known = {"commands": COMMAND_DELAY, "sensors": SENSOR_DELAY}
    return known.get(parts[1], "") if len(parts) == 4 and parts[::3] == ("imperfections", "delay") else ""


def _late_joints(key: str, name: str, prepared: Prepared) -> tuple[tuple[str, str], ...]:
    """Joints whose delay a key sets, each with the name of this delay."""
    commands, joint = name == COMMAND_DELAY, split_path(key)[2]
    own = prepared.scenario.command_imperfections if commands else prepared.scenario.sensor_imperfections
    return tuple(
        (drive.name, name)
        for drive in prepared.drives
        if (drive.name == joint or (joint == "*" and drive.name not in own))
        and (drive.command_imperfections if commands else drive.sensor) is not None
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _drawn(law: Values | Distribution, chance: np.random.Generator) -> Any:
    if isinstance(law, Values):
        return law.values[int(chance.integers(len(law.values)))]
    # Leave out 0 and 1, at which the quantiles of a law without bounds are infinite.
    share = np.clip(chance.random(1), 1e-12, 1.0 - 1e-12)
    return float(law.quantile(share)[0])
