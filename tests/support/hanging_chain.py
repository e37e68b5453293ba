"""Hanging chain of links, its simulation, and its independent integration."""

from dataclasses import replace

import numpy as np

import asrsim
from asrsim.simulation.run import simulate
from support.independent_ode import solve
from support.random_runs import JointSpec, RandomRun, Wave
from validation.models import Body, chain

INERTIA, MASS, REACH = 2e-3, 0.4, 0.1

NEVER = Wave(offset=0.0, amplitude=0.0, frequency=1.0, at=np.inf, jump=0.0)
"""Reference that stays at 0."""


def joint(*, start=0.0, speed=0.0, damping=0.0, effort=np.inf, **keys):
    return JointSpec(
        name="", kind="revolute", damping=damping, effort=effort, spring=0.0, rest=0.0, start=start, speed=speed, **keys
    )


def plan(joints, duration, *, jumps=(), axes=None):
    """Run of a hanging chain with these joints, which are named `joint_1`, `joint_2`, ... axes: by default, all are y."""
    bodies = [
        Body(
            mass=MASS,
            reach=REACH,
            inertia=INERTIA,
            length=0.2,
            axis=axis,
            damping=joint.damping,
            limits=f'<limit lower="-60" upper="60" effort="{min(joint.effort, 1e6)!r}" velocity="1000"/>',
        )
        for joint, axis in zip(joints, axes or ["0 1 0"] * len(joints), strict=True)
    ]
    return RandomRun(
        urdf=chain(*bodies).text,
        joints=tuple(replace(joint, name=f"joint_{i}") for i, joint in enumerate(joints, 1)),
        gravity=(0.0, 0.0, -9.81),
        rpy=(0.0, 0.0, 0.0),
        fixed=True,
        duration=duration,
        jumps=jumps,
    )


def samples(given, folder, **keys):
    result = simulate(asrsim.make_scenario(given.write(folder), compiled=False, **given.keys(), **keys))
    assert result.samples is not None
    return result.samples


def truth(given, time):
    return np.asarray(solve(given, time)["positions"])
