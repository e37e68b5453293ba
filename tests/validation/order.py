"""Checks of the order of convergence: random robots against `support.independent_ode`, dry friction, impacts."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from asrsim.signals import Sinusoid
from support.convergence import errors, order_of, truth_of
from support.random_runs import random_run
from support.stopped_arm import stopped
from validation.check import Check, engine
from validation.models import GRAVITY, Body, chain, column, run

ROBOTS = 8
KINDS: dict[str, dict[str, Any]] = {
    "every actuator and mode, inputs that jump": {},
    "trees of six passive joints with springs and damping": {"moving": 6, "passive": 1.0, "jumps": False},
    "electric motors, hysteresis, late commands": {"moving": 3, "extras": True},
}
"""Arguments of `random_run` by kind of random robots."""


def measured(seed: int, keys: dict[str, Any], **options: Any) -> tuple[float, list[float]]:
    """Largest speed, and largest errors at the steps h, h/2 and h/4, of random robot `seed`. Odd seeds have a floating base."""
    random = random_run(seed, fixed=seed % 2 == 0, **keys)
    speed, truth = truth_of(random)
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        return speed, errors(random, truth, Path(folder), engine(), compiled=True, **options)


def smooth() -> Iterator[Check]:
    """Order of convergence with inputs that jump within steps: two."""
    for kind in KINDS:
        yield from random_robots(kind, range(ROBOTS))


def random_robots(kind: str, seeds: range) -> Iterator[Check]:
    """Order of convergence and errors of random robots of a kind."""
    runs = [measured(seed, KINDS[kind]) for seed in seeds]
    orders = [order_of(found) for _, found in runs]
    worst = max(found[0] / speed for speed, found in runs)
    median, least = float(np.median(orders)), min(orders)
    of = f"of {len(seeds)} random robots: {kind}"
    yield Check(name=f"median order {of}", figure=median, bound=1.8, at_least=True, source="2")
    yield Check(name=f"smallest order {of}", figure=least, bound=0.85, at_least=True, source="2")
    yield Check(name=f"largest error at 1 ms / largest speed: {kind}", figure=worst, bound=2e-4, unit="s", source="DOP853")


def first_order_schemes() -> Iterator[Check]:
    """Order of convergence of the scheme `euler` (one), and its error compared with the default scheme."""
    best, coarse = (measured(2, {}, stepping=stepping)[1] for stepping in ("leapfrog", "euler"))
    order = float(np.log2(coarse[0] / coarse[2]) / 2.0)
    yield Check(name="order of euler", figure=order, bound=0.8, at_least=True, source="1")
    yield Check(
        name="error of euler / error of leapfrog",
        figure=coarse[0] / best[0],
        bound=10.0,
        at_least=True,
        source="DOP853",
    )


def friction_orders() -> Iterator[Check]:
    """Order and error with dry friction of joints (engine) and motors (Dahl), against a run with steps 512 times finer."""
    sticky = Body(actuator="sea", mass=0.4, reach=0.05, inertia=2e-3, friction=0.02)
    wave = Sinusoid(amplitude=0.4, frequency=1.5)
    cases = (
        ("Coulomb friction of the joint, mode 3", sticky, 3),
        ("Dahl friction of the motors, mode 6", replace(sticky, friction=0.0), 6),
        ("both, mode 6", sticky, 6),
    )
    steps = [1e-3 / 2.0**i for i in range(6)]
    for name, body, mode in cases:
        positions = []
        for step in (*steps, steps[-1] / 16.0):
            result = run(
                chain(body),
                mode=mode,
                references={"equilibrium_position": wave},
                parameters={"spring_stiffness": 20.0},
                duration=0.6,
                step=step,
                substeps=1,
                motor_substeps=1,
            )
            assert result.samples is not None
            positions.append(result.samples.values["link_position"][:: round(steps[0] / step), 0])
        found = [float(np.max(np.abs(q - positions[-1]))) for q in positions[:-1]]
        # The phase of a reversal within a step is random, so the order is visible only over several halvings.
        slope = float(np.polyfit(np.log(steps), np.log(found), 1)[0])
        yield Check(
            name=f"error at 1 ms under dry friction: {name}",
            figure=found[0],
            bound=1e-3,
            unit="rad",
            source="a run with 1/512 ms",
        )
        yield Check(name=f"order under dry friction: {name}", figure=slope, bound=1.75, at_least=True, source="2")


def impacts() -> Iterator[Check]:
    """Errors of random arms with two joints, friction and 3 to 8 impacts and reversals, against an event-driven solution.

    Between impacts, the order is two. The time of an impact is accurate to a step, and the error may grow afterwards.
    """
    for seed in range(6):
        random = np.random.default_rng(seed)
        link = Body(mass=random.uniform(0.3, 1.0), reach=0.15, inertia=random.uniform(1e-3, 5e-3), length=0.3)
        friction = random.uniform(0.0, 0.3), random.choice([0.0, 0.05])
        lower, upper = (tuple(random.uniform(0.3, 0.6, 2) * (1.0, 0.8)) for _ in (0, 1))
        robot, truth = stopped(link, friction, (-lower[0], -lower[1]), upper, gravity=GRAVITY)
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

        def push(t: float, q: Any, pushes: list[Sinusoid] = pushes) -> Any:
            return np.array([float(signal.values(np.array([t]))[0]) for signal in pushes])

        rows, events = truth.move(start, speed, push, np.array([0.0, end]))
        assert events >= 3
        found = []
        for step in (1e-3, 2.5e-4):
            result = run(
                robot,
                duration=end,
                step=step,
                initial=start.tolist(),
                initial_velocities={"joint_1": float(speed[0]), "joint_2": float(speed[1])},
                external={f"joint_{j + 1}": signal for j, signal in enumerate(pushes)},
            )
            found.append(max(abs(column(result, "link_position", j)[-1] - rows[-1, j]) for j in (0, 1)))
        yield Check(
            name=f"error at .25 ms after impacts on stops: arm {seed}",
            figure=found[1],
            bound=1.5e-3,
            unit="rad",
            source="an event-driven solution",
        )
        yield Check(
            name=f"error after impacts at .25 ms / error at 1 ms: arm {seed}",
            figure=found[1] / found[0],
            bound=0.4,
            source=".06 (order two) to .25 (one)",
        )
