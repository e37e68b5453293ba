"""Viscous damping of the links, which a substep treats implicitly."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.scenario.data import LinkDamping
from validation.models import INSTALLED, Body, chain, column, run

STEP, INERTIA = 1e-3, 0.01


def shares(decay: float, *, stepping: str = "leapfrog", engine: str = "mujoco") -> np.ndarray:
    """Ratio of the velocities after and before each step of a link with damping alone. decay: c h / I."""
    body = Body(actuator="sea", mass=1e-9, reach=0.0, inertia=INERTIA, damping=decay * INERTIA / STEP)
    result = run(
        chain(body), mode=0, gravity=0.0, duration=0.02, engine=engine, stepping=stepping, substeps=1,
        initial_velocities={"joint_1": 1.0},
    )  # fmt: skip
    way = np.diff(column(result, "link_position"))
    return np.asarray(way[2:8] / way[1:7])


@pytest.mark.parametrize("engine", INSTALLED)
def test_weak_damping_acts_on_the_mean_velocity_of_a_step(engine: str) -> None:
    assert shares(0.1, engine=engine) == pytest.approx((1.0 - 0.05) / (1.0 + 0.05), rel=1e-9)


@pytest.mark.parametrize("decay", [20.0, 1e3])
@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_overdamped_motion_reverses_and_halves_per_step(decay: float, stepping: str) -> None:
    assert shares(decay, stepping=stepping) == pytest.approx(-0.5, rel=1e-6)


def test_euler_damps_explicitly_where_this_is_stable() -> None:
    assert shares(0.4, stepping="euler") == pytest.approx(0.6, rel=1e-9)


def test_damping_ratio_follows_stiffness_only_in_joints_with_a_spring() -> None:
    constant, ratio = LinkDamping(constant=0.1), LinkDamping(constant=0.1, ratio=0.5, inertia=0.02)
    for mode, same in ((1, True), (6, False)):
        robot = chain(Body(actuator="sea"))
        ends = [run(robot, mode=mode, initial=[0.3], duration=0.05, link_damping={"*": law}) for law in (constant, ratio)]
        one, other = (end.samples.values["link_position"][-1, 0] for end in ends)
        assert bool(one == other) is same
