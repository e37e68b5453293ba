"""Actuators, numbers of robot files, steps."""

from __future__ import annotations

import math

import numpy as np

from over_ranges import UNEVEN, Asked, T, found


def of_the_core() -> Asked:
    for name in ("sea.Sea", "qbmove.QbMove", "bavs.Bavs", "awas_ii.AwasII"):
        actuator = found(f"actuators.{name}")
        usual = tuple(parameter.default for parameter in actuator.parameters)
        for law in ("elastic_torques", "stiffness", "elastic_energy"):
            yield (
                f"{name} {law}",
                getattr(actuator, law),
                [(q, a, b, usual) for q in (-0.4, 0.0, 0.1, 3.0) for a in (-0.2, 0.0, 0.3, 2.0) for b in (0.02, 0.05, 0.25)],
            )
        yield f"{name} references", actuator.motor_references, [(a, b) for a in (-1.0, 0.0, 0.5) for b in (0.0, 0.1, 0.4)]
        yield f"{name} equilibrium", actuator.equilibrium_position, [(a, b) for a in (-1.0, 0.0, 0.5) for b in (0.0, 0.1, 0.4)]
    yield (
        "saturate",
        found("actuators.base.saturate"),
        [(v, most) for v in (-2.0, -1.0, 0.0, 0.5, 1.0, 1.1) for most in (0.0, 1.0, math.inf)],
    )
    yield (
        "dahl",
        found("actuators.hysteresis.dahl"),
        [(t, c, 1.0, 0.1) for t in (-1.0, -0.5, 0.0, 0.9, 1.0) for c in (-0.5, -0.01, 0.0, 0.02, 1.0)],
    )
    yield (
        "simple steps",
        found("simulation.bench._simplest"),
        [(s, r) for s in (1e-3, 0.00099999, 1.0 / 3e2, 0.0123456) for r in (1e-9, 1e-6, 1e-4)],
    )
    yield (
        "sampling",
        found("simulation.bench.step_lengths"),
        [(T[:9], None), (T[:9], 0.01), (UNEVEN[1:9], None), (T[1:9], None)],
    )
    yield (
        "digits of steps",
        lambda n, h: repr(found("simulation.bench.step_lengths")(h * np.arange(n))[-1]),
        [(n, h) for n in (3, 40, 1000) for h in (1e-3, 1.0 / 3e2, 0.0123456)],
    )
    yield "listed", found("errors.listed"), [("abcdefgh"[:n], 3, "; ") for n in (0, 1, 3, 4, 5)]
    yield "whole", found("scenario.build.whole"), [(r,) for r in (0.5, 0.999, 1.0, 1.0 + 1e-9, 1.0 + 1e-5, 1.01, 2.4, 2.5, 1e6)]
    yield "shares", found("summary.table.share"), [(n, 1000) for n in (0, 1, 4, 5, 9, 10, 94, 95, 500, 994, 995, 999, 1000)]
    yield (
        "step start",
        found("summary.collect.step_start"),
        [(np.array(r), i) for r in ((0.0, 0.0, 1.0, 1.0), (1.0, 1.0), (0.0, 0.5, 1.0), (2.0, 0.0, 0.0)) for i in (0.0, 1.0)],
    )
    for name in ("rotation_matrix", "quaternion"):
        yield (
            name,
            found(f"robot.poses.{name}"),
            [(r,) for r in ((0.1, 0.2, 0.3), (1.5, -1.5, 3.0), (0.0, math.pi / 2, 0.4), (0.0, 0.0, -2.0))],
        )
    yield (
        "turned",
        found("robot.attributes.beyond_a_turn"),
        [((0.0, a, 0.0),) for a in (3.14, 6.28, 6.29, 7.0, -6.3, 90.0, 3.2)],
    )
    yield (
        "plain numbers",
        found("robot.numbers.read_number"),
        [(t,) for t in ("1", " 1 ", "1e3", "+1", "1,5", "0x1", "1_0", "nan", "inf", "", "1.", ".5", "-", "1e", "pi", "1 2")],
    )
    yield "leading numbers", found("robot.numbers.leading_number"), [(t,) for t in ("1mm", "1.5e2x", "-3 m", "x1", "")]
