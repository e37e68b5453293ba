"""Hanging chain of links, its simulation, and its independent integration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import asrsim
from asrsim.samples import Samples
from asrsim.simulation.run import simulate
from support.independent_ode import solve
from support.random_runs import JointSpec, RandomRun, Wave
from validation.models import Body, chain

INERTIA, MASS, REACH = 2e-3, 0.4, 0.1

NEVER = Wave(offset=0.0, amplitude=0.0, frequency=1.0, at=np.inf, jump=0.0)
"""Reference that stays at 0."""


def joint(*, start: float = 0.0, speed: float = 0.0, damping: float = 0.0, effort: float = np.inf, **keys: Any) -> JointSpec:
    return JointSpec(
        name="", kind="revolute", damping=damping, effort=effort, spring=0.0, rest=0.0, start=start, speed=speed, **keys
    )  # fmt: skip


def plan(
    joints: Sequence[JointSpec], duration: float, *, jumps: tuple[float, ...] = (), axes: Sequence[str] | None = None
) -> RandomRun:
    """Run of a hanging chain with these joints, which are named `joint_1`, `joint_2`, ... axes: by default, all are y."""
    bodies = [
        Body(
            mass=MASS, reach=REACH, inertia=INERTIA, length=0.2, axis=axis, damping=joint.damping,
            limits=f'<limit lower="-60" upper="60" effort="{min(joint.effort, 1e6)!r}" velocity="1000"/>',
        )
        for joint, axis in zip(joints, axes or ["0 1 0"] * len(joints), strict=True)
    ]  # fmt: skip
    return RandomRun(
        urdf=chain(*bodies).text, joints=tuple(replace(joint, name=f"joint_{i}") for i, joint in enumerate(joints, 1)),
        gravity=(0.0, 0.0, -9.81), rpy=(0.0, 0.0, 0.0), fixed=True, duration=duration, jumps=jumps,
    )  # fmt: skip


def samples(given: RandomRun, folder: Path, **keys: Any) -> Samples:
    result = simulate(asrsim.make_scenario(given.write(folder), compiled=False, **given.keys(), **keys))
    assert result.samples is not None
    return result.samples


def truth(given: RandomRun, time: np.ndarray) -> np.ndarray:
    return np.asarray(solve(given, time)["positions"])
