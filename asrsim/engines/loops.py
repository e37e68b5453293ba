"""Closed chains with one degree of freedom. The joints of a linkage follow the master of the linkage, with ratios that depend
on the positions.

`asrsim.robot.loops` states the equations. Here an entry is a joint on one side of a loop, with its column of the Jacobian J;
the normal equations of a linkage collect the entries of its loops and its couplings. Newton's method corrects the positions in
every step, so that the gaps between the ends of the two sides of a loop do not grow.

The functions run as Python or compiled.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.robot.loops import Linkage

AnyArray = NDArray[Any]
ROUNDS = 12
"""Largest number of rounds of Newton's method in a step; two or three are usual."""
CLOSED = 1e-15
"""Gap in m between the ends of a loop below which Newton's method ends."""


class Loops(NamedTuple):
    """Linkages of a robot, and work space for them. An entry belongs to one joint on one side of one loop."""

    chains: int
    """Number of linkages."""
    width: int
    """Largest number of followers that a linkage has."""
    loop: AnyArray
    """Index of the first loop of each linkage, then the number of all loops, (chains + 1,)."""
    first: AnyArray
    """Index of the first entry of each loop, then the number of all entries, (loops + 1,)."""
    second: AnyArray
    """Index of the first entry on the second side of each loop, (loops,)."""
    column: AnyArray
    """Index of each entry's joint among the followers of its linkage, (k,); -1 for the master of the linkage."""
    place: AnyArray
    """Index of each entry's joint position in a configuration, (k,)."""
    speed: AnyArray
    """Index of each entry's joint in the library's velocities, (k,)."""
    slides: AnyArray
    """1 for an entry whose joint is prismatic, else 0, (k,)."""
    origin: AnyArray
    """Position (k, 3) of each joint's frame in the frame behind the previous joint, m."""
    turn: AnyArray
    """Rotation (k, 9) of each joint's frame in the frame behind the previous joint."""
    axis: AnyArray
    """Axis (k, 3) of each joint in its frame."""
    ends: AnyArray
    """Points that must coincide, in the frames behind the last joints of the two sides, (loops, 6), m."""
    follower: AnyArray
    """Index of the first follower of each linkage in the next three arrays, then the number of all followers, (chains + 1,)."""
    follower_joint: AnyArray
    follower_place: AnyArray
    """Index of each follower in a configuration."""
    follower_speed: AnyArray
    """Index of each follower in the library's velocities."""
    tie: AnyArray
    """Index of the first coupling of each linkage in the next three arrays, then the number of all couplings, (chains + 1,)."""
    tie_columns: AnyArray
    """Follower and leader of each coupling, numbered as in `column`, (t, 2)."""
    tie_places: AnyArray
    """Indices of the positions of follower and leader of each coupling in a configuration, (t, 2)."""
    tie_values: AnyArray
    """Ratio, offset in rad (m) and weight in m^2 of each coupling, (t, 3)."""
    gamma: AnyArray
    """Acceleration of each of the library's velocities while the velocities of the masters are constant, (w,)."""
    arms: AnyArray
    """Work space: axis and origin of each entry's joint, and the entry's column of J, (k, 9)."""
    work: AnyArray
    """Work space: rotation, three vectors, gap, drift of the gap, right-hand side, (30,)."""
    normal: AnyArray
    """Work space: normal equations with right-hand side and solution, (f, f + 2)."""


def make_loops(linkages: tuple[Linkage, ...], joint_q: AnyArray, joint_v: AnyArray, speeds: int) -> Loops:
    """Linkages, with the indices of their joints in a configuration and among the library's velocities."""
    owners = [(linkage, path) for linkage in linkages for path in linkage.paths]
    paths = [path for _, path in owners]
    first = _starts([len(path.joints) for path in paths])
    joint = np.array([j for path in paths for j in path.joints], dtype=np.int64)
    followers = np.array([j for linkage in linkages for j in linkage.joints[1:]], dtype=np.int64)
    ties = [(linkage, tie) for linkage in linkages for tie in linkage.ties]
    ends = np.array([(tie.follower, tie.leader) for _, tie in ties], dtype=np.int64).reshape(len(ties), 2)
    k, width = len(joint), max((len(linkage.joints) - 1 for linkage in linkages), default=0)
    return Loops(
        chains=len(linkages),
        width=width,
        loop=_starts([len(linkage.paths) for linkage in linkages]),
        first=first,
        second=np.array([a + path.split for a, path in zip(first[:-1], paths, strict=True)], dtype=np.int64),
        column=np.array([linkage.joints.index(j) - 1 for linkage, path in owners for j in path.joints], dtype=np.int64),
        place=joint_q[joint],
        speed=joint_v[joint],
        slides=np.array([int(one) for path in paths for one in path.slides], dtype=np.int64),
        origin=np.array([one for path in paths for one in path.origins], dtype=float).reshape(k, 3),
        turn=np.array([one for path in paths for one in path.turns], dtype=float).reshape(k, 9),
        axis=np.array([one for path in paths for one in path.axes], dtype=float).reshape(k, 3),
        ends=np.array([path.ends for path in paths], dtype=float).reshape(len(paths), 6),
        follower=_starts([len(linkage.joints) - 1 for linkage in linkages]),
        follower_joint=followers,
        follower_place=joint_q[followers],
        follower_speed=joint_v[followers],
        tie=_starts([len(linkage.ties) for linkage in linkages]),
        tie_columns=np.array(
            [[linkage.joints.index(j) - 1 for j in (tie.follower, tie.leader)] for linkage, tie in ties], dtype=np.int64
        ).reshape(len(ties), 2),
        tie_places=joint_q[ends],
        tie_values=np.array([(tie.ratio, tie.offset, linkage.size**2) for linkage, tie in ties]).reshape(len(ties), 3),
        gamma=np.zeros(speeds),
        arms=np.zeros((k, 9)),
        work=np.zeros(30),
        normal=np.zeros((width, width + 2)),
    )


def _starts(sizes: list[int]) -> AnyArray:
    """Index of the first member of each group, then the number of all members."""
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def find_columns(loops: Any, loop: int, q: Any) -> None:
    """Compute the gap (`work[21:24]`) of a loop and its columns of J (`arms[:, 6:]`) at the configuration q."""
    work, arms = loops.work, loops.arms
    for i in range(3):
        work[21 + i] = 0.0
    for side in range(2):
        begin = loops.second[loop] if side else loops.first[loop]
        end = loops.first[loop + 1] if side else loops.second[loop]
        sign = -1.0 if side else 1.0
        # The frame behind the last joint has the rotation work[0:9] and the position work[9:12].
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
    """Move the frame in `work` to behind the joint of entry k, and store the joint's axis and origin in `arms`."""
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
    # Turn each column of the rotation about the joint's axis by Rodrigues' formula.
    s, rest = sin(position), 1.0 - cos(position)
    for c in range(3):
        x, y, z = work[c], work[3 + c], work[6 + c]
        u, v, w = arms[k, 0], arms[k, 1], arms[k, 2]
        along = u * x + v * y + w * z
        work[c] = x + s * (v * z - w * y) + rest * (u * along - x)
        work[3 + c] = y + s * (w * x - u * z) + rest * (v * along - y)
        work[6 + c] = z + s * (u * y - v * x) + rest * (w * along - z)


def _turn_by(work: Any, turn: Any, k: int) -> None:
    """Multiply the rotation in `work` by the fixed rotation of joint frame k."""
    for i in range(3):
        x, y, z = work[3 * i], work[3 * i + 1], work[3 * i + 2]
        for c in range(3):
            work[3 * i + c] = x * turn[k, c] + y * turn[k, 3 + c] + z * turn[k, 6 + c]


def find_drift(loops: Any, loop: int, v: Any) -> None:
    """Compute the vector dJ/dt v of a loop (`work[24:27]`) at the velocities v. Call `find_columns` before.

    dJ/dt v is the sum of v_i v_k (axis x column) over all joints i and k on the same side: the axis of the earlier of the two
    joints, if this joint is a hinge, and the column of the later joint.
    """
    work, arms = loops.work, loops.arms
    for i in range(3):
        work[24 + i] = 0.0
    for side in range(2):
        begin = loops.second[loop] if side else loops.first[loop]
        end = loops.first[loop + 1] if side else loops.second[loop]
        # For a hinge i at or before k, column k changes by axis_i x column_k. For a joint i behind k, the change is axis_k x
        # column_i. Therefore the two orders give the same product.
        for k in range(begin, end):
            for i in range(begin, end):
                near, far = (i, k) if i <= k else (k, i)
                if loops.slides[near]:
                    continue
                rate = v[loops.speed[i]] * v[loops.speed[k]]
                for c in range(3):
                    a, b = (c + 1) % 3, (c + 2) % 3
                    work[24 + c] += rate * (arms[near, a] * arms[far, 6 + b] - arms[near, b] * arms[far, 6 + a])


def clear(loops: Any, chain: int) -> None:
    """Set the normal equations of a linkage to 0, before its loops and couplings are added."""
    count = loops.follower[chain + 1] - loops.follower[chain]
    for a in range(count):
        for b in range(count):
            loops.normal[a, b] = 0.0
        loops.normal[a, loops.width] = 0.0


def collect(loops: Any, loop: int) -> None:
    """Add the equations J_f x = -r of a loop to the normal equations of its linkage, with r in `work[27:30]`."""
    normal, arms, work = loops.normal, loops.arms, loops.work
    for k in range(loops.first[loop], loops.first[loop + 1]):
        a = loops.column[k]
        if a < 0:
            continue
        for i in range(loops.first[loop], loops.first[loop + 1]):
            b = loops.column[i]
            if b < 0:
                continue
            for c in range(3):
                normal[a, b] += arms[k, 6 + c] * arms[i, 6 + c]
        for c in range(3):
            normal[a, loops.width] -= arms[k, 6 + c] * work[27 + c]


def collect_tie(loops: Any, tie: int, residual: float) -> None:
    """Add the equation x_follower - ratio x_leader = -residual of a coupling to the normal equations of its linkage."""
    normal, ratio, weight = loops.normal, loops.tie_values[tie, 0], loops.tie_values[tie, 2]
    a, b = loops.tie_columns[tie, 0], loops.tie_columns[tie, 1]
    if a >= 0:
        normal[a, a] += weight
        normal[a, loops.width] -= weight * residual
    if b >= 0:
        normal[b, b] += weight * ratio * ratio
        normal[b, loops.width] += weight * ratio * residual
    if a >= 0 and b >= 0:
        normal[a, b] -= weight * ratio
        normal[b, a] -= weight * ratio


def solve_followers(loops: Any, chain: int) -> None:
    """Solve the normal equations of a linkage for its followers. The solution goes to the last column of `normal`."""
    solve_normal(loops.normal, loops.follower[chain + 1] - loops.follower[chain], loops.width, 1)


def solve_normal(normal: Any, count: int, width: int, sides: int) -> None:
    """Solve symmetric positive definite equations by Cholesky's decomposition. Their matrix (count, count) is at the beginning
    of the table `normal`, and is overwritten. A singular system gives values that are not finite.

    width: first column with a right-hand side; sides: number of right-hand sides. The solutions are in as many columns after
    the right-hand sides.
    """
    for k in range(count):
        for i in range(k + 1):
            value = normal[k, i]
            for c in range(i):
                value -= normal[k, c] * normal[i, c]
            if i < k:
                normal[k, i] = value / normal[i, i]
            else:
                normal[k, k] = value**0.5 if value > 0.0 else np.nan
        for side in range(width, width + sides):
            value = normal[k, side]
            for c in range(k):
                value -= normal[k, c] * normal[c, side]
            normal[k, side] = value / normal[k, k]
    for k in range(count - 1, -1, -1):
        for side in range(width, width + sides):
            value = normal[k, side]
            for c in range(k + 1, count):
                value -= normal[c, k] * normal[c, side + sides]
            normal[k, side + sides] = value / normal[k, k]


def find_ratios(loops: Any, ratio: Any, factor: Any, q: Any) -> None:
    """Compute the ratios of the followers to their masters, for all linkages at the configuration q."""
    for chain in range(loops.chains):
        clear(loops, chain)
        for loop in range(loops.loop[chain], loops.loop[chain + 1]):
            find_columns(loops, loop, q)
            for c in range(3):
                loops.work[27 + c] = 0.0
            for k in range(loops.first[loop], loops.first[loop + 1]):
                if loops.column[k] < 0:
                    for c in range(3):
                        loops.work[27 + c] += loops.arms[k, 6 + c]
            collect(loops, loop)
        for tie in range(loops.tie[chain], loops.tie[chain + 1]):
            residual = 0.0
            if loops.tie_columns[tie, 0] < 0:
                residual = 1.0
            elif loops.tie_columns[tie, 1] < 0:
                residual = -loops.tie_values[tie, 0]
            collect_tie(loops, tie, residual)
        solve_followers(loops, chain)
        first = loops.follower[chain]
        for k in range(first, loops.follower[chain + 1]):
            ratio[loops.follower_joint[k]] = factor[loops.follower_speed[k]] = loops.normal[k - first, loops.width + 1]


def find_gamma(loops: Any, q: Any, v: Any) -> None:
    """Compute the accelerations `gamma` at the configuration q and the velocities v of the library."""
    for chain in range(loops.chains):
        clear(loops, chain)
        for loop in range(loops.loop[chain], loops.loop[chain + 1]):
            find_columns(loops, loop, q)
            find_drift(loops, loop, v)
            for c in range(3):
                loops.work[27 + c] = loops.work[24 + c]
            collect(loops, loop)
        for tie in range(loops.tie[chain], loops.tie[chain + 1]):
            collect_tie(loops, tie, 0.0)
        solve_followers(loops, chain)
        first = loops.follower[chain]
        for k in range(first, loops.follower[chain + 1]):
            loops.gamma[loops.follower_speed[k]] = loops.normal[k - first, loops.width + 1]


def close_loops(loops: Any, q: Any) -> None:
    """Move the followers of all linkages until the gaps of the loops are closed. q: configuration in which the followers are
    already near their closed positions."""
    for chain in range(loops.chains):
        before = 1e300
        for _ in range(ROUNDS):
            gap = 0.0
            clear(loops, chain)
            for loop in range(loops.loop[chain], loops.loop[chain + 1]):
                find_columns(loops, loop, q)
                for c in range(3):
                    loops.work[27 + c] = loops.work[21 + c]
                    gap += abs(loops.work[21 + c])
                collect(loops, loop)
            for tie in range(loops.tie[chain], loops.tie[chain + 1]):
                leader = loops.tie_values[tie, 0] * q[loops.tie_places[tie, 1]] + loops.tie_values[tie, 1]
                residual = q[loops.tie_places[tie, 0]] - leader
                gap += abs(residual)
                collect_tie(loops, tie, residual)
            if gap < CLOSED or not gap < before:
                break
            before = gap
            solve_followers(loops, chain)
            first = loops.follower[chain]
            for k in range(first, loops.follower[chain + 1]):
                q[loops.follower_place[k]] += loops.normal[k - first, loops.width + 1]
