"""A stock learner (PPO of stable-baselines3) teaches the soft arm to reach: pip install 'asrsim[gym]' stable-baselines3

    python examples/learn_reach.py [STEPS] [FOLDER]

It draws the curve of learning (distance of the tip from its goal at the end of an episode, untrained and trained) and a
picture of the trained arm at a goal.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from asrsim.environment.env import State
from asrsim.environment.reach import distance, make_reach

EPISODES = 20
STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
FOLDER = Path(sys.argv[2] if len(sys.argv) > 2 else "out/learn_reach")


class Watched:
    """Ends of episodes under a policy, in mm from the goal."""

    def __init__(self, envs: VecNormalize) -> None:
        self.envs, self.last = envs, np.nan
        self.env = make_reach(terminated=self._look, render_mode="rgb_array")

    def _look(self, state: State) -> bool:
        self.last = distance(state)
        return False

    def ends(self, policy: PPO) -> list[float]:
        """Of the same episodes every time."""
        found = []
        for seed in range(EPISODES):
            observation, _ = self.env.reset(seed=1000 + seed)
            over = False
            while not over:
                action, _ = policy.predict(self.envs.normalize_obs(observation), deterministic=True)
                observation, _, ended, truncated, _ = self.env.step(action)
                over = ended or truncated
            found.append(1e3 * self.last)
        return found


def main() -> None:
    """Learn in ten parts and look after each."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    FOLDER.mkdir(parents=True, exist_ok=True)
    envs = VecNormalize(make_vec_env("asrsim/Reach-v0", n_envs=4, seed=0), gamma=0.95)
    policy = PPO(
        "MlpPolicy", envs, n_steps=256, batch_size=256, gamma=0.95, seed=0,
        learning_rate=1e-3, policy_kwargs={"net_arch": [64, 64]}, device="cpu",
    )  # fmt: skip
    watched, began = Watched(envs), time.perf_counter()
    curve = [(0, watched.ends(policy))]
    for _ in range(10):
        policy.learn(STEPS // 10, reset_num_timesteps=False)
        curve.append((policy.num_timesteps, watched.ends(policy)))
        steps, ends = curve[-1]
        print(f"{steps:7d} steps, {time.perf_counter() - began:4.0f} s: {np.median(ends):.1f} mm from the goal (median)")
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    steps = [count for count, _ in curve]
    axes.plot(steps, [np.median(ends) for _, ends in curve], marker="o", label="median")
    axes.fill_between(steps, *np.quantile([ends for _, ends in curve], (0.1, 0.9), axis=1), alpha=0.25, label="10 to 90 %")
    axes.set(xlabel="control steps", ylabel="tip from its goal at the end, mm", ylim=(0, None))
    axes.legend()
    figure.savefig(FOLDER / "curve.png", dpi=120)
    plt.imsave(FOLDER / "arm.png", watched.env.render())


if __name__ == "__main__":
    main()
