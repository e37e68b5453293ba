"""Environments for learning (Gymnasium): a scenario as an environment; needs the extra `gym`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from asrsim.extras import library

if TYPE_CHECKING:
    from asrsim.environment.env import SoftRobotEnv
    from asrsim.environment.options import Options
    from asrsim.environment.vector import SoftRobotVectorEnv
    from asrsim.scenario.data import Scenario


def make_env(
    scenario: str | Path | Scenario, *, render_mode: str | None = None, size: int = 256, **options: Unpack[Options]
) -> SoftRobotEnv:
    """A scenario as a Gymnasium environment. An episode lasts the scenario's duration; then it is truncated.

    Args:
        scenario: File, or a scenario that was loaded; variant, overrides: as :func:`asrsim.run` takes them.
        render_mode: `rgb_array` or None; size: of its pictures in pixels.
        options: As follows, by name.
        control_rate: Hz of actions; the period is a whole number of steps. Default 50.
        observe: Quantities, each of all joints that have it, in the order of the joints: those of
            :data:`asrsim.quantities.QUANTITIES` but works, energies and losses; and `tip`, (3,) m. Default: position and
            velocity of the links.
        act: References that actions set: names of the joints' modes, or `joint.name`; none: the first one of every joint.
            An action is in [-1, 1] and is scaled to the reference's range (`reference_ranges`, else the robot's limits).
        reward: Function of the state after each action; none: 0.
        terminated: Function of the same state: whether the episode is over.
        randomise: Key (`key & key`: tied) -> law as `asrsim sweep --over` takes them, drawn at every reset: for numbers that
            need no new reading of the scenario (parameters, damping, masses, constant references).
        initial: Joint -> law of its position at the start, rad or m.
        goal: Name -> law, drawn at every reset; the values stand at the end of the observation.
        tip: Link, and point on it (m) whose position in the world is observed.

    Raises:
        InputError: gymnasium is not installed, or an option is unknown or wrong.
        ScenarioError, RobotError: as :func:`asrsim.run`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.env import SoftRobotEnv
    from asrsim.environment.options import checked

    return SoftRobotEnv(scenario, checked(options), render_mode=render_mode, size=size)


def make_vec_env(
    scenario: str | Path | Scenario, num_envs: int, *, threads: int = 1, **options: Unpack[Options]
) -> SoftRobotVectorEnv:
    """Many environments of a scenario that are stepped together (`gymnasium.vector.VectorEnv`), several times faster than one
    after the other. An episode that is over begins anew at the next step.

    Args:
        scenario: File, or a scenario that was loaded.
        num_envs: Number of environments.
        threads: Threads that share them where the engine has native code.
        options: As of :func:`make_env`; `reward` and `terminated` are called for each environment.

    Raises:
        InputError, ScenarioError, RobotError: as :func:`make_env`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.options import checked
    from asrsim.environment.vector import SoftRobotVectorEnv

    return SoftRobotVectorEnv(scenario, checked(options), num_envs=num_envs, threads=threads)


def register() -> None:
    """Register `asrsim/Scenario-v0` with Gymnasium; importing this module does so. Without Gymnasium nothing happens."""
    try:
        import gymnasium
    except ImportError:
        return
    if "asrsim/Scenario-v0" not in gymnasium.registry:
        gymnasium.register(id="asrsim/Scenario-v0", entry_point="asrsim.environment:make_env")


register()

__all__ = ["make_env", "make_vec_env", "register"]
