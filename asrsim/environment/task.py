"""Actions, observations, random values and rewards, shared by single and vectorised environments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from asrsim.environment.draws import Draws, plan
from asrsim.environment.readings import KNOWN, Readings
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.plain import one_or_more
from asrsim.quantities import QUANTITIES
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import ranges_of
from asrsim.simulation.examine import one_scenario
from asrsim.simulation.prepare import Prepared, Start, prepare
from asrsim.simulation.quantities import recorded_quantities
from asrsim.simulation.worlds import Worlds

LARGEST = float(np.finfo(np.float32).max)
"""Bound that the observation space states for unbounded values."""
Single = NDArray[np.float32]


@dataclass(frozen=True)
class State:
    """State after an action: the argument of the reward and termination functions."""

    time: float
    """Time since the start of the episode, s."""
    values: Mapping[str, Array]
    """Values (n,) of each observed quantity in SI units."""
    goal: Mapping[str, float]
    action: Array
    """The action as the caller gave it, nominally in [-1, 1]."""


@dataclass(frozen=True)
class Episode:
    """Random values of an episode: parameters, goal and start positions of joints."""

    parameters: Mapping[str, float]
    goal: Mapping[str, float]
    start: Mapping[str, float]


class ControlTask:
    """A scenario as a learning task; see `asrsim.environment.make_env`."""

    def __init__(
        self, scenario: str | Path | Scenario, options: Mapping[str, Any], *, engine: str | None = None
    ) -> None:  # fmt: skip
        """options: values of all options, as `asrsim.environment.options.checked` returns them; engine: name of an engine;
        None: that of the scenario."""
        scenario = one_scenario(
            scenario, variant=options["variant"], overrides=options["overrides"], plugins=options["plugins"]
        )
        scenario = replace(scenario, engine=engine or scenario.engine)
        self.prepared = prepared = prepare(scenario, settable=True)
        self.steps = _steps(options["control_rate"], scenario.step)
        """Number of simulation steps per action."""
        self.last = math.ceil(scenario.duration / (self.steps * scenario.step) - 1e-9)
        """Number of actions per episode."""
        self.actions, low, high = _actions(prepared, one_or_more(options["act"] or ()))
        """Joint and reference that each entry of an action sets."""
        self._middle, self._half = 0.5 * (high + low), 0.5 * (high - low)
        self._reward, self._terminated = options["reward"], options["terminated"]
        self._random, self._start, self._goal = (Draws(options[name]) for name in ("randomise", "initial", "goal"))
        # Start positions beyond a stop must raise now, not after hours of training.
        for places in self._start.bounds():
            positions = dict(zip(self._start.keys, (x if math.isfinite(x) else 0.0 for x in places), strict=True))
            prepared.started(Start(positions=positions))
        self._plan = plan(self._random, prepared)
        self._observe, self._tip = one_or_more(options["observe"]), options["tip"]

    @property
    def read_names(self) -> list[str]:
        """Names of the quantities that the worlds must record for the observations."""
        recorded = {name for drive in self.prepared.drives for name in recorded_quantities(drive)} & {*QUANTITIES}
        return [name for name in KNOWN if name in recorded and (name in self._observe or name.startswith("motor"))]

    def readings(self, worlds: Worlds) -> Readings:
        """Reader of the observed quantities of worlds. Raises InputError for unknown quantities."""
        return Readings(worlds, self._observe, self._tip)

    def spaces(self, readings: Readings) -> tuple[Any, Any]:
        """Observation space and action space of one environment."""
        low, high = readings.bounds()
        ends = self._goal.bounds()
        bounds = [np.clip(np.concatenate(pair), -LARGEST, LARGEST) for pair in ((low, ends[0]), (high, ends[1]))]
        rounded = [np.nextafter(bound.astype(np.float32), side, dtype=np.float32) for bound, side in zip(
            bounds, (np.float32(-LARGEST), np.float32(LARGEST)), strict=True)]  # fmt: skip
        return spaces.Box(rounded[0], rounded[1], dtype=np.float32), spaces.Box(-1.0, 1.0, (len(self.actions),), np.float32)

    def draw(self, chance: np.random.Generator) -> Episode:
        """Random values for the next episode."""
        goal, parameters = self._goal.draw(chance), self._random.draw(chance)
        return Episode(parameters, goal, self._start.draw(chance))

    @property
    def goals(self) -> int:
        """Number of goal values in an observation."""
        return len(self._goal.keys)

    @property
    def draws(self) -> bool:
        """Whether any value is drawn at random for each episode."""
        return bool(self._random.keys or self._start.keys or self._goal.keys)

    def changes(self, episode: Episode) -> Mapping[str, Mapping[str, float]]:
        """Parameters of the robot that the episode changes, by joint and parameter."""
        return self._plan.changes(episode.parameters)

    def references(self, episode: Episode) -> list[tuple[str, str, float]]:
        """Joint, reference and value of each constant reference that was drawn at random for the episode."""
        return [
            (joint, reference, episode.parameters[key])
            for key, places in self._plan.references.items()
            for joint, reference in places
        ]

    def values_of(self, actions: Array) -> Array:
        """References (environments, actions) in SI units for the actions of some environments. Raises InputError."""
        if actions.shape[1:] != (len(self.actions),) or not np.isfinite(actions).all():
            raise InputError(f"an action must be {len(self.actions)} finite numbers", value=actions, code="action")
        return self._middle + self._half * np.clip(actions, -1.0, 1.0)

    @property
    def judges(self) -> bool:
        """Whether the user has given a function for rewards or for termination."""
        return self._reward is not None or self._terminated is not None

    def judge(self, state: State) -> tuple[float, bool]:
        """Reward, and whether the episode is over. Raises InputError for a reward that is not a number."""
        reward = _rewarded(self._reward(state)) if self._reward is not None else 0.0
        return reward, self._terminated is not None and bool(self._terminated(state))


def _rewarded(value: Any) -> float:
    try:
        reward = float(value)
    except (TypeError, ValueError):
        reward = math.nan
    if math.isnan(reward):
        raise InputError("must return a number", key="reward", value=repr(value), code="option-kind")
    return reward


def _steps(control_rate: float, step: float) -> int:
    if not (math.isfinite(control_rate) and control_rate > 0):
        raise InputError("the control rate must be above 0 Hz", value=control_rate, code="control-rate")
    count = 1.0 / (control_rate * step)
    if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
        message = f"the control period of {1.0 / control_rate:g} s is not a whole number of steps of {step:g} s"
        raise InputError(message, value=control_rate, code="control-rate")
    return round(count)


def _actions(prepared: Prepared, act: Sequence[str]) -> tuple[tuple[tuple[str, str], ...], Array, Array]:
    """Joint and reference of each entry of an action, and the smallest and largest values of these references."""
    ranges = ranges_of(prepared.scenario, prepared.drives)
    firsts = [(joint, name) for joint, given in ranges.items() for name in list(given)[:1] if name != "external_torque"]
    known = {f"{joint}.{name}": (joint, name) for joint, given in ranges.items() for name in given}
    found: list[tuple[str, str]] = [] if act else firsts
    problems = []
    for name in act:
        own = [known[name]] if name in known else [pair for pair in known.values() if pair[1] == name]
        if not own:
            choices = (*dict.fromkeys(pair[1] for pair in known.values()), *known)
            hint = did_you_mean(name, choices)
            message = f"no joint has a reference '{name}' in its mode"
            problems.append(Problem(message, choices=choices, hint=hint, code="unknown-reference"))
        found += [pair for pair in own if pair not in found]
    table = np.array([ranges[joint][name] for joint, name in found]).reshape(-1, 2)
    problems += [
        Problem(f"reference '{name}' of joint '{joint}' has no limits: declare them in reference_ranges", code="no-range")
        for (joint, name), pair in zip(found, table, strict=True)
        if not np.isfinite(pair).all()
    ]
    if problems:
        raise InputError(problems)
    return tuple(found), table[:, 0], table[:, 1]
