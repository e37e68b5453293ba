"""Closed chains of one freedom: the joints of a loop follow its master with a ratio that depends on the positions.

A loop is closed where a point of one link coincides with a point of another one. Along the path between both links, with
positions q and velocities v, the gap p_a - p_b changes by J v. The ratios of the followers solve J_f ratio = -J_m; at constant
velocity of the master they accelerate by gamma, which solves J_f gamma = -dJ/dt v (least squares, since a planar loop has fewer
equations than the three of the gap). Positions are corrected by Newton's method, so that the gap does not grow.

The functions run as Python or compiled.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.robot.loops import LoopPath

Numbers = NDArray[Any]
ROUNDS = 12
"""Largest number of rounds of Newton's method in a step; two to three suffice."""
CLOSED = 1e-15
"""Gap below which the search ends, m."""


class Loops(NamedTuple):
    """Loops of a robot, and work space. Entries of a path belong to one joint on one side of its loop."""

    chains: int
    """Number of loops."""
    first: Numbers
    """Index of the first entry of each loop, and the number of all entries, (loops + 1,)."""
    second: Numbers
    """Index of the first entry on the second side of each loop, (loops,)."""
    master: Numbers
    """Entry of the master of each loop, (loops,)."""
    joint: Numbers
    """Joint of each entry, (k,)."""
    place: Numbers
    """Index of each entry's joint in a configuration, (k,)."""
    speed: Numbers
    """Index of each entry's joint in the library's velocities, (k,)."""
    slides: Numbers
    """1 for the entry of a prismatic joint, (k,)."""
    origin: Numbers
    """Position (k, 3) of each joint's frame behind the previous joint, m."""
    turn: Numbers
    """Rotation (k, 9) of each joint's frame behind the previous joint."""
    axis: Numbers
    """Axis (k, 3) of each joint in its frame."""
    ends: Numbers
    """Points that coincide, behind the last joints of both sides, (loops, 6), m."""
    gamma: Numbers
    """Acceleration of each of the library's velocities at constant velocity of the masters, (w,)."""
    arms: Numbers
    """Work space: axis, origin, and column of J for each entry, (k, 9)."""
    work: Numbers
    """Work space: rotation, three vectors, gap, drift of the gap, (30,)."""
    normal: Numbers
    """Work space: normal equations with right-hand side and solution, (k, k + 2)."""


def make_loops(paths: tuple[LoopPath, ...], joint_q: Numbers, joint_v: Numbers, speeds: int) -> Loops:
    """Loops with the joints' places in a configuration and in the library's velocities."""
    sizes = [len(path.joints) for path in paths]
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    joint = np.array([j for path in paths for j in path.joints], dtype=np.int64)
    k = len(joint)
    return Loops(
        chains=len(paths), first=first,
        second=np.array([a + path.split for a, path in zip(first[:-1], paths, strict=True)], dtype=np.int64),
        master=np.array([a + path.master for a, path in zip(first[:-1], paths, strict=True)], dtype=np.int64),
        joint=joint, place=joint_q[joint], speed=joint_v[joint],
        slides=np.array([int(one) for path in paths for one in path.slides], dtype=np.int64),
        origin=np.array([one for path in paths for one in path.origins], dtype=float).reshape(k, 3),
        turn=np.array([one for path in paths for one in path.turns], dtype=float).reshape(k, 9),
        axis=np.array([one for path in paths for one in path.axes], dtype=float).reshape(k, 3),
        ends=np.array([path.ends for path in paths], dtype=float).reshape(len(paths), 6),
        gamma=np.zeros(speeds), arms=np.zeros((k, 9)), work=np.zeros(30), normal=np.zeros((k, k + 2)),
    )  # fmt: skip


def find_columns(loops: Any, loop: int, q: Any) -> None:
    """Compute the gap (`work[21:24]`) and the columns of J (`arms[:, 6:]`) of a loop at the configuration q."""
    work, arms = loops.work, loops.arms
    for i in range(3):
        work[21 + i] = 0.0
    for side in range(2):
        begin = loops.second[loop] if side else loops.first[loop]
        end = loops.first[loop + 1] if side else loops.second[loop]
        sign = -1.0 if side else 1.0
        # Rotation work[0:9] and position work[9:12] of the frame behind the last joint.
        for i in range(12):
            work[i] = 1.0 if i < 9 and i % 4 == 0 else 0.0
        for k in range(begin, end):
            _enter(loops, k, q[loops.place[k]])
        for i in range(3):
            point = work[9 + i]
            for c in range(3):
                point += work[3 * i + c] * loops.ends[loop, 3 * side + c]
            work[12 + i] = point
            work[21 + i] += sign * point
        for k in range(begin, end):
            for i in range(3):
                if loops.slides[k]:
                    arms[k, 6 + i] = sign * arms[k, i]
                else:
                    b, c = (i + 1) % 3, (i + 2) % 3
                    lever_b, lever_c = work[12 + b] - arms[k, 3 + b], work[12 + c] - arms[k, 3 + c]
                    arms[k, 6 + i] = sign * (arms[k, b] * lever_c - arms[k, c] * lever_b)


def _enter(loops: Any, k: int, position: float) -> None:
    """Move the frame in `work` behind the joint of entry k, and store the joint's axis and origin in `arms`."""
    work, arms = loops.work, loops.arms
    for i in range(3):
        for c in range(3):
            work[9 + i] += work[3 * i + c] * loops.origin[k, c]
    _turn_by(work, loops.turn, k)
    for i in range(3):
        arms[k, i] = 0.0
        for c in range(3):
            arms[k, i] += work[3 * i + c] * loops.axis[k, c]
        arms[k, 3 + i] = work[9 + i]
    if loops.slides[k]:
        for i in range(3):
            work[9 + i] += arms[k, i] * position
        return
    # Rodrigues' formula about the axis, on each column of the rotation.
    s, rest = sin(position), 1.0 - cos(position)
    for c in range(3):
        x, y, z = work[c], work[3 + c], work[6 + c]
        u, v, w = arms[k, 0], arms[k, 1], arms[k, 2]
        along = u * x + v * y + w * z
        work[c] = x + s * (v * z - w * y) + rest * (u * along - x)
        work[3 + c] = y + s * (w * x - u * z) + rest * (v * along - y)
        work[6 + c] = z + s * (u * y - v * x) + rest * (w * along - z)


def _turn_by(work: Any, turn: Any, k: int) -> None:
    """Multiply the rotation in `work` by a fixed rotation."""
    for i in range(3):
        x, y, z = work[3 * i], work[3 * i + 1], work[3 * i + 2]
        for c in range(3):
            work[3 * i + c] = x * turn[k, c] + y * turn[k, 3 + c] + z * turn[k, 6 + c]


def find_drift(loops: Any, loop: int, v: Any) -> None:
    """Compute dJ/dt v of a loop (`work[24:27]`) at the velocities v, after `find_columns`.

    dJ_k/dt v_k is the sum over the joints before k on the same side of omega x, where omega turns the axis, and over all of the
    motion of the lever.
    """
    work, arms = loops.work, loops.arms
    for i in range(3):
        work[24 + i] = 0.0
    for side in range(2):
        begin = loops.second[loop] if side else loops.first[loop]
        end = loops.first[loop + 1] if side else loops.second[loop]
        # The second derivative of a point of a chain: column k changes by axis_i x column_k for a hinge i at or before k;
        # a change of column k by a joint i behind k is axis_k x column_i, so both orders are the same product.
        for k in range(begin, end):
            for i in range(begin, end):
                near, far = (i, k) if i <= k else (k, i)
                if loops.slides[near]:
                    continue
                rate = v[loops.speed[i]] * v[loops.speed[k]]
                for c in range(3):
                    a, b = (c + 1) % 3, (c + 2) % 3
                    work[24 + c] += rate * (arms[near, a] * arms[far, 6 + b] - arms[near, b] * arms[far, 6 + a])


def solve_followers(loops: Any, loop: int) -> None:
    """Solve J_f x = -r for the followers of a loop by least squares, with r in `work[27:30]`; x becomes the last column of
    `normal`. A singular system gives values that are not finite."""
    normal, arms, work = loops.normal, loops.arms, loops.work
    begin, end, master = loops.first[loop], loops.first[loop + 1], loops.master[loop]
    width = loops.first[loops.chains]
    for k in range(begin, end):
        for i in range(begin, k + 1):
            normal[k, i] = 0.0
            for c in range(3):
                normal[k, i] += arms[k, 6 + c] * arms[i, 6 + c]
        normal[k, width] = 0.0
        for c in range(3):
            normal[k, width] -= arms[k, 6 + c] * work[27 + c]
    # Cholesky's decomposition without the row of the master.
    for k in range(begin, end):
        if k == master:
            continue
        for i in range(begin, k + 1):
            if i == master:
                continue
            value = normal[k, i]
            for c in range(begin, i):
                if c != master:
                    value -= normal[k, c] * normal[i, c]
            if i < k:
                normal[k, i] = value / normal[i, i]
            else:
                normal[k, k] = value**0.5 if value > 0.0 else np.nan
        value = normal[k, width]
        for c in range(begin, k):
            if c != master:
                value -= normal[k, c] * normal[c, width]
        normal[k, width] = value / normal[k, k]
    for k in range(end - 1, begin - 1, -1):
        normal[k, width + 1] = 0.0
        if k == master:
            continue
        value = normal[k, width]
        for c in range(k + 1, end):
            if c != master:
                value -= normal[c, k] * normal[c, width + 1]
        normal[k, width + 1] = value / normal[k, k]


def find_ratios(loops: Any, ratio: Any, factor: Any, q: Any) -> None:
    """Compute the ratios of the followers of all loops at the configuration q."""
    width = loops.first[loops.chains]
    for loop in range(loops.chains):
        find_columns(loops, loop, q)
        for c in range(3):
            loops.work[27 + c] = loops.arms[loops.master[loop], 6 + c]
        solve_followers(loops, loop)
        for k in range(loops.first[loop], loops.first[loop + 1]):
            if k != loops.master[loop]:
                ratio[loops.joint[k]] = factor[loops.speed[k]] = loops.normal[k, width + 1]


def find_gamma(loops: Any, q: Any, v: Any) -> None:
    """Compute the accelerations `gamma` at the configuration q and the velocities v of the library."""
    width = loops.first[loops.chains]
    for loop in range(loops.chains):
        find_columns(loops, loop, q)
        find_drift(loops, loop, v)
        for c in range(3):
            loops.work[27 + c] = loops.work[24 + c]
        solve_followers(loops, loop)
        for k in range(loops.first[loop], loops.first[loop + 1]):
            if k != loops.master[loop]:
                loops.gamma[loops.speed[k]] = loops.normal[k, width + 1]


def close_loops(loops: Any, q: Any) -> None:
    """Move the followers of all loops until the gaps are closed. q: configuration, whose followers are near their positions."""
    width = loops.first[loops.chains]
    for loop in range(loops.chains):
        before = 1e300
        for _ in range(ROUNDS):
            find_columns(loops, loop, q)
            gap = 0.0
            for c in range(3):
                loops.work[27 + c] = loops.work[21 + c]
                gap += abs(loops.work[21 + c])
            if gap < CLOSED or not gap < before:
                break
            before = gap
            solve_followers(loops, loop)
            for k in range(loops.first[loop], loops.first[loop + 1]):
                if k != loops.master[loop]:
                    q[loops.place[k]] += loops.normal[k, width + 1]
