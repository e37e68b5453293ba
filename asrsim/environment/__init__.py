"""Environments for learning (Gymnasium): a scenario as an environment, and example tasks; needs the extra `gym`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asrsim.extras import library

if TYPE_CHECKING:
    from asrsim.environment.env import SoftRobotEnv
    from asrsim.environment.task import State
    from asrsim.environment.vector import SoftRobotVectorEnv
    from asrsim.scenario.data import Scenario

OBSERVED = ("link_position", "link_velocity")


def make_env(
    scenario: str | Path | Scenario,
    *,
    variant: str | None = None,
    overrides: Any = (),
    control_rate: float = 50.0,
    observe: Sequence[str] = OBSERVED,
    act: Sequence[str] = (),
    reward: Callable[[State], float] | None = None,
    terminated: Callable[[State], bool] | None = None,
    randomise: Mapping[str, Any] | None = None,
    initial: Mapping[str, Any] | None = None,
    goal: Mapping[str, Any] | None = None,
    tip: tuple[str, Sequence[float]] | None = None,
    render_mode: str | None = None,
    size: int = 256,
) -> SoftRobotEnv:
    """A scenario as a Gymnasium environment. An episode lasts the scenario's duration; then it is truncated.

    Args:
        scenario: File, or a scenario that was loaded; variant, overrides: as :func:`asrsim.run` takes them.
        control_rate: Hz of actions; a whole number of steps lies between two.
        observe: Quantities, each of all joints that have it, in the order of the joints: those of
            :data:`asrsim.quantities.QUANTITIES` but works, energies and losses; and `tip`, (3,) m.
        act: References that actions set: names of the joints' modes, or `joint.name`; none: the first one of every joint.
            An action is in [-1, 1] and goes through the reference's range (`reference_ranges`, else the robot's limits).
        reward: Of the state after each action; none: 0.
        terminated: Whether the episode is over, of the same state.
        randomise: Key (`key & key`: tied) -> law as `asrsim sweep --over` takes them, drawn at every reset: of numbers that
            need no new reading (parameters, damping, masses, constant references).
        initial: Joint -> law of its position at the start, rad or m.
        goal: Name -> law, drawn at every reset; the values stand at the end of the observation.
        tip: Link and point on it (m) whose position in the world is wanted.
        render_mode: `rgb_array` or none; size: of its pictures in pixels.

    Raises:
        InputError: gymnasium is not installed, or something named does not exist.
        ScenarioError, RobotError: as :func:`asrsim.run`.
    """
    library("gymnasium", "gym")
    from asrsim.environment.env import SoftRobotEnv

    return SoftRobotEnv(
        scenario, variant=variant, overrides=overrides, render_mode=render_mode, size=size,
        **_options(control_rate, observe, act, reward, terminated, randomise, initial, goal, tip),
    )  # fmt: skip


def make_vec_env(
    scenario: str | Path | Scenario,
    num_envs: int,
    *,
    variant: str | None = None,
    overrides: Any = (),
    control_rate: float = 50.0,
    observe: Sequence[str] = OBSERVED,
    act: Sequence[str] = (),
    reward: Callable[[State], float] | None = None,
    terminated: Callable[[State], bool] | None = None,
    randomise: Mapping[str, Any] | None = None,
    initial: Mapping[str, Any] | None = None,
    goal: Mapping[str, Any] | None = None,
    tip: tuple[str, Sequence[float]] | None = None,
    threads: int = 1,
) -> SoftRobotVectorEnv:
    """Many environments of a scenario that are stepped together (`gymnasium.vector.VectorEnv`), several times faster than one
    after the other. An episode that is over begins anew at the next step.

    Args:
        scenario: File, or a scenario that was loaded.
        num_envs: Number of environments.
        threads: Threads that share them where the engine has native code.

    Other arguments and errors as of :func:`make_env`; `reward` and `terminated` are asked for each environment.
    """
    library("gymnasium", "gym")
    from asrsim.environment.vector import SoftRobotVectorEnv

    return SoftRobotVectorEnv(
        scenario, num_envs=num_envs, threads=threads, variant=variant, overrides=overrides,
        **_options(control_rate, observe, act, reward, terminated, randomise, initial, goal, tip),
    )  # fmt: skip


def _options(
    control_rate: Any, observe: Any, act: Any, reward: Any, terminated: Any, randomise: Any, initial: Any, goal: Any, tip: Any
) -> dict[str, Any]:
    from asrsim.environment.options import check_options

    options: dict[str, Any] = {
        "control_rate": control_rate, "observe": observe, "act": act, "reward": reward, "terminated": terminated,
        "randomise": {} if randomise is None else randomise, "initial": {} if initial is None else initial,
        "goal": {} if goal is None else goal, "tip": tip,
    }  # fmt: skip
    check_options(options)
    return options


def register() -> None:
    """Make our environments known to Gymnasium; importing this module does so. Without Gymnasium there is nothing to do."""
    try:
        import gymnasium
    except ImportError:
        return
    for name, entry in (("Scenario", "asrsim.environment:make_env"), ("Reach", "asrsim.environment.reach:make_reach")):
        if f"asrsim/{name}-v0" not in gymnasium.registry:
            gymnasium.register(id=f"asrsim/{name}-v0", entry_point=entry)


register()

__all__ = ["OBSERVED", "make_env", "make_vec_env", "register"]
