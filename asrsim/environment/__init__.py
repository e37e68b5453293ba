"""Gymnasium environments for reinforcement learning, made from scenarios. They need the extra `gym`."""

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
    """A Gymnasium environment of a scenario. An episode is truncated after the scenario's duration.

    Args:
        scenario: Scenario file, or a loaded scenario.
        render_mode: `rgb_array` or None.
        size: Edge of the pictures in pixels.
        options: The keyword arguments below.
        variant: Name of a variant of the scenario, as in `asrsim.run`.
        overrides: Changes to values of the scenario, as in `asrsim.run`.
        plugins: Python files with users' actuators, signals and so on, as in `asrsim.run`.
        control_rate: Rate of the actions in Hz; the control period must be a whole number of steps. Default 50.
        observe: Quantities to observe, for all joints that have them, in the order of the joints: any quantity of
            `asrsim.quantities.QUANTITIES` except works, energies and losses; and `tip`, (3,) m. Default: position and
            velocity of the links.
        act: References that the actions set, as `name` or `joint.name`. Default: the first reference of every joint.
            Actions are in [-1, 1] and are scaled to the range of the reference (`reference_ranges`, else the robot's limits).
        reward: Function that returns the reward for the state after each action. Default: the reward is 0.
        terminated: Function of the state after each action that returns whether the episode is over.
        randomise: Laws by key, as in `asrsim sweep --over`, drawn at every reset. `key & key`: both keys get the same value.
            Allowed are values that do not require reading the scenario again: parameters, damping, masses, constant references.
        initial: Laws of the start positions by joint, in rad or m.
        goal: Laws of goal values by name, drawn at every reset. The values are the last entries of the observation.
        tip: Name of a link, and a point on it in m. The position of this point in the world can be observed as `tip`.

    Raises:
        InputError: gymnasium is not installed, or an option is unknown or wrong.
        ScenarioError, RobotError: as `asrsim.run`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.env import SoftRobotEnv
    from asrsim.environment.options import checked

    return SoftRobotEnv(scenario, checked(options), render_mode=render_mode, size=size)


def make_vec_env(
    scenario: str | Path | Scenario, num_envs: int, *, threads: int = 1, engine: str | None = None, device: str = "cpu",
    **options: Unpack[Options],
) -> SoftRobotVectorEnv:  # fmt: skip
    """Many environments of one scenario that are stepped together (`gymnasium.vector.VectorEnv`), several times faster than
    separate environments. An environment whose episode is over is reset at the next step.

    Args:
        scenario: Scenario file, or a loaded scenario.
        num_envs: Number of environments.
        threads: Number of threads that step the environments, if the engine has a compiled step.
        engine, device: As in `asrsim.Worlds`: with the engine `mujoco_warp`, the worlds are on a device of Warp.
        options: As in `make_env`; `reward` and `terminated` are called for each environment.

    Raises:
        InputError, ScenarioError, RobotError: as `make_env`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.options import checked
    from asrsim.environment.vector import SoftRobotVectorEnv

    return SoftRobotVectorEnv(scenario, checked(options), num_envs=num_envs, threads=threads, engine=engine, device=device)


def register() -> None:
    """Register `asrsim/Scenario-v0` with Gymnasium if Gymnasium is installed; importing this module calls this function."""
    try:
        import gymnasium
    except ImportError:
        return
    if "asrsim/Scenario-v0" not in gymnasium.registry:
        gymnasium.register(id="asrsim/Scenario-v0", entry_point="asrsim.environment:make_env")


register()

__all__ = ["make_env", "make_vec_env", "register"]
