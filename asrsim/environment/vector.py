"""Vectorised environment: many environments of one task, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from asrsim.environment.task import ControlTask, Episode, Single, State
from asrsim.errors import InputError
from asrsim.samples import Array
from asrsim.simulation.prepare import Start
from asrsim.simulation.worlds import Worlds, links_engine


class SoftRobotVectorEnv(VectorEnv[Single, Single, Any]):
    """The environments that `asrsim.environment.make_vec_env` returns. Environment i gives the same bits as a single
    environment with the seed of environment i."""

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self, scenario: Any, options: Mapping[str, Any], *, num_envs: int, threads: int, engine: str | None = None,
        device: str = "cpu",
    ) -> None:  # fmt: skip
        """Arguments as in `asrsim.environment.make_vec_env`."""
        self._make = partial(
            type(self), scenario, options, num_envs=num_envs, threads=threads, engine=engine, device=device
        )  # fmt: skip
        self.task = task = ControlTask(scenario, options, engine=links_engine(engine))
        self.num_envs = num_envs
        self.worlds = Worlds(
            task.prepared,
            num_envs,
            names=task.read_names,
            watched=False,
            expected_substeps=10**6,
            threads=threads,
            engine=engine,
            device=device,
        )
        self._readings = task.readings(self.worlds)
        self.single_observation_space, self.single_action_space = task.spaces(self._readings)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._chances: list[np.random.Generator] = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self.episodes = [Episode({}, {}, {})] * num_envs
        """Random values of the present episode of each environment."""
        self._counts = np.zeros(num_envs, dtype=int)
        self._over = np.zeros(num_envs, dtype=bool)
        """Mask (n,) of the environments that the next step resets, because their episodes are over."""
        self._goals = np.zeros((num_envs, task.goals))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle support: the copy is a new set of environments made with the same arguments."""
        return self._make, ()

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Single, dict[str, Any]]:
        """Begin new episodes with new random values. seed: seed of environment 0, where environment i gets seed + i, or a seed
        for each environment. options: `reset_mask` (n,) selects the environments to reset; by default, all are reset."""
        mask = np.ones(self.num_envs, dtype=bool) if options is None else np.asarray(options.get("reset_mask", True))
        mask = np.broadcast_to(mask, self.num_envs).astype(bool)
        if seed is not None:
            seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else list(seed)
            if len(seeds) != self.num_envs:
                raise InputError(f"needs {self.num_envs} seeds", key="seed", value=len(seeds), code="seed")
            for i in np.flatnonzero(mask).tolist():
                if seeds[i] is not None:
                    self._chances[i] = seeding.np_random(seeds[i])[0]
        self._begin(mask)
        return self._observation(self._readings.read()), self._infos(mask)

    def _begin(self, mask: NDArray[np.bool_]) -> None:
        task, numbers = self.task, np.flatnonzero(mask).tolist()
        for i in numbers:
            self.episodes[i] = task.draw(self._chances[i])
            self._goals[i] = list(self.episodes[i].goal.values())
        starts = [Start(parameters=task.changes(self.episodes[i]), positions=self.episodes[i].start) for i in numbers]
        self.worlds.reset(starts, worlds=mask)
        for i in numbers:
            for joint, reference, value in task.references(self.episodes[i]):
                self.worlds.set_reference(joint, reference, value, worlds=[i])
        self._counts[mask], self._over[mask] = 0, False

    def step(self, actions: Any) -> tuple[Single, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Apply one action to each environment for one control period. Environments whose episode is over are reset instead."""
        given = np.asarray(actions, dtype=np.float64)
        if len(given) != self.num_envs:
            raise InputError(f"needs {self.num_envs} actions", key="actions", value=len(given), code="action")
        task, worlds, values = self.task, self.worlds, self.task.values_of(given)
        going, fresh = ~self._over, self._over.copy()
        if fresh.any():
            self._begin(fresh)
        # A single number, and all worlds (None), are handled faster than arrays and masks.
        which = None if going.all() else going
        for (joint, reference), column in zip(task.actions, values[going].T, strict=True):
            worlds.set_reference(joint, reference, column.item() if len(column) == 1 else column, worlds=which)
        worlds.advance(task.steps, worlds=which)
        self._counts[going] += 1
        found = self._readings.read()
        rewards, ended = np.zeros(self.num_envs), ~worlds.healthy
        for i in np.flatnonzero(going).tolist() if task.judges else ():
            own = {name: table[i] for name, table in found.items()}
            state = State(float(worlds.time[i]), own, self.episodes[i].goal, given[i])
            rewards[i], over = task.judge(state)
            ended[i] |= over
        truncated = (self._counts >= task.last) & ~ended & going
        ended &= going
        self._over = ended | truncated
        return self._observation(found), rewards, ended, truncated, self._infos(fresh)

    def _observation(self, found: dict[str, Array]) -> Single:
        return np.concatenate([*found.values(), self._goals], axis=1).astype(np.float32)

    def _infos(self, fresh: NDArray[np.bool_]) -> dict[str, Any]:
        """Random values of the episodes that have just begun, in Gymnasium's format for infos of vector environments."""
        if not fresh.any() or not self.task.draws:
            return {}
        infos: dict[str, Any] = {}
        for i in np.flatnonzero(fresh).tolist():
            episode = self.episodes[i]
            infos = self._add_info(infos, {"parameters": dict(episode.parameters), "goal": dict(episode.goal)}, i)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """Release the engines."""
        self.worlds.close()
