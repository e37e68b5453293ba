"""Joint stops are inelastic, whatever the step and its phase; alone, several at once, under friction, on both engines."""

from __future__ import annotations

import numpy as np
import pytest

from asrsim.scenario.data import World
from asrsim.signals import Sinusoid
from support.stopped_arm import StoppedArm
from validation.models import INSTALLED, Body, chain, column, run

STEPS = (1e-3, 2.5e-4)


def limit(lower: float, upper: float) -> str:
    return f'<limit lower="{lower!r}" upper="{upper!r}" effort="1000" velocity="1000"/>'


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("world", [World(), World(ground=True, ground_height=-9.0)], ids=["alone", "above a ground"])
@pytest.mark.parametrize("phase", [0.0, 0.137, 0.5, 0.861])
@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_a_free_link_ends_at_rest_at_its_stop(engine: str, world: World, phase: float, step: float) -> None:
    stop = 0.1 + 2.0 * step * phase
    robot = chain(Body(mass=1.0, reach=0.1, inertia=0.01, limits=limit(-2.0, stop)))
    result = run(robot, engine=engine, gravity=0.0, duration=0.1, step=step, world=world, initial_velocities={"joint_1": 2.0})
    assert column(result, "link_position")[-1] == pytest.approx(stop, abs=1e-8)
    assert column(result, "link_velocity")[-1] == pytest.approx(0.0, abs=1e-8)
    assert column(result, "link_position").max() <= stop + 1e-8


def arm(random: np.random.Generator) -> StoppedArm:
    return StoppedArm(
        mass=float(random.uniform(0.3, 1.0)), reach=0.15, inertia=float(random.uniform(1e-3, 5e-3)), length=0.3, gravity=9.81,
        friction=(float(random.uniform(0.0, 0.3)), float(random.choice([0.0, 0.05]))),
        lower=(-float(random.uniform(0.3, 0.6)), -float(random.uniform(0.2, 0.5))),
        upper=(float(random.uniform(0.3, 0.6)), float(random.uniform(0.2, 0.5))),
    )  # fmt: skip


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("seed", range(6))
def test_two_joints_meet_their_stops_as_an_event_driven_solution_does(engine: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    truth = arm(random)
    start, speed = random.uniform(-0.15, 0.15, 2), random.uniform(-4.0, 4.0, 2)
    pushes = [
        Sinusoid(
            amplitude=float(random.uniform(0.5, 2.0)),
            frequency=float(random.uniform(0.5, 2.0)),
            phase=float(random.uniform(0, 6)),
        )
        for _ in (0, 1)
    ]
    end = 0.6

    def push(t: float) -> np.ndarray:
        return np.array([float(signal.values(np.array([t]))[0]) for signal in pushes])

    there, _, events = truth.move(start, speed, push, end)
    assert events >= 3
    bodies = [
        Body(
            mass=truth.mass,
            reach=truth.reach,
            inertia=truth.inertia,
            length=truth.length,
            friction=friction,
            limits=limit(low, high),
        )
        for friction, low, high in zip(truth.friction, truth.lower, truth.upper, strict=True)
    ]
    errors = []
    for step in STEPS:
        result = run(
            chain(*bodies), engine=engine, gravity=truth.gravity, duration=end, step=step, initial=start.tolist(),
            initial_velocities={"joint_1": float(speed[0]), "joint_2": float(speed[1])},
            external={f"joint_{j + 1}": signal for j, signal in enumerate(pushes)},
        )  # fmt: skip
        errors.append(max(abs(column(result, "link_position", j)[-1] - there[j]) for j in (0, 1)))
    # Between events the order is two; an event is met to within a step, and what follows it may widen the error.
    assert errors[1] < 5e-4
    assert errors[1] < 0.4 * errors[0]
