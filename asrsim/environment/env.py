"""A scenario as a single Gymnasium environment, with pictures."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from asrsim.environment.task import Single
from asrsim.environment.vector import SoftRobotVectorEnv

if TYPE_CHECKING:
    from asrsim.render.draw import Image


class SoftRobotEnv(gymnasium.Env[Single, Single]):
    """The environment that `asrsim.environment.make_env` returns. Equal seeds and actions give identical bits."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(self, scenario: Any, options: Mapping[str, Any], *, render_mode: str | None, size: int) -> None:
        self._make = partial(type(self), scenario, options, render_mode=render_mode, size=size)
        self.render_mode = render_mode
        self._many = many = SoftRobotVectorEnv(scenario, options, num_envs=1, threads=1, render_mode=render_mode, size=size)
        self.metadata = {**self.metadata, "render_fps": max(1, round(options["control_rate"]))}
        self.worlds = many.worlds
        """The simulation of this environment, as one world."""
        self.observation_space, self.action_space = many.single_observation_space, many.single_action_space

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle support: the copy is a new environment made with the same arguments."""
        return self._make, ()

    @property
    def action_names(self) -> tuple[str, ...]:
        """Reference that each entry of an action sets, as `joint.reference`."""
        return tuple(f"{joint}.{reference}" for joint, reference in self._many.task.actions)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Single, dict[str, Any]]:
        """Begin a new episode with new random values. Returns the observation, and the random values."""
        super().reset(seed=seed)
        observations, _ = self._many.reset(seed=seed)
        episode = self._many.episodes[0]
        return observations[0], {"parameters": episode.parameters, "goal": episode.goal}

    def step(self, action: Any) -> tuple[Single, float, bool, bool, dict[str, Any]]:
        """Apply one action for one control period. If the simulation diverges, this terminates the episode."""
        observations, rewards, ended, truncated, _ = self._many.step(np.asarray(action)[None])
        return observations[0], float(rewards[0]), bool(ended[0]), bool(truncated[0]), {}

    def render(self) -> Image | None:
        """Picture of the present state, (size, size, 3) with 8 bits per value; no display is needed."""
        images = self._many.render()
        return None if images is None else images[0]

    def close(self) -> None:
        """Release the engine."""
        self.worlds.close()
