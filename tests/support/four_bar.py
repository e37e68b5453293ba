"""A four-bar linkage as URDF and loop, and its motion by an equation of one freedom, solved by DOP853.

Angles are absolute in the plane x, -z: t of the crank, b of the coupler, c of the rocker; b and c follow from the closure.
"""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

GROUND, CRANK, COUPLER, ROCKER = 0.4, 0.15, 0.35, 0.3
MASSES = {"A": 0.5, "B": 0.4, "C": 0.3}
LENGTHS = {"A": CRANK, "B": COUPLER, "C": ROCKER}
INERTIAS = {name: mass * LENGTHS[name] ** 2 / 12 for name, mass in MASSES.items()}
DAMPING, G = 0.01, 9.81
START = 1.0
LOOPS = [{"links": ["B", "C"], "points": [[COUPLER, 0, 0], [ROCKER, 0, 0]]}]


def urdf(effort=""):
    def link(name):
        x, i = LENGTHS[name] / 2, INERTIAS[name]
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{MASSES[name]}"/>'
            f'<inertia ixx="1e-4" iyy="{i!r}" izz="{i!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    def joint(name, parent, child, x):
        return (
            f'<joint name="{name}" type="continuous"><origin xyz="{x} 0 0"/><parent link="{parent}"/><child link="{child}"/>'
            f'<axis xyz="0 1 0"/><dynamics damping="{DAMPING}"/>{effort}</joint>'
        )

    return (
        f'<robot name="four_bar"><link name="base"/>{joint("crank", "base", "A", 0)}{link("A")}'
        f"{joint('coupler', 'A', 'B', CRANK)}{link('B')}{joint('rocker', 'base', 'C', GROUND)}{link('C')}</robot>"
    )


def gap(q):
    """Distance (n,) between both points, at joint positions (n, 3) of crank, coupler and rocker."""
    t, b, c = q[:, 0], q[:, 0] + q[:, 1], q[:, 2]
    x = CRANK * np.cos(t) + COUPLER * np.cos(b) - GROUND - ROCKER * np.cos(c)
    z = CRANK * np.sin(t) + COUPLER * np.sin(b) - ROCKER * np.sin(c)
    return np.hypot(x, z)


def closed(t, y):
    """Angles (b, c) that close the linkage, near y, and the matrix of their equations."""
    for _ in range(50):
        b, c = y
        error = [
            CRANK * np.cos(t) + COUPLER * np.cos(b) - GROUND - ROCKER * np.cos(c),
            CRANK * np.sin(t) + COUPLER * np.sin(b) - ROCKER * np.sin(c),
        ]
        matrix = np.array([[-COUPLER * np.sin(b), ROCKER * np.sin(c)], [COUPLER * np.cos(b), -ROCKER * np.cos(c)]])
        step = np.linalg.solve(matrix, error)
        y = y - step
        if np.abs(step).max() < 1e-15:
            break
    return y, matrix


LONGEST = 1.0
"""Duration of the solved motion, s."""


def solve(times, torque):
    """Positions (n,) of the crank at `times` (n,) up to LONGEST, from rest under gravity and a constant torque on it."""
    return _motion(torque)(times)[0]


@cache
def _motion(torque):
    """State (2, n) of the crank as a function of times (n,). Tests share the solution, which takes half a second."""
    near, _ = closed(START, np.array([-1.3, -2.4]))

    def rate(_time, state):
        nonlocal near
        t, w = state
        near, matrix = closed(t, near)
        b, c = near
        kb, kc = -np.linalg.solve(matrix, [-CRANK * np.sin(t), CRANK * np.cos(t)])
        bend = [
            -CRANK * np.cos(t) - COUPLER * np.cos(b) * kb**2 + ROCKER * np.cos(c) * kc**2,
            -CRANK * np.sin(t) - COUPLER * np.sin(b) * kb**2 + ROCKER * np.sin(c) * kc**2,
        ]
        lb, lc = -np.linalg.solve(matrix, bend)
        m, i, far = MASSES, INERTIAS, INERTIAS["C"] + MASSES["C"] * ROCKER**2 / 4
        cross = m["B"] * CRANK * COUPLER
        inertia = (
            i["A"]
            + m["A"] * CRANK**2 / 4
            + m["B"] * (CRANK**2 + COUPLER**2 / 4 * kb**2)
            + cross * kb * np.cos(t - b)
            + i["B"] * kb**2
            + far * kc**2
        )
        slope = (
            m["B"] * COUPLER**2 / 2 * kb * lb
            + cross * (lb * np.cos(t - b) - kb * np.sin(t - b) * (1 - kb))
            + 2 * i["B"] * kb * lb
            + 2 * far * kc * lc
        )
        weight = -G * (
            m["A"] * CRANK / 2 * np.cos(t)
            + m["B"] * (CRANK * np.cos(t) + COUPLER / 2 * np.cos(b) * kb)
            + m["C"] * ROCKER / 2 * np.cos(c) * kc
        )
        loss = DAMPING * (1 + (kb - 1) ** 2 + kc**2) * w
        return [w, (torque - loss - weight - 0.5 * slope * w * w) / inertia]

    return solve_ivp(rate, (0.0, LONGEST), [START, 0.0], method="DOP853", dense_output=True, rtol=1e-12, atol=1e-13).sol
