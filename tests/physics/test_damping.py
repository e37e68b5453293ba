"""Viscous damping of the links, which a substep treats implicitly."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from asrsim.scenario.data import LinkDamping, World, Wrench
from asrsim.signals import Constant, Step
from validation.models import INSTALLED, Body, chain, column, run

STEP, INERTIA = 1e-3, 0.01


def shares(decay, *, stepping="leapfrog", engine="mujoco"):
    """Ratio of the velocities after and before each step of a link with damping alone. decay: c h / I."""
    body = Body(actuator="sea", mass=1e-9, reach=0.0, inertia=INERTIA, damping=decay * INERTIA / STEP)
    result = run(
        chain(body),
        mode=0,
        gravity=0.0,
        duration=0.02,
        engine=engine,
        stepping=stepping,
        substeps=1,
        initial_velocities={"joint_1": 1.0},
    )
    way = np.diff(column(result, "link_position"))
    return np.asarray(way[2:8] / way[1:7])


@pytest.mark.parametrize("engine", INSTALLED)
def test_weak_damping_acts_on_the_mean_velocity_of_a_step(engine):
    assert shares(0.1, engine=engine) == pytest.approx((1.0 - 0.05) / (1.0 + 0.05), rel=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
def test_dampers_and_wrenches_act_as_without_a_world_out_of_reach(engine):
    links = [Body(mass=0.4, reach=0.1, inertia=2e-3, length=0.2, damping=damping) for damping in (0.3, 0.1)]
    alone, beside = (
        run(
            chain(*links),
            initial=[0.7, 0.4],
            initial_velocities={"joint_1": 2.0},
            duration=0.1,
            engine=engine,
            world=world,
            wrenches=(Wrench(link="link_1", force=(Constant(value=3.0), None, None), point=(0.0, 0.0, -0.1)),),
        )
        for world in (World(), World(ground=True, ground_height=-9.0))
    )
    for name in ("link_position", "link_velocity"):
        np.testing.assert_allclose(beside.samples.values[name], alone.samples.values[name], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("decay", [20.0, 1e3])
@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_overdamped_motion_reverses_and_halves_per_step(decay, stepping):
    assert shares(decay, stepping=stepping) == pytest.approx(-0.5, rel=1e-6)


def test_euler_damps_explicitly_where_this_is_stable():
    assert shares(0.4, stepping="euler") == pytest.approx(0.6, rel=1e-9)


def test_damping_ratio_follows_stiffness_only_in_joints_with_a_spring():
    constant, ratio = LinkDamping(constant=0.1), LinkDamping(constant=0.1, ratio=0.5, inertia=0.02)
    for mode, same in ((1, True), (6, False)):
        robot = chain(Body(actuator="sea"))
        ends = [run(robot, mode=mode, initial=[0.3], duration=0.05, link_damping={"*": law}) for law in (constant, ratio)]
        one, other = (end.samples.values["link_position"][-1, 0] for end in ends)
        assert bool(one == other) is same


def awas_swing(rows, jump, presets, constant, ratio):
    """Positions of a link at the times of `rows`, from rest at 0, with its AwAS-II at 0.2 rad and a preset that jumps (paper
    eq. 4; section 4.2.2 for the damping). The default parameters are Ks = 10 N m/rad, L = 50 mm, r_t = 15 mm."""

    def slope(_, state, preset):
        gain = 2.0 * 10.0 * (0.05 / 0.015 * preset / (0.05 - preset)) ** 2
        bent = 0.2 - state[0]
        damping = constant + 2.0 * ratio * np.sqrt(INERTIA * gain * np.cos(2.0 * bent))
        return [state[1], (gain * np.sin(bent) * np.cos(bent) - damping * state[1]) / INERTIA]

    late = rows > jump
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
    first = solve_ivp(slope, (0.0, jump), [0.0, 0.0], args=presets[:1], dense_output=True, **options)
    second = solve_ivp(slope, (jump, rows[-1]), first.y[:, -1], args=presets[1:], t_eval=rows[late], **options)
    return np.concatenate([first.sol(rows[~late])[0], second.y[0]])


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_damping_ratio_uses_the_stiffness_on_each_side_of_jumps(share, engine, compiled):
    """The preset jumps `share` of a step after a row of the log; the error falls with the square of the step."""
    errors = []
    for step in (1e-3, 2.5e-4):
        jump, presets, constant, ratio = 0.05 + share * step, (0.005, 0.02), 0.01, 0.2
        result = run(
            chain(Body(actuator="awas_ii", mass=1e-9, reach=0.0, inertia=INERTIA)), mode=3, gravity=0.0, duration=0.1,
            step=step, substeps=1, engine=engine, compiled=compiled,
            references={
                "equilibrium_position": 0.2, "stiffness_preset": Step(at=jump, before=presets[0], after=presets[1]),
            },
            link_damping={"*": LinkDamping(constant=constant, ratio=ratio, inertia=INERTIA)},
        )  # fmt: skip
        truth = awas_swing(result.samples.time, jump, presets, constant, ratio)
        errors.append(np.abs(column(result, "link_position") - truth).max())
    assert errors[0] < 5e-4
    assert np.log2(errors[0] / errors[1]) / 2.0 > 1.9
