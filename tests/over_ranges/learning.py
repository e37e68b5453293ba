"""Filters, intervals, paths."""

from __future__ import annotations

import numpy as np

from over_ranges import SHARES, Asked, T, found, shapes


def of_learning() -> Asked:
    made = shapes(T)
    two = np.column_stack([made["ring"], made["swing"]])
    yield (
        "zero phase",
        lambda c, o: found("learning.law.zero_phase")(two, c, o, 0.005),
        [(c, o) for c in (0.5, 2.0, 10.0, 50.0, 99.0, 101.0) for o in (1, 2, 4)],
    )
    yield (
        "amplitude",
        lambda c, o: found("learning.contraction.zero_phase_amplitude")(np.array([0.0, 0.5, 1.0, 2.0, 9.0]), c, o),
        [(c, o) for c in (0.5, 1.0, 5.0) for o in (1, 2, 4)],
    )
    yield (
        "averaged",
        lambda n: found("learning.optimal.averaged")(T, two, np.linspace(0.1, 1.9, n)),
        [(n,) for n in (3, 10, 37, 200)],
    )
    yield (
        "correlations",
        found("learning.transfer.correlation_interval"),
        [(r, n, c) for r in (-0.9, 0.0, 0.3, 0.99, 1.0) for n in (3, 4, 5, 20) for c in (0.5, 0.95)],
    )
    yield (
        "rounded up",
        found("learning.playback.rounded_up"),
        [(m * 10.0**e,) for e in range(-9, 10, 3) for m in (1.0, 2.0)],
    )
    yield (
        "turning",
        found("learning.prepared.turning"),
        [(n, 0.1, 1.5) for n in ([1.0, 0.5, 0.2], [1.0, 1.2], [1.0, 1.6], [0.05], [1.0, 0.5, 0.7], [1.0, 0.5, 0.8, 0.09])],
    )
    yield (
        "model time",
        found("kinematics.desired.model_time"),
        [(d, s) for d in (0.001, 0.01, 0.1, 1.0, 10.0, 100.0) for s in (1e-4, 1e-3, 0.01)],
    )
    yield "knots", found("kinematics.desired.knot_distance"), [(d,) for d in (0.001, 0.01, 0.1, 1.0, 3.0, 10.0, 100.0)]
    yield "jerk", found("kinematics.trajectory.minimum_jerk"), [(np.array(SHARES[:18]),)]
    yield "straight", found("kinematics.trajectory.linear"), [(np.array(SHARES[:18]),)]
    yield (
        "turns",
        found("kinematics.rotations.exponential"),
        [(np.array(v),) for v in ((0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.1, -0.2, 0.3), (0.0, 3.2, 0.0))],
    )
    yield (
        "controllers",
        lambda p, i: found("kinematics.drive_inverse.controller_error")(made["ring"], p, i, 0.005),
        [(p, i) for p in (0.0, 0.5, 20.0) for i in (0.0, 0.1, 3.0)],
    )
