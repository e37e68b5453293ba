"""Hanging chain of links, its simulation, and its independent integration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import asrsim
from asrsim.samples import Samples
from asrsim.simulation.run import simulate
from support.independent_ode import solve
from support.random_runs import JointSpec, RandomRun, Wave

INERTIA, MASS, REACH = 2e-3, 0.4, 0.1

NEVER = Wave(offset=0.0, amplitude=0.0, frequency=1.0, at=np.inf, jump=0.0)
"""Reference that stays at 0."""


def links(*axes: str, damping: float = 0.0, effort: float = 1e6) -> str:
    """URDF of a hanging chain with one joint for each axis in `axes`."""
    parts = ['<link name="l0"/>']
    for i, axis in enumerate(axes, 1):
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="0 0 {-REACH}"/><mass value="{MASS}"/><inertia ixx="{INERTIA}" '
            f'iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{i}" type="revolute"><origin xyz="0 0 {-0.2 if i > 1 else 0}"/><parent link="l{i - 1}"/>'
            f'<child link="l{i}"/><axis xyz="{axis}"/><limit lower="-60" upper="60" effort="{effort!r}" velocity="1000"/>'
            f'<dynamics damping="{damping!r}" friction="0"/></joint>'
        )
    return f'<robot name="r">{"".join(parts)}</robot>'


def joint(name: str, *, start: float = 0.0, damping: float = 0.0, effort: float = np.inf, **keys: Any) -> JointSpec:
    return JointSpec(
        name=name, kind="revolute", damping=damping, effort=effort, spring=0.0, rest=0.0, start=start, speed=0.0, **keys
    )


def plan(text: str, joints: tuple[JointSpec, ...], duration: float, jumps: tuple[float, ...] = ()) -> RandomRun:
    return RandomRun(
        urdf=text, joints=joints, gravity=(0.0, 0.0, -9.81), rpy=(0.0, 0.0, 0.0), fixed=True, duration=duration, jumps=jumps
    )


def samples(given: RandomRun, folder: Path, **keys: Any) -> Samples:
    result = simulate(asrsim.make_scenario(given.write(folder), compiled=False, **given.keys(), **keys))
    assert result.samples is not None
    return result.samples


def truth(given: RandomRun, time: np.ndarray) -> np.ndarray:
    return np.asarray(solve(given, time)["positions"])
