"""A lab whose runs are short: figures of the paper with all their steps, in seconds. Their claims need not hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from asrsim.reproduce.lab import Lab
from asrsim.scenario.data import Scenario

CHIRP = "references.joint_1.equilibrium_position.chirp.duration"
POSES = (
    "[{time: 0, position: [.3, -.01, .1565]}, {time: .04, position: [.3, -.01, .1565]}, {time: .16, position: [.3, .1, .1565]}]"
)
SHORT = {
    "step_1dof": ["duration=0.3"],
    "chirp_1dof": ["duration=1", f"{CHIRP}=1"],
    "sine_2dof": ["duration=0.5"],
    "step_2dof": ["duration=0.3"],
    "box_push": ["duration=0.2", f"task.poses={POSES}", "initial={joint_1: -0.8648, joint_4: 1.415, joint_5: -1.191}"],
    "ilc_2dof": ["duration=0.5", "ilc.max_iterations=3", "ilc.tolerance=0.001"],
}
"""What is set of scenarios whose names begin so, where a figure sets no duration of its own."""


class ShortLab(Lab):
    """Where figures run for a moment."""

    def scenario(self, name: str, variant: str | None = None, overrides: Sequence[str] = ()) -> Scenario:
        """The scenario, cut."""
        own = any(one.startswith("duration=") for one in overrides)
        more = next(given for start, given in SHORT.items() if name.startswith(start))
        # A step of its own asks for a duration that fits.
        more = more[1:] if own and any(one.startswith("step=") for one in overrides) else more
        return replace(super().scenario(name, variant, [*overrides, "engine=mujoco", *more]), expect=())
