"""Joint stops are inelastic and friction is exact for every step size and phase, alone or together, in both engines."""

import math
from dataclasses import replace

import numpy as np
import pytest

from asrsim.scenario.data import World, Wrench
from asrsim.signals import Constant, Step
from support.stopped_arm import LINKS, limit, stopped
from validation.models import INSTALLED, Body, chain, column, run

STEPS = (1e-3, 2.5e-4)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("world", [World(), World(ground=True, ground_height=-9.0)], ids=["alone", "above a ground"])
@pytest.mark.parametrize("steps", [0.3, 50.0, 50.137, 50.5, 50.861])
@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_a_free_link_ends_at_rest_at_its_stop(engine, world, steps, step):
    """steps: number of steps until the link reaches its stop."""
    stop = 2.0 * step * steps
    robot = chain(Body(mass=1.0, reach=0.1, inertia=0.01, limits=limit(-2.0, stop)))
    result = run(
        robot, engine=engine, gravity=0.0, duration=100 * step, step=step, world=world, initial_velocities={"joint_1": 2.0}
    )
    assert column(result, "link_position")[-1] == pytest.approx(stop, abs=1e-8)
    assert column(result, "link_velocity")[-1] == pytest.approx(0.0, abs=1e-8)
    assert column(result, "link_position").max() <= stop + 1e-8


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("world", [World(), World(ground=True, ground_height=-9.0)], ids=["alone", "above a ground"])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_link_at_rest_near_its_stop_is_pushed_onto_it_and_stays(engine, world, side):
    """The torque moves the link from rest over more than the gap of 1 um in the first step."""
    ends = sorted((-2.0 * side, 1e-6 * side))
    robot = chain(Body(mass=1.0, reach=0.1, inertia=0.01, limits=limit(*ends)))
    push = {"joint_1": Constant(value=0.5 * side)}
    result = run(robot, engine=engine, gravity=0.0, duration=0.02, step=1e-3, world=world, external=push)
    np.testing.assert_allclose(column(result, "link_position")[1:], 1e-6 * side, rtol=0.0, atol=1e-8)
    assert column(result, "link_velocity")[-1] == pytest.approx(0.0, abs=1e-6)


PRESSED = Body(mass=1.0, reach=0.1, inertia=0.01, limits=limit(0.0, 2.0))
"""Link of 0.02 kg m^2 about its joint, at rest on its lower stop."""
STICKING = Body(mass=1.0, reach=0.1, inertia=0.01, friction=0.3)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("pushed", ["torque", "force"])
@pytest.mark.parametrize(("body", "before", "pull"), [(PRESSED, -0.5, 0.5), (STICKING, 0.2, 0.2)], ids=["stop", "friction"])
@pytest.mark.parametrize("late", [0.0, 0.2, 0.45, 0.7])
def test_link_leaves_its_stop_when_the_torque_jumps(engine, compiled, pushed, body, before, pull, late):
    """pull: torque that accelerates the link after the jump, N m. A jump between two steps acts up to half a step late."""
    step, jump = 1e-3, 0.03 + late * 1e-3
    load = Step(at=jump, before=before, after=0.5)
    keys = {"external": {"joint_1": load}}
    if pushed == "force":
        torque = (None, load, None)
        keys = {"wrenches": (Wrench(link="link_1", force=(None, None, None), torque=torque, point=(0.0, 0.0, 0.0)),)}
    result = run(chain(body), engine=engine, gravity=0.0, duration=0.1, step=step, compiled=compiled, **keys)
    acceleration, off = pull / 0.02, min(late, 1.0 - late) * step
    # The error of a leapfrog step is half the square of the distance between the jump and the nearest whole step.
    there = 0.5 * acceleration * ((0.1 - jump) ** 2 - off**2)
    assert column(result, "link_position")[-1] == pytest.approx(there, abs=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_link_that_is_pushed_back_leaves_its_stop_when_it_strikes_it(engine, compiled, friction, side):
    """A torque of 1 N m slows the link before the impact, and accelerates it from rest from the time of the impact on."""
    speed, end = 2.0, 0.1
    slowing, leaving = ((1.0 + friction) / 0.02, (1.0 - friction) / 0.02)
    for step in STEPS:
        for late in (0.1, 0.4, 0.6, 0.9):
            impact = 0.02 + late * step
            stop = speed * impact - 0.5 * slowing * impact**2
            there = stop - 0.5 * leaving * (end - impact) ** 2
            ends = (-2.0, stop) if side > 0.0 else (-stop, 2.0)
            body = Body(mass=1.0, reach=0.1, inertia=0.01, friction=friction, limits=limit(*ends))
            result = run(
                chain(body),
                engine=engine,
                gravity=0.0,
                duration=end,
                step=step,
                compiled=compiled,
                external={"joint_1": Constant(value=-side)},
                initial_velocities={"joint_1": side * speed},
            )
            # The speed at the impact is that of the step before, so its time is known to this part of a step.
            early = slowing * step / (speed - slowing * impact)
            assert abs(column(result, "link_position")[-1] - side * there) < leaving * early * step * end


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("late", [0.0, 0.2, 0.45, 0.7])
def test_a_sliding_link_reverses_within_a_step(engine, compiled, late):
    """A torque of -1 N m works against 0.3 N m of friction before the reversal, and 0.7 N m accelerate the link after it."""
    step, reversal = 1e-3, 0.03 + late * 1e-3
    speed = 1.3 / 0.02 * reversal
    result = run(
        chain(STICKING),
        engine=engine,
        gravity=0.0,
        duration=0.1,
        step=step,
        compiled=compiled,
        external={"joint_1": Constant(value=-1.0)},
        initial_velocities={"joint_1": speed},
    )
    off = min(late, 1.0 - late) * step
    there = 0.5 * (speed * reversal - 0.7 / 0.02 * (0.1 - reversal) ** 2 - 0.6 / 0.02 * off**2)
    assert column(result, "link_position")[-1] == pytest.approx(there, abs=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("late", [0.1, 0.45, 0.8])
def test_a_damped_link_reverses_at_second_order(engine, late):
    """I v' = -1 N m - 0.2 N m s/rad v -+ 0.3 N m of friction is solved by exponentials before and after the reversal."""
    inertia, damping, reversal, end = 0.02, 0.2, 0.03 + late * 1e-3, 0.1
    rate, faster, slower = damping / inertia, 1.3 / damping, 0.7 / damping
    speed = faster * math.expm1(rate * reversal)
    furthest = (speed + faster) * -math.expm1(-rate * reversal) / rate - faster * reversal
    there = furthest - slower * (end - reversal + math.expm1(-rate * (end - reversal)) / rate)
    for step in STEPS:
        result = run(
            chain(replace(STICKING, damping=damping)),
            engine=engine,
            gravity=0.0,
            duration=end,
            step=step,
            external={"joint_1": Constant(value=-1.0)},
            initial_velocities={"joint_1": speed},
        )
        # A jump of friction by 0.6 N m, half a step from the kick, gives half of this bound; damping adds to the error.
        assert abs(column(result, "link_position")[-1] - there) < 0.25 * 0.6 / inertia * step**2


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(
    ("friction", "lower", "speed", "before", "after", "reversals"),
    [
        pytest.param((0.2, 0.02), 0.0, (0.0, 0.0), (0.1, -0.1), (1.5, 0.45), 0, id="one sticks, the other rests on its stop"),
        pytest.param((0.2, 0.05), -2.0, (4.0, -6.0), (0.0, 0.0), (-1.0, 0.3), 2, id="both reverse after the jump"),
    ],
)
def test_joints_with_friction_move_at_second_order_after_a_jump(engine, friction, lower, speed, before, after, reversals):
    robot, truth = stopped(LINKS, friction, (-2.0, lower), (2.0, 2.0), gravity=0.0)
    jump, end = 0.05037, 0.2
    middle = truth.move(np.zeros(2), np.array(speed), lambda t, q: np.array(before), np.array([0.0, jump]))[0][-1]
    rows, events = truth.move(middle[:2], middle[2:], lambda t, q: np.array(after), np.array([jump, end]))
    there = rows[-1, :2]
    assert events == reversals
    assert abs(rows[-1, 2:]).min() > 1.0
    errors = []
    for step in STEPS:
        loads = {f"joint_{j + 1}": Step(at=jump, before=before[j], after=after[j]) for j in (0, 1)}
        result = run(
            robot,
            engine=engine,
            gravity=0.0,
            duration=end,
            step=step,
            external=loads,
            initial_velocities={"joint_1": speed[0], "joint_2": speed[1]},
        )
        errors.append(max(abs(column(result, "link_position", j)[-1] - there[j]) for j in (0, 1)))
    assert errors[1] < 3e-6
    assert errors[1] < 0.15 * errors[0]


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("struck", [0, 1])
@pytest.mark.parametrize("late", [0.2, 0.7])
@pytest.mark.parametrize("jump", [0.0051, 0.0058])
def test_velocities_of_all_joints_beside_an_impact_are_those_of_the_row(engine, struck, late, jump):
    """Where a joint strikes its stop, the velocities of all joints change at this time. A torque jumps in the same step."""
    speed, loads, time = np.array([2.0, 3.0]), (np.array([0.1, 0.0]), np.array([1.5, 0.0])), np.arange(13) * 1e-3
    lower, upper = np.full(2, -9.0), np.full(2, 9.0)

    def motion(times):
        """Robot, and positions and velocities (n, 4) at the times."""
        robot, truth = stopped(LINKS, (0.0, 0.0), lower, upper, gravity=0.0)
        early, late = times[times < jump], times[times >= jump]
        before, _ = truth.move(np.zeros(2), speed, lambda t, q: loads[0], np.append(early, jump))
        after, _ = truth.move(before[-1, :2], before[-1, 2:], lambda t, q: loads[1], np.append(jump, late))
        return robot, np.concatenate([before[:-1], after[1:]])

    # The stop stands where the joint is at the time of the impact without a stop.
    upper[struck] = motion(np.array([0.0, (5 + late) * 1e-3]))[1][-1, struck]
    robot, rows = motion(time)
    assert np.abs(rows[6, 2:] - rows[5, 2:]).min() > 0.5
    result = run(
        robot,
        engine=engine,
        gravity=0.0,
        duration=time[-1],
        step=1e-3,
        external={"joint_1": Step(at=jump, before=0.1, after=1.5)},
        initial_velocities={f"joint_{j + 1}": float(v) for j, v in enumerate(speed)},
    )
    for j in (0, 1):
        errors = column(result, "link_velocity", j) - rows[:, 2 + j]
        # The velocity torques of the step of the impact are those before the impact, so that the motion keeps an error.
        assert errors[:6] == pytest.approx(0.0, abs=1e-4)
        assert errors[6:] == pytest.approx(errors[-1], abs=2e-3)
        assert abs(errors[-1]) < 0.05
