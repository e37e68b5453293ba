"""A simulation as a Gymnasium environment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces

from asrsim.environment.draws import Draws, plan
from asrsim.environment.readings import Readings
from asrsim.errors import DivergenceError, InputError, Problem, did_you_mean
from asrsim.samples import Array
from asrsim.scenario.data import Scenario
from asrsim.simulation.prepare import one_scenario
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.ranges import ranges_of, with_ranges
from asrsim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from asrsim.environment.picture import Picture
    from asrsim.render.draw import Image


LARGEST = 8192
"""Pixels of a picture's edge, at most."""


@dataclass(frozen=True)
class State:
    """What a reward may look at, after an action."""

    time: float
    """s since the start of the episode."""
    values: Mapping[str, Array]
    """Observed quantity -> (n,), SI."""
    goal: Mapping[str, float]
    action: Array
    """In [-1, 1], as it was given."""


class SoftRobotEnv(gymnasium.Env[Array, Array]):
    """See :func:`asrsim.environment.make_env`. Equal seeds and actions give equal bits."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self, scenario: str | Path | Scenario, *, variant: str | None, overrides: Any, control_rate: float,
        observe: Sequence[str], act: Sequence[str], reward: Callable[[State], float] | None,
        terminated: Callable[[State], bool] | None, randomise: Mapping[str, Any], initial: Mapping[str, Any],
        goal: Mapping[str, Any], tip: tuple[str, Sequence[float]] | None, render_mode: str | None, size: int,
    ) -> None:  # fmt: skip
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"no render mode '{render_mode}'", choices=("rgb_array",), code="render-mode")
        if not (isinstance(size, int) and not isinstance(size, bool) and 1 <= size <= LARGEST):
            raise InputError(f"a picture has from 1 to {LARGEST} pixels an edge", value=size, code="picture-size")
        self.render_mode, self._size = render_mode, size
        self._picture: Picture | None = None
        scenario = one_scenario(scenario, variant=variant, overrides=overrides)
        prepared = with_ranges(scenario)
        self._steps = _steps(control_rate, scenario.step)
        self.metadata = {**self.metadata, "render_fps": max(1, round(control_rate))}
        self._last = math.ceil(scenario.duration / (self._steps * scenario.step) - 1e-9)
        self._actions, low, high = _actions(prepared, (act,) if isinstance(act, str) else act)
        self._middle, self._half = 0.5 * (high + low), 0.5 * (high - low)
        self._reward, self._terminated = reward, terminated
        self._random, self._start, self._goal = Draws(randomise), Draws(initial), Draws(goal)
        # Not at the first draw that lies beyond a stop, long into a training.
        for places in self._start.bounds():
            prepared.start(dict(zip(self._start.keys, (x if math.isfinite(x) else 0.0 for x in places), strict=True)), {})
        self._plan = plan(self._random, prepared)
        substeps = prepared.resolution.substeps
        self.simulation = Simulation(prepared, chunk=self._steps * substeps, expected_substeps=10**6, duration=1e7)
        self._readings = Readings(self.simulation, (observe,) if isinstance(observe, str) else observe, tip)
        self._count = 0
        self._drawn: dict[str, float] = {}
        self._goals: dict[str, float] = {}
        self.action_space = spaces.Box(-1.0, 1.0, (len(self._actions),), np.float64)
        ends = self._goal.bounds()
        size_observed = self._readings.size
        bound = np.full(size_observed, np.inf)
        self.observation_space = spaces.Box(
            np.concatenate([-bound, ends[0]]), np.concatenate([bound, ends[1]]), dtype=np.float64
        )  # fmt: skip
        self._nothing = np.zeros(len(self._actions))

    @property
    def action_names(self) -> tuple[str, ...]:
        """`joint.reference` of each number of an action."""
        return tuple(f"{joint}.{reference}" for joint, reference in self._actions)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Back to the start, with what is drawn anew."""
        super().reset(seed=seed)
        chance = self.np_random if self._random.keys or self._start.keys or self._goal.keys else None
        self._count = 0
        self._goals = self._goal.draw(chance) if chance is not None else {}
        self._drawn = self._random.draw(chance) if chance is not None and self._random.keys else {}
        start = self._start.draw(chance) if chance is not None and self._start.keys else None
        changes = self._plan.changes(self._drawn) if self._drawn else None
        self.simulation.reset(start, parameters=changes or None)
        for key, places in self._plan.references.items():
            for joint, reference in places:
                self.simulation.set_reference(joint, reference, self._drawn[key])
        return self._observation(self._readings.read()), {"parameters": self._drawn, "goal": self._goals}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One action for one control period. A motion that leaves what physics allows ends the episode."""
        simulation = self.simulation
        given = np.asarray(action, dtype=np.float64)
        if given.shape != self._nothing.shape or not np.isfinite(given).all():
            raise InputError(f"an action is {len(self._actions)} finite numbers", value=action, code="action")
        values = self._middle + self._half * np.minimum(np.maximum(given, -1.0), 1.0)
        for (joint, reference), value in zip(self._actions, values.tolist(), strict=True):
            simulation.set_reference(joint, reference, value)
        info: dict[str, Any] = {}
        ended = False
        try:
            simulation.advance(self._steps)
        except DivergenceError as error:
            ended, info["divergence"] = True, str(error)
        self._count += 1
        found = self._readings.read()
        observation = self._observation(found)
        reward = 0.0
        if self._reward is not None or self._terminated is not None:
            state = State(simulation.time, found, self._goals, given)
            reward = _rewarded(self._reward(state)) if self._reward is not None else 0.0
            ended = ended or (self._terminated is not None and bool(self._terminated(state)))
        return observation, reward, ended, self._count >= self._last and not ended, info

    def _observation(self, found: Mapping[str, Array]) -> Array:
        return (
            np.concatenate([*found.values(), list(self._goals.values())]) if self._goals else np.concatenate([*found.values()])
        )

    def render(self) -> Image | None:
        """(size, size, 3) of 8 bits, without a display; a goal of x, y and z beside an observed tip is a red ball."""
        if self.render_mode is None:
            return None
        from asrsim.environment.picture import Picture, goal_of

        goal = goal_of(self._readings.read().get("tip"), self._goals)
        if self._picture is None:
            self._picture = Picture(self.simulation, self._size, goal)
        return self._picture.image(goal)

    def close(self) -> None:
        """Release the engine."""
        self.simulation.close()


def _rewarded(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError("must return a number", key="reward", value=repr(value), code="option-kind") from None


def _steps(control_rate: float, step: float) -> int:
    if not (math.isfinite(control_rate) and control_rate > 0):
        raise InputError("the control rate must be above 0 Hz", value=control_rate, code="control-rate")
    count = 1.0 / (control_rate * step)
    if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
        message = f"a control period of {1.0 / control_rate:g} s is no whole number of steps of {step:g} s"
        raise InputError(message, value=control_rate, code="control-rate")
    return round(count)


def _actions(prepared: Prepared, act: Sequence[str]) -> tuple[tuple[tuple[str, str], ...], Array, Array]:
    """Joint and reference of each number of an action, with least and largest values."""
    ranges = ranges_of(prepared)
    firsts = [(joint, name) for joint, given in ranges.items() for name in list(given)[:1] if name != "external_torque"]
    known = {f"{joint}.{name}": (joint, name) for joint, given in ranges.items() for name in given}
    found: list[tuple[str, str]] = [] if act else firsts
    problems = []
    for name in act:
        own = [known[name]] if name in known else [pair for pair in known.values() if pair[1] == name]
        if not own:
            choices = (*dict.fromkeys(pair[1] for pair in known.values()), *known)
            hint = did_you_mean(name, choices)
            message = f"no joint has the reference '{name}' in its mode"
            problems.append(Problem(message, choices=choices, hint=hint, code="unknown-reference"))
        found += [pair for pair in own if pair not in found]
    table = np.array([ranges[joint][name] for joint, name in found]).reshape(-1, 2)
    problems += [
        Problem(f"{name} of '{joint}' has no limits; declare them by reference_ranges", code="no-range")
        for (joint, name), pair in zip(found, table, strict=True)
        if not np.isfinite(pair).all()
    ]
    if problems:
        raise InputError(problems)
    return tuple(found), table[:, 0], table[:, 1]
