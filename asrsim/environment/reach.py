"""The example task: a soft arm of two qbMoves brings its tip to a point of the plane, and may choose its stiffness."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from asrsim.environment.env import SoftRobotEnv
    from asrsim.environment.task import State

TIP = (0.115, 0.0, 0.0)
"""m, on the last link."""
NEAR = 0.01
"""m from the goal within which there is a bonus."""


def distance(state: State) -> float:
    """m of the tip from the goal, in the plane."""
    tip = state.values["tip"]
    return math.hypot(float(tip[0]) - state.goal["x"], float(tip[1]) - state.goal["y"])


def reward(state: State) -> float:
    """Nearer is better, at once and in the end; haste costs a little."""
    off = distance(state)
    speed = float(np.sum(np.square(state.values["link_velocity"])))
    return -10.0 * off - 0.002 * speed + (1.0 if off < NEAR else 0.0)


def make_reach(**options: Any) -> SoftRobotEnv:
    """The environment; options as :func:`asrsim.environment.make_env` takes them."""
    from asrsim.environment import make_env
    from asrsim.runs.examples import examples_folder
    from asrsim.scenario import make_scenario

    scenario = make_scenario(
        examples_folder() / "urdf" / "dof2_horizontal.urdf",
        name="reach",
        duration=1.0,
        # Nothing touches here, and this engine is many times faster.
        engine="mujoco",
        references={"*": {"equilibrium_position": 0.0, "stiffness_preset": 0.2}},
        reference_ranges={"*": {"equilibrium_position": [-1.5, 1.5], "stiffness_preset": [0.05, 0.4]}},
    )
    settings: dict[str, Any] = {
        "control_rate": 50.0,
        "observe": ("link_position", "link_velocity", "tip"),
        "act": ("equilibrium_position",),
        "reward": reward,
        # Within reach: the tip is 0.152 to 0.205 m from the first axis.
        "goal": {"x": "uniform(0.085, 0.12)", "y": "uniform(0.13, 0.155)"},
        "tip": ("link_2", TIP),
    }
    return make_env(scenario, **{**settings, **options})
