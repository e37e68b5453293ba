"""Vectorised environment: many environments of one task that are stepped together."""

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
from asrsim.simulation.start import Start
from asrsim.simulation.worlds import Worlds, check_number

LARGEST = 8192
"""Largest allowed edge of a picture in pixels."""
AUTORESET = {"next_step": AutoresetMode.NEXT_STEP, "same_step": AutoresetMode.SAME_STEP}
"""Time at which an environment whose episode is over is reset, by value of the option `autoreset`."""


class SoftRobotVectorEnv(VectorEnv[Single, Single, Any]):
    """The environments that `asrsim.environment.make_vec_env` returns. Environment i gives the same bits as a single
    environment with the same seed.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(
        self,
        scenario: Any,
        options: Mapping[str, Any],
        *,
        num_envs: int,
        threads: int,
        engine: str | None = None,
        device: str = "cpu",
        render_mode: str | None = None,
        size: int = 256,
        autoreset: str = "next_step",
    ) -> None:
        """Arguments as in `asrsim.environment.make_vec_env`."""
        self._make = partial(
            type(self),
            scenario,
            options,
            num_envs=num_envs,
            threads=threads,
            engine=engine,
            device=device,
            render_mode=render_mode,
            size=size,
            autoreset=autoreset,
        )
        check_number(num_envs, "num_envs")
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"there is no render mode '{render_mode}'", choices=("rgb_array",), code="render-mode")
        if not (isinstance(size, int) and not isinstance(size, bool) and 1 <= size <= LARGEST):
            raise InputError(f"the size of a picture must be 1 to {LARGEST} pixels", value=size, code="picture-size")
        if autoreset not in AUTORESET:
            raise InputError("is unknown", key="autoreset", value=autoreset, choices=tuple(AUTORESET), code="autoreset")
        self.render_mode, self._size = render_mode, size
        self._picture: Any = None
        self._same_step = AUTORESET[autoreset] == AutoresetMode.SAME_STEP
        self.task = task = ControlTask(scenario, options, engine=engine)
        self.metadata = {
            **self.metadata,
            "autoreset_mode": AUTORESET[autoreset],
            "render_fps": max(1, round(options["control_rate"])),
        }
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
            adaptive=options["adaptive"],
        )
        self._readings = task.readings(self.worlds)
        self.single_observation_space, self.single_action_space = task.spaces(self._readings)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._chances: list[np.random.Generator] = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self.episodes = [Episode()] * num_envs
        """Random values of the present episode of each environment."""
        self._counts = np.zeros(num_envs, dtype=int)
        self._over = np.zeros(num_envs, dtype=bool)
        """Mask (n,) of the environments that the next step resets, because their episodes are over."""
        self._goals = np.zeros((num_envs, task.goals))
        actions = len(task.actions)
        self._late = task.longest_delay
        self._sent = np.zeros((num_envs, self._late + 1, actions))
        """Latest actions of each environment as references in SI units, the newest first."""
        self._delays = np.zeros(num_envs, dtype=int)
        self._spread = {name: deviation for name, deviation in task.noise.items() if deviation}
        self._seen = np.zeros((num_envs, task.history + 1, len(self._readings.bounds()[0])))
        """Observed values (N, history + 1, n) of the latest control periods; the newest values are the first."""
        self._done = np.zeros((num_envs, task.history, actions))
        """Actions of earlier control periods, the newest first; 0 is the middle of a range."""
        self._shown: Single = np.zeros(self.observation_space.shape or (), np.float32)
        """Latest observation of each environment."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle support: the copy is a new set of environments made with the same arguments."""
        return self._make, ()

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Single, dict[str, Any]]:
        """Begin new episodes with new random values. seed: one seed for each environment, or a seed for environment 0, where
        environment i gets seed + i. options: `reset_mask` (n,) selects the environments to reset; by default, all are reset.
        """
        mask = np.ones(self.num_envs, dtype=bool) if options is None else np.asarray(options.get("reset_mask", True))
        if mask.shape not in ((), (self.num_envs,)):
            raise InputError(f"must be {self.num_envs} flags", key="reset_mask", value=mask, code="worlds")
        mask = np.broadcast_to(mask, self.num_envs).astype(bool)
        if seed is not None:
            seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else list(seed)
            if len(seeds) != self.num_envs:
                raise InputError(f"needs {self.num_envs} seeds", key="seed", value=len(seeds), code="seed")
            for i in np.flatnonzero(mask).tolist():
                if seeds[i] is not None:
                    self._chances[i] = seeding.np_random(seeds[i])[0]
        self._begin(mask)
        return self._observation(self._readings.read(), mask, moved=False), self._infos(mask)

    def _begin(self, mask: NDArray[np.bool_]) -> None:
        task, numbers = self.task, np.flatnonzero(mask).tolist()
        for i in numbers:
            self.episodes[i] = task.draw(self._chances[i])
            self._goals[i] = list(self.episodes[i].goal.values())
            self._delays[i] = self.episodes[i].delay
        starts = [Start(parameters=task.changes(self.episodes[i]), positions=self.episodes[i].start) for i in numbers]
        self.worlds.reset(starts, worlds=mask)
        for i in numbers:
            for joint, reference, value in task.references(self.episodes[i]):
                self.worlds.set_reference(joint, reference, value, worlds=[i])
        self._counts[mask], self._over[mask] = 0, False

    def step(self, actions: Any) -> tuple[Single, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Apply one action to each environment for one control period. An environment whose episode is over is reset
        instead."""
        try:
            given = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError("must be numbers", key="actions", value=actions, code="action") from error
        if len(given) != self.num_envs:
            raise InputError(f"needs {self.num_envs} actions", key="actions", value=len(given), code="action")
        task, worlds, values = self.task, self.worlds, self.task.values_of(given)
        going, fresh = ~self._over, self._over.copy()
        # None means all worlds, and is faster than an array of indices or a mask.
        which, everyone = None, list(range(self.num_envs))
        if np.count_nonzero(fresh):
            self._begin(fresh)
            which, everyone = going, np.flatnonzero(going).tolist()
        acts = which
        if self._late:
            self._sent = np.concatenate([values[:, None], self._sent[:, :-1]], axis=1)
            # Until the first action has passed its delay, the scenario's own references act.
            acting = going & (self._counts >= self._delays)
            acts = None if acting.all() else acting
            values = self._sent[np.arange(self.num_envs), self._delays]
        for (joint, reference), column in zip(task.actions, (values if acts is None else values[acts]).T, strict=True):
            worlds.set_reference(joint, reference, column.item() if len(column) == 1 else column, worlds=acts)
        worlds.advance(task.steps, worlds=which)
        self._counts += going
        found = self._readings.read()
        rewards, ended = np.zeros(self.num_envs), ~worlds.healthy
        if task.batched and task.judges:
            goals = dict(zip(task.goal_names, self._goals.T, strict=True))
            found_rewards, over_now = task.judge_all(State(worlds.time, found, goals, given))
            rewards[going], ended[going] = found_rewards[going], ended[going] | over_now[going]
        alone = task.judges and not task.batched
        times = worlds.time.tolist() if alone else ()
        for i in everyone if alone else ():
            own = {name: table[i] for name, table in found.items()}
            state = State(times[i], own, self.episodes[i].goal, given[i])
            rewards[i], over = task.judge(state)
            ended[i] |= over
        truncated = (self._counts >= task.last) & ~ended & going
        ended &= going
        self._over = ended | truncated
        if task.history:
            self._done = np.concatenate([given[:, None], self._done[:, :-1]], axis=1)
        seen = self._observation(found, fresh, moved=True)
        if not (self._same_step and self._over.any()):
            return seen, rewards, ended, truncated, self._infos(fresh)
        last = self._over.copy()
        infos: dict[str, Any] = {}
        for i in np.flatnonzero(last).tolist():
            infos = self._add_info(infos, {"final_obs": seen[i], "final_info": {}}, i)
        self._begin(last)
        seen = self._observation(self._readings.read(), last, moved=False)
        return seen, rewards, ended, truncated, self._infos(last, infos)

    def render(self) -> Any:
        """Pictures of all environments: a tuple of arrays (size, size, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            from asrsim.environment.picture import Picture

            self._picture = Picture(self.worlds, self._size)
        return tuple(self._picture.image(i) for i in range(self.num_envs))

    def _observation(self, found: dict[str, Array], fresh: NDArray[np.bool_], *, moved: bool) -> Single:
        """Observations (N, n) from the values in `found`. fresh: environments whose episodes have just begun; moved: whether
        the other environments have moved for a control period. If these environments have not moved, they keep their latest
        observations, and no noise is drawn for them.
        """
        if self._spread:
            drawn = range(self.num_envs) if moved else np.flatnonzero(fresh).tolist()
            found = {name: self._noisy(name, values, drawn) for name, values in found.items()}
        parts, past = [*found.values(), self._goals], self.task.history
        if past:
            now = np.concatenate(parts[:-1], axis=1)
            if moved:
                self._seen = np.concatenate([now[:, None], self._seen[:, :-1]], axis=1)
            # At the start of an episode, the history contains the first observation repeatedly, and actions in the middle of
            # their range, which are 0.
            self._seen[fresh], self._done[fresh] = now[fresh, None], 0.0
            parts += [self._seen[:, 1:].reshape(self.num_envs, -1), self._done.reshape(self.num_envs, -1)]
        shown = np.concatenate(parts, axis=1, dtype=np.float32, casting="same_kind")
        self._shown = shown if moved else np.where(fresh[:, None], shown, self._shown)
        return self._shown

    def _noisy(self, name: str, values: Array, drawn: Sequence[int]) -> Array:
        """Values (N, n) of a quantity, with new noise in the environments `drawn`."""
        deviation = self._spread.get(name)
        if deviation is None:
            return values
        noise = np.zeros_like(values)
        for i in drawn:
            noise[i] = self._chances[i].standard_normal(values.shape[1])
        return values + deviation * noise

    def _infos(self, fresh: NDArray[np.bool_], infos: dict[str, Any] | None = None) -> dict[str, Any]:
        """Random values of the episodes that have just begun, in the format of Gymnasium's infos for vector environments."""
        infos = infos or {}
        if not np.count_nonzero(fresh) or not self.task.draws:
            return infos
        for i in np.flatnonzero(fresh).tolist():
            episode = self.episodes[i]
            infos = self._add_info(infos, {"parameters": dict(episode.parameters), "goal": dict(episode.goal)}, i)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """Release the engines."""
        self.worlds.close()
