"""Train a soft arm to reach a goal with PPO from stable-baselines3: pip install 'asrsim[gym]' stable-baselines3

    python examples/learn_reach.py [STEPS] [FOLDER]

The script draws the learning curve (distance between tip and goal at the end of an episode, before and during training)
and a film of the trained arm, which reaches several goals.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

import asrsim
from asrsim.environment.env import SoftRobotEnv
from asrsim.environment.task import State

EPISODES, LOOKS, FILMED = 20, 10, 4
STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 60_000
FOLDER = Path(sys.argv[2] if len(sys.argv) > 2 else "out/learn_reach")
TIP = (0.115, 0.0, 0.0)
"""Position of the tip in the frame of the last link, m."""
NEAR = 0.01
"""Distance from the goal within which the reward has a bonus, m."""


def distance(state: State) -> float:
    """Distance between tip and goal in the plane, m."""
    tip = state.values["tip"]
    return math.hypot(float(tip[0]) - state.goal["x"], float(tip[1]) - state.goal["y"])


def reward(state: State) -> float:
    """Reward of a control step: it falls with the distance from the goal and, slightly, with the speed."""
    off = distance(state)
    speed = float(np.sum(np.square(state.values["link_velocity"])))
    return -10.0 * off - 0.002 * speed + (1.0 if off < NEAR else 0.0)


def make_reach(**options: Any) -> SoftRobotEnv:
    """Environment in which a soft arm of two qbMoves moves its tip to a point of the plane."""
    scenario = asrsim.make_scenario(
        Path(__file__).parent / "urdf" / "dof2_horizontal.urdf",
        name="reach",
        duration=1.0,
        # Without contacts, MuJoCo is many times faster than PyBullet.
        engine="mujoco",
        references={"*": {"equilibrium_position": 0.0, "stiffness_preset": 0.2}},
        reference_ranges={"*": {"equilibrium_position": [-1.5, 1.5], "stiffness_preset": [0.05, 0.4]}},
    )
    settings: dict[str, Any] = {
        "observe": ("link_position", "link_velocity", "tip"),
        "act": ("equilibrium_position",),
        "reward": reward,
        # These goals are within reach: the distance of the tip from the first axis is 0.152 to 0.205 m.
        "goal": {"x": "uniform(0.085, 0.12)", "y": "uniform(0.13, 0.155)"},
        "tip": ("link_2", TIP),
    }
    return asrsim.make_env(scenario, **{**settings, **options})


class Watched(BaseCallback):
    """Callback that measures from time to time how far from the goal the episodes of the policy end."""

    def __init__(self, envs: VecNormalize) -> None:
        super().__init__()
        self.envs, self.last, self.began = envs, np.nan, time.perf_counter()
        self.env = make_reach(terminated=self._note, render_mode="rgb_array")
        self.curve: list[tuple[int, list[float]]] = []
        """Number of control steps, and distance from the goal at the end of each episode, mm."""

    def _on_training_start(self) -> None:
        self._look()

    def _on_rollout_end(self) -> None:
        if self.num_timesteps >= len(self.curve) * STEPS / LOOKS:
            self._look()

    def _on_training_end(self) -> None:
        self._look()

    def _look(self) -> None:
        steps, ends = self.num_timesteps, self.ends()
        self.curve.append((steps, ends))
        taken = time.perf_counter() - self.began
        print(f"{steps:7d} steps, {taken:4.0f} s: {np.median(ends):.1f} mm from the goal (median)", flush=True)

    def _on_step(self) -> bool:
        return True

    def _note(self, state: State) -> bool:
        self.last = distance(state)
        return False

    def film(self, path: Path) -> None:
        """Film of the policy at some goals, at the speed of the robot."""
        frames = [self.env.render() for number in range(FILMED) for _ in self.played(number)]
        pictures = [Image.fromarray(frame).quantize(64, dither=Image.Dither.NONE) for frame in frames[::2]]
        pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=40, loop=0)

    def ends(self) -> list[float]:
        """Distances from the goal at the end of each test episode, mm; the test episodes never change."""
        found = []
        for number in range(EPISODES):
            for _ in self.played(number):
                pass
            found.append(1e3 * self.last)
        return found

    def played(self, number: int) -> Iterator[int]:
        """Play a test episode with the policy, one control step at a time; the numbers of the steps."""
        observation, _ = self.env.reset(seed=1000 + number)
        for step in count():
            action, _ = self.model.predict(self.envs.normalize_obs(observation), deterministic=True)
            observation, _, ended, truncated, _ = self.env.step(action)
            yield step
            if ended or truncated:
                return


def main() -> None:
    """Train the policy, and draw the learning curve."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    FOLDER.mkdir(parents=True, exist_ok=True)
    # More threads make networks of this size slower.
    torch.set_num_threads(1)
    envs = VecNormalize(make_vec_env(make_reach, n_envs=4, seed=0), gamma=0.95)
    policy = PPO(
        "MlpPolicy", envs, n_steps=256, batch_size=256, gamma=0.95, seed=0, learning_rate=lambda left: 1e-3 * max(left, 0.0),
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.0}, device="cpu",
    )  # fmt: skip
    watched = Watched(envs)
    policy.learn(STEPS, callback=watched)
    curve = watched.curve
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    steps = [number for number, _ in curve]
    axes.plot(steps, [np.median(ends) for _, ends in curve], marker="o", label="median")
    axes.fill_between(steps, *np.quantile([ends for _, ends in curve], (0.1, 0.9), axis=1), alpha=0.25, label="10 to 90 %")
    axes.set(xlabel="control steps", ylabel="tip from its goal at the end, mm", ylim=(0, None))
    axes.legend()
    figure.savefig(FOLDER / "curve.png", dpi=120)
    watched.film(FOLDER / "film.gif")
    print(f"{time.process_time():.0f} s of processor time in total")


if __name__ == "__main__":
    main()
