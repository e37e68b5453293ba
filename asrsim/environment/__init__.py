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
        render_mode: `rgb_array` for pictures, or None.
        size: Edge of the pictures in pixels.
        options: The keyword arguments below.
        variant: Name of a variant of the scenario, as in `asrsim.run`.
        overrides: Changes to values of the scenario, as in `asrsim.run`.
        plugins: Python files with users' actuators, signals and so on, as in `asrsim.run`.
        control_rate: Rate of the actions in Hz; the control period must be a whole number of steps. Default 50.
        observe: Quantities to observe, for all joints that have them, in the order of the joints: any quantity of
            `asrsim.quantities.QUANTITIES` except works, energies and losses; and `tip`, (3,) m. Default: position and
            velocity of the links.
        act: References that the actions set, as `name` or `joint.name`, and `external_torque` if `reference_ranges` declares
            its range. Default: the first reference of every joint.
            Actions are in [-1, 1] and are scaled to the range of the reference (`reference_ranges`, else the robot's limits).
        reward: Function that returns the reward for the state after each action. Default: the reward is 0.
        terminated: Function that returns whether the episode is over, for the state after each action. Without it,
            an episode is terminated only if the simulation diverges.
        batched: Whether `reward` and `terminated` take the states of all N environments at once (arrays with N as their first
            axis), and return arrays (N,). This is much faster for many environments.
        adaptive: Whether each environment takes fewer substeps while its springs are soft enough, as in `asrsim.Worlds`; such
            environments are up to twice as fast, and differ from runs within the error of the step. While references of the
            scenario itself jump, the environments take all substeps.
        randomise: Law (values, range or distribution) of each key, as in `asrsim sweep --over`; a value is drawn from each law
            at every reset. `key & key`: the two keys get the same value.
            Allowed are values that do not require reading the scenario again: parameters, damping, masses, constant references,
            and the delays `imperfections.sensors.JOINT.delay` and `imperfections.commands.JOINT.delay`, whose laws have an
            upper bound (the option `delay` delays actions).
        fit: `fit.json` of `asrsim identify`: at every reset the fitted parameters are drawn from the fit's covariance.
        push: Laws of the external torques on joints, in N m. A torque is drawn at every reset, and acts during the whole
            episode.
        delay: Delay of the actions in s, or a law of this delay, drawn at every reset and rounded to control periods.
        noise: Standard deviation of the noise of each observed quantity, by name, in the unit of the quantity. The noise does
            not affect rewards.
        history: Number of earlier control periods whose observed values and actions belong to an observation, after the goal.
        initial: Laws of the initial positions by joint, in rad or m.
        goal: Laws of goal values by name, drawn at every reset. The values are the last entries of the observation.
        tip: Name of a link, and a point on it in m. The position of this point in the world can be observed as `tip`.

    Raises:
        InputError: gymnasium is not installed, or an option is unknown or wrong.
        ScenarioError, RobotError: As in `asrsim.run`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.env import SoftRobotEnv
    from asrsim.environment.options import checked

    return SoftRobotEnv(scenario, checked(options), render_mode=render_mode, size=size)


def make_vec_env(
    scenario: str | Path | Scenario,
    num_envs: int,
    *,
    threads: int = 1,
    engine: str | None = None,
    device: str = "cpu",
    render_mode: str | None = None,
    size: int = 256,
    autoreset: str = "next_step",
    **options: Unpack[Options],
) -> SoftRobotVectorEnv:
    """Many environments of one scenario that are stepped together (`gymnasium.vector.VectorEnv`), several times faster than
    separate environments.

    Args:
        scenario: Scenario file, or a loaded scenario.
        num_envs: Number of environments.
        threads: Number of threads that step the environments, if the engine has a compiled step.
        engine, device: As in `asrsim.Worlds`. With the engine `mujoco_warp`, the worlds are on a device of Warp.
        render_mode, size: As in `make_env`: `render` returns a tuple of pictures, which `gymnasium.wrappers.vector.RecordVideo`
            records.
        autoreset: `next_step`: an environment whose episode is over is reset at the next step, which ignores its action;
            `same_step`: the environment is reset at once, and the infos contain its last observation as `final_obs`.
        options: As in `make_env`; `reward` and `terminated` are called for each environment, unless `batched` is set.

    Raises:
        InputError, ScenarioError, RobotError: As in `make_env`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.options import checked
    from asrsim.environment.vector import SoftRobotVectorEnv

    return SoftRobotVectorEnv(
        scenario,
        checked(options),
        num_envs=num_envs,
        threads=threads,
        engine=engine,
        device=device,
        render_mode=render_mode,
        size=size,
        autoreset=autoreset,
    )


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
