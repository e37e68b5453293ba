"""Mass matrix and bias torques of a URDF, computed by Pinocchio."""

from __future__ import annotations

import math

import numpy as np

ALTEREGO = [f"robots/alterego/alterego_{version}_fixedbase-true_fixedhands-true.urdf" for version in ("v2", "v3")]


def pinocchio_model(text: str) -> tuple[object, list[str]]:
    import pinocchio

    model = pinocchio.buildModelFromXML(text)
    return model, [model.names[i] for i in range(1, model.njoints)]


def dynamics(text: str, positions: dict[str, float], velocities: dict[str, float]) -> tuple[dict, dict]:
    """Mass matrix by pairs of joints, and bias torque (Coriolis, gravity) by joint."""
    import pinocchio

    model, names = pinocchio_model(text)
    data = model.createData()
    q, v = pinocchio.neutral(model), np.zeros(model.nv)
    for i, name in enumerate(names, start=1):
        joint = model.joints[i]
        x = positions[name]
        q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [math.cos(x), math.sin(x)]
        v[joint.idx_v] = velocities[name]
    matrix = pinocchio.crba(model, data, q)
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    bias = pinocchio.nonLinearEffects(model, data, q, v)
    at = {name: model.joints[i].idx_v for i, name in enumerate(names, start=1)}
    return {(a, b): matrix[at[a], at[b]] for a in names for b in names}, {name: bias[at[name]] for name in names}


def farthest(one: dict, other: dict) -> float:
    """Largest difference of two dictionaries, relative to the largest value."""
    assert one.keys() == other.keys()
    return max(abs(one[key] - other[key]) for key in one) / max(map(abs, one.values()))
