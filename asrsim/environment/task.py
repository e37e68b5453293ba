"""Actions, observations, random values and rewards of a learning task, for single and vectorised environments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from asrsim.environment.draws import Draws, plan, with_longest_delays
from asrsim.environment.readings import KNOWN, Readings
from asrsim.errors import InputError, Problem, did_you_mean
from asrsim.plain import one_or_more
from asrsim.quantities import QUANTITIES
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.drives import EXTERNAL_TORQUE, ranges_of
from asrsim.simulation.examine import examine
from asrsim.simulation.prepare import prepare_worlds
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.quantities import recorded_quantities
from asrsim.simulation.start import Start
from asrsim.simulation.worlds import Worlds
from asrsim.sweeps.fitted import JointDistribution, joint_of, load_fit

TRIED = 20
"""Number of episodes whose random values are tried when an environment is made, so that errors in them appear at once."""
LARGEST = float(np.finfo(np.float32).max)
"""Bound that the observation space states for a value without bounds."""
Single = NDArray[np.float32]


@dataclass(frozen=True)
class State:
    """State after an action: the argument of the functions `reward` and `terminated`. With the option `batched` it is the state
    of all N environments, and each array has the environments as its first axis.
    """

    time: Any
    """Time since the start of the episode, s; for N environments (N,)."""
    values: Mapping[str, Array]
    """Values (n,) or (N, n) of each observed quantity in SI units, without noise."""
    goal: Mapping[str, Any]
    """Goal values by name; for N environments each is an array (N,)."""
    action: Array
    """The action (m,) or (N, m) as the caller gave it, nominally in [-1, 1]."""


@dataclass(frozen=True)
class Episode:
    """Random values that are drawn for an episode: parameters, goal values and initial positions, each by name."""

    parameters: Mapping[str, float] = field(default_factory=dict)
    goal: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    push: Mapping[str, float] = field(default_factory=dict)
    """External torques in N m that act during the episode, by joint."""
    delay: int = 0
    """Delay of the actions in control periods."""


class ControlTask:
    """A scenario as a task for reinforcement learning; see `asrsim.environment.make_env`."""

    def __init__(self, scenario: str | Path | Scenario, options: Mapping[str, Any], *, engine: str | None = None) -> None:
        """options: values of all options, as `asrsim.environment.options.checked` returns them; engine: name of an engine;
        None: the engine of the scenario.
        """
        self._random, self._start, self._goal, self._push = (
            Draws(options[name]) for name in ("randomise", "initial", "goal", "push")
        )
        stated = examine(scenario, variant=options["variant"], overrides=options["overrides"], plugins=options["plugins"])
        longest = with_longest_delays(stated.scenario, self._random)
        given = stated if longest is stated.scenario else longest
        self.prepared = prepared = prepare_worlds(given, engine=engine, settable=True)
        scenario = prepared.scenario
        self.steps = _steps(options["control_rate"], scenario.step)
        """Number of simulation steps per action."""
        self.last = math.ceil(scenario.duration / (self.steps * scenario.step) - 1e-9)
        """Number of actions per episode."""
        self.actions, low, high = _actions(prepared, one_or_more(options["act"] or ()))
        """Joint and reference that each entry of an action sets; `low` and `high` are the ends of their ranges."""
        self._middle, self._half = 0.5 * (high + low), 0.5 * (high - low)
        self._reward, self._terminated = options["reward"], options["terminated"]
        self.batched: bool = options["batched"]
        """Whether the functions `reward` and `terminated` take the states of all environments at once."""
        delay = options["delay"]
        self._delay = Draws({} if delay is None else {"delay": [delay] if isinstance(delay, int | float) else delay})
        self._period = self.steps * scenario.step
        self._fit: JointDistribution | None = (
            joint_of(load_fit(Path(options["fit"])), Path(options["fit"])) if options["fit"] else None
        )
        for joint in self._push.keys:
            prepared.slot_of(joint, EXTERNAL_TORQUE)
        # Test the bounds of the initial positions now, so that a position beyond a stop does not raise an error after hours of
        # training.
        for places in self._start.bounds():
            positions = dict(zip(self._start.keys, (x if math.isfinite(x) else 0.0 for x in places), strict=True))
            prepared.started(Start(positions=positions))
        drawn = () if self._fit is None else tuple(key for group in self._fit.groups for key in group)
        self._plan = plan((*self._random.keys, *drawn), prepared)
        # Test random values now, so that physically impossible values raise an error now, too.
        chance = np.random.default_rng(0)
        for _ in range(TRIED if self._random.keys or drawn else 0):
            prepared.vary(self.changes(self.draw(chance)))
        self._observe, self._tip = one_or_more(options["observe"]), options["tip"]
        self.noise: Mapping[str, float] = options["noise"]
        """Standard deviation of the noise of each observed quantity, in its unit."""
        if unknown := [name for name in self.noise if name not in self._observe]:
            raise InputError("is not observed", key="noise", value=unknown[0], choices=tuple(self._observe), code="noise")
        for name, value in self.noise.items():
            if not (isinstance(value, int | float | np.number) and 0.0 <= value < math.inf):
                message = "must be a standard deviation of at least 0"
                raise InputError(message, key=f"noise.{name}", value=value, code="noise")
        self.history: int = options["history"]
        """Number of earlier control periods whose observed values and actions belong to an observation."""
        if not 0 <= self.history <= self.last:
            message = f"must be 0 to {self.last} control periods, the length of an episode"
            raise InputError(message, key="history", value=self.history, code="option-type")
        shortest, longest_delay = ([0.0, *ends] for ends in self._delay.bounds())
        if min(shortest) < 0.0 or not max(longest_delay) <= self.last * self._period:
            message = f"must be 0 to {self.last * self._period:g} s, the length of an episode"
            raise InputError(message, key="delay", value=options["delay"], code="option-type")

    @property
    def read_names(self) -> list[str]:
        """Names of the quantities that the worlds must record, so that they can be observed."""
        recorded = {name for drive in self.prepared.drives for name in recorded_quantities(drive)} & {*QUANTITIES}
        return [name for name in KNOWN if name in recorded and (name in self._observe or name.startswith("motor"))]

    def readings(self, worlds: Worlds) -> Readings:
        """Reader of the observed quantities of these worlds. Raises InputError for unknown quantities."""
        return Readings(worlds, self._observe, self._tip)

    def spaces(self, readings: Readings) -> tuple[Any, Any]:
        """Observation space and action space of one environment."""
        low, high = readings.bounds()
        ends, past = self._goal.bounds(), self.history
        ones = np.ones(past * len(self.actions))
        if self.noise:
            low, high = np.full_like(low, -np.inf), np.full_like(high, np.inf)
        parts: list[list[Any]] = [[low, ends[0], *[low] * past, -ones], [high, ends[1], *[high] * past, ones]]
        bounds = [np.clip(np.concatenate(part), -LARGEST, LARGEST) for part in parts]
        rounded = [
            np.nextafter(bound.astype(np.float32), side, dtype=np.float32)
            for bound, side in zip(bounds, (np.float32(-LARGEST), np.float32(LARGEST)), strict=True)
        ]
        return spaces.Box(rounded[0], rounded[1], dtype=np.float32), spaces.Box(-1.0, 1.0, (len(self.actions),), np.float32)

    def draw(self, chance: np.random.Generator) -> Episode:
        """Random values for the next episode, drawn with the generator `chance`."""
        goal, parameters = self._goal.draw(chance), self._random.draw(chance)
        start, push = self._start.draw(chance), self._push.draw(chance)
        delay = round(max(self._delay.draw(chance).get("delay", 0.0), 0.0) / self._period)
        if self._fit is not None:
            (row,) = self._fit.from_scores(chance.standard_normal((1, len(self._fit.keys))))
            parameters = self._fit.assign(row) | parameters
        return Episode(parameters, goal, start, push, delay)

    @property
    def longest_delay(self) -> int:
        """Largest delay of the actions that can be drawn, in control periods."""
        return round(max([0.0, *self._delay.bounds()[1]]) / self._period)

    @property
    def goals(self) -> int:
        """Number of goal values in an observation."""
        return len(self._goal.keys)

    @property
    def goal_names(self) -> tuple[str, ...]:
        """Names of the goal values, in their order in an observation."""
        return self._goal.keys

    @property
    def draws(self) -> bool:
        """Whether any value is drawn anew for each episode."""
        return bool(self._random.keys or self._start.keys or self._goal.keys or self._push.keys or self._fit is not None)

    def changes(self, episode: Episode) -> Mapping[str, Mapping[str, float]]:
        """Values of the robot's parameters that were drawn for the episode, by joint and parameter."""
        return self._plan.changes(episode.parameters)

    def references(self, episode: Episode) -> list[tuple[str, str, float]]:
        """Joint, reference and value of each constant reference that was drawn at random for the episode."""
        return [
            (joint, reference, episode.parameters[key])
            for key, places in self._plan.references.items()
            for joint, reference in places
        ] + [(joint, EXTERNAL_TORQUE, torque) for joint, torque in episode.push.items()]

    def values_of(self, actions: Array) -> Array:
        """References (environments, actions) in SI units for actions (environments, actions) in [-1, 1]. Raises InputError."""
        if actions.shape[1:] != (len(self.actions),) or np.count_nonzero(np.isfinite(actions)) < actions.size:
            raise InputError(f"an action must be {len(self.actions)} finite numbers", value=actions, code="action")
        # Do not use numpy.clip, which takes twice as long as numpy.minimum and numpy.maximum.
        return self._middle + self._half * np.minimum(np.maximum(actions, -1.0), 1.0)

    @property
    def judges(self) -> bool:
        """Whether the user has given a function `reward` or `terminated`."""
        return self._reward is not None or self._terminated is not None

    def judge_all(self, states: State) -> tuple[Array, NDArray[np.bool_]]:
        """Rewards (N,) of N environments, and whether (N,) their episodes are over, by the user's functions, which take the
        states of all environments. Raises InputError.
        """
        count = len(states.action)
        rewards = np.zeros(count) if self._reward is None else _numbers(self._reward(states), count, "reward")
        over = np.zeros(count) if self._terminated is None else _numbers(self._terminated(states), count, "terminated")
        return rewards, over.astype(bool)

    def judge(self, state: State) -> tuple[float, bool]:
        """Reward in a state, and whether the episode is over. Raises InputError for a reward that is not a number."""
        reward = _rewarded(self._reward(state)) if self._reward is not None else 0.0
        over = False if self._terminated is None else self._terminated(state)
        if np.size(over) != 1:
            raise InputError("must return True or False", key="terminated", value=repr(over), code="option-kind")
        return reward, bool(over)


def _numbers(values: Any, count: int, key: str) -> Array:
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        found = np.full(0, np.nan)
    if found.shape != (count,) or np.isnan(found).any():
        message = f"must return {count} numbers, one for each environment"
        raise InputError(message, key=key, value=f"shape {np.shape(values)}", code="option-kind")
    return found


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
        raise InputError("must be above 0 Hz", key="control_rate", value=control_rate, code="control-rate")
    count = 1.0 / (control_rate * step)
    if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
        message = f"its period of {1.0 / control_rate:g} s is not a whole number of steps of {step:g} s"
        raise InputError(message, key="control_rate", value=control_rate, code="control-rate")
    return round(count)


def _actions(prepared: Prepared, act: Sequence[str]) -> tuple[tuple[tuple[str, str], ...], Array, Array]:
    """Joint and reference of each entry of an action, and the smallest and largest value of each of these references."""
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
            problems.append(Problem(message, key="act", value=name, choices=choices, hint=hint, code="unknown-reference"))
        found += [pair for pair in own if pair not in found]
    table = np.array([ranges[joint][name] for joint, name in found]).reshape(-1, 2)
    problems += [
        Problem(f"reference '{name}' of joint '{joint}' has no limits: declare them in reference_ranges", code="no-range")
        for (joint, name), pair in zip(found, table, strict=True)
        if not np.isfinite(pair).all()
    ]
    imperfect = {drive.name for drive in prepared.drives if drive.command_imperfections is not None}
    problems += [
        Problem(
            f"the imperfections of the commands of '{joint}' would not act on '{name}': an action sets this reference at once",
            key="act",
            hint="Leave out the imperfections of this joint's commands; the option `delay` delays actions",
            code="imperfect-action",
        )
        for joint, name in found
        if joint in imperfect and name != EXTERNAL_TORQUE
    ]
    if problems:
        raise InputError(problems)
    return tuple(found), table[:, 0], table[:, 1]
