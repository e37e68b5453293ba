"""Independent solution of a planar chain with coupled joints, in reduced coordinates, by SciPy's DOP853.

The chain hangs in the plane x, z. All links are points on massless rods, with inertias about their own centres. The equations
come from the Lagrangian in the absolute angles of the rods, and share nothing with asrsim.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp

G = 9.81


@dataclass(frozen=True)
class Rod:
    """A link of the chain, and its joint."""

    length: float
    """Distance to the next joint, m."""
    reach: float
    """Distance of the centre of mass from the joint, m."""
    mass: float
    inertia: float
    damping: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    armature: float = 0.0
    weightless: bool = False
    mimic: int | None = None
    ratio: float = 1.0
    offset: float = 0.0


RODS = (
    Rod(0.3, 0.15, 0.8, 0.01, damping=0.05),
    Rod(0.25, 0.1, 0.5, 0.004, mimic=1, ratio=-0.7, offset=0.3, damping=0.02, stiffness=1.5, rest=0.2),
    Rod(0.2, 0.12, 0.3, 0.002, mimic=2, ratio=1.5, offset=-0.1, damping=0.01),
    Rod(0.1, 0.08, 0.2, 0.001, mimic=3, ratio=-0.5, stiffness=0.4, armature=0.01),
)
"""A chain of followers with negative multipliers and offsets, springs, damping and a rotor."""
TWO_FREE = (*RODS[:2], Rod(0.2, 0.12, 0.3, 0.002, damping=0.01), replace(RODS[3], weightless=True))
"""The same chain with two free joints; a weightless link follows the second."""


def urdf(rods):
    """URDF of the chain: revolute joints j1, j2, ... about y; a positive angle turns the rod from -z towards -x."""
    parts, parent, at = ['<robot name="rods"><link name="base"/>'], "base", 0.0
    for k, rod in enumerate(rods, 1):
        mimic = f'<mimic joint="j{rod.mimic}" multiplier="{rod.ratio!r}" offset="{rod.offset!r}"/>' if rod.mimic else ""
        i = rod.inertia
        parts.append(
            f'<joint name="j{k}" type="continuous"><origin xyz="0 0 {at!r}"/><parent link="{parent}"/><child link="l{k}"/>'
            f'<axis xyz="0 1 0"/><dynamics damping="{rod.damping!r}" armature="{rod.armature!r}"/>{mimic}</joint>'
            f'<link name="l{k}"><inertial><origin xyz="0 0 {-rod.reach!r}"/><mass value="{rod.mass!r}"/>'
            f'<inertia ixx="{i!r}" iyy="{i!r}" izz="{i!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<gazebo reference="j{k}"><springStiffness>{rod.stiffness!r}</springStiffness>'
            f"<springReference>{rod.rest!r}</springReference></gazebo>"
        )
        if rod.weightless:
            parts.append(f'<gazebo reference="l{k}"><turnGravityOff>true</turnGravityOff></gazebo>')
        parent, at = f"l{k}", -rod.length
    return "".join(parts) + "</robot>"


def spread(rods):
    """Ratios N (n, r) and offsets c (n,) of q = N z + c, and the free joints."""
    n = len(rods)
    rows, offsets, free = [None] * n, np.zeros(n), [k for k in range(n) if not rods[k].mimic]

    def row(k):
        if rods[k].mimic is None:
            return np.eye(len(free))[free.index(k)], 0.0
        above, shift = row(rods[k].mimic - 1)
        return rods[k].ratio * above, rods[k].ratio * shift + rods[k].offset

    for k in range(n):
        rows[k], offsets[k] = row(k)
    return np.array(rows), offsets, free


def solve(rods, times, z0, *, torque=lambda t: 0.0, joint=0):
    """Joint positions (times, n). z0: start of the free joints; torque on a joint as a function of time."""
    n, (ratios, c, _) = len(rods), spread(rods)
    total = np.tril(np.ones((n, n)))  # absolute angles of the rods from joint angles
    arms = np.array([[rods[j].length if j < k else rods[k].reach if j == k else 0.0 for j in range(n)] for k in range(n)])
    mass, inertia = np.array([r.mass for r in rods]), np.array([r.inertia for r in rods])
    weight = np.array([0.0 if r.weightless else r.mass for r in rods])
    damping, stiffness, rest = (np.array([getattr(r, name) for r in rods]) for name in ("damping", "stiffness", "rest"))
    armature = np.array([r.armature for r in rods])
    pairs = np.einsum("k,ki,kj->ij", mass, arms, arms)

    def rate(t, y):
        z, dz = np.split(y, 2)
        q, dq = ratios @ z + c, ratios @ dz
        a, da = total @ q, total @ dq
        between = a[:, None] - a[None]
        matrix = pairs * np.cos(between) + np.diag(inertia)
        bias = (pairs * np.sin(between)) @ da**2 + G * (weight @ arms) * np.sin(a)
        push = -damping * dq - stiffness * (q - rest)
        push[joint] += torque(t)
        full = total.T @ matrix @ total + np.diag(armature)
        return np.concatenate([dz, np.linalg.solve(ratios.T @ full @ ratios, ratios.T @ (push - total.T @ bias))])

    start = np.concatenate([z0, np.zeros(len(z0))])
    done = solve_ivp(rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    return done.y[: len(z0)].T @ ratios.T + c
