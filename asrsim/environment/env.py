"""A simulation as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium

from asrsim.environment.task import Episode, Single, State, Task
from asrsim.errors import DivergenceError, InputError
from asrsim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from asrsim.environment.picture import Picture
    from asrsim.render.draw import Image


LARGEST = 8192
"""Largest allowed edge of a picture in pixels."""


class SoftRobotEnv(gymnasium.Env[Single, Single]):
    """The environment that `asrsim.environment.make_env` returns. Equal seeds and actions give identical bits."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(self, scenario: Any, options: Mapping[str, Any], *, render_mode: str | None, size: int) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"there is no render mode '{render_mode}'", choices=("rgb_array",), code="render-mode")
        if not (isinstance(size, int) and not isinstance(size, bool) and 1 <= size <= LARGEST):
            raise InputError(f"the size of a picture must be 1 to {LARGEST} pixels", value=size, code="picture-size")
        self._made_with = scenario, options, {"render_mode": render_mode, "size": size}
        self.render_mode, self._size = render_mode, size
        self._picture: Picture | None = None
        self._task = task = Task(scenario, options)
        self.metadata = {**self.metadata, "render_fps": max(1, round(options["control_rate"]))}
        chunk = task.steps * task.prepared.resolution.substeps
        self.simulation = Simulation(task.prepared, chunk=chunk, expected_substeps=10**6, duration=1e7)
        self._readings = task.readings(self.simulation)
        self.observation_space, self.action_space = task.spaces(self._readings)
        self._count, self._episode = 0, Episode({}, {}, {})

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle support: the copy is a new environment made with the same arguments."""
        return again, (type(self), *self._made_with)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Meaning of each entry of an action, as `joint.reference`."""
        return tuple(f"{joint}.{reference}" for joint, reference in self._task.actions)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Single, dict[str, Any]]:
        """Begin a new episode with new random values; returns the observation and the random values."""
        super().reset(seed=seed)
        task = self._task
        self._count = 0
        self._episode = episode = task.draw(self.np_random) if task.draws else Episode({}, {}, {})
        self.simulation.reset(episode.start or None, parameters=task.changes(episode) or None)
        for joint, reference, value in task.references(episode):
            self.simulation.set_reference(joint, reference, value)
        observation = task.observation(self._readings.read(), episode.goal)
        return observation, {"parameters": episode.parameters, "goal": episode.goal}

    def step(self, action: Any) -> tuple[Single, float, bool, bool, dict[str, Any]]:
        """Apply one action for one control period. If the simulation diverges, the episode is terminated."""
        simulation, task = self.simulation, self._task
        given, values = task.values_of(action)
        for (joint, reference), value in zip(task.actions, values.tolist(), strict=True):
            simulation.set_reference(joint, reference, value)
        info: dict[str, Any] = {}
        try:
            simulation.advance(task.steps)
        except DivergenceError as error:
            info["divergence"] = str(error)
        self._count += 1
        found, goal = self._readings.read(), self._episode.goal
        reward, over = task.judge(lambda: State(simulation.time, found, goal, given))
        ended = over or "divergence" in info
        return task.observation(found, goal), reward, ended, self._count >= task.last and not ended, info

    def render(self) -> Image | None:
        """Picture of the present state, (size, size, 3) with 8 bits per value; no display is needed."""
        if self.render_mode is None:
            return None
        from asrsim.environment.picture import Picture

        if self._picture is None:
            self._picture = Picture(self.simulation, self._size)
        return self._picture.image()

    def close(self) -> None:
        """Release the engine."""
        self.simulation.close()


def again(kind: Any, scenario: Any, options: Mapping[str, Any], keywords: Mapping[str, Any]) -> Any:
    """A new environment of the class `kind`, made with the given arguments; used to unpickle environments."""
    return kind(scenario, options, **keywords)
