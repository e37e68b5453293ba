"""Mass matrix of a robot at one posture, as loops over its bodies, for programs that need it thousands of times per second.

The equations are the equations of `asrsim.robot.dynamics.RobotModel.mass_matrix`, which takes many postures at once. The loops
run as Python or compiled.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np


class Chain(NamedTuple):
    """A robot on a fixed base without coupled joints (n joints), and its work space. Joint k moves body k + 1; body 0 stands
    still.
    """

    parents: Any
    """Body that carries each joint's body, (n,); its number is smaller than the number of the body that it carries."""
    places: Any
    """Index (n,) of each of the robot's joints in the other arrays."""
    slides: Any
    """Whether each joint slides, (n,)."""
    origins: Any
    """Pose (n, 4, 4) of each joint in the frame of the body that carries it."""
    twists: Any
    """Twist (n, 4, 4) of each joint's body at unit velocity."""
    squares: Any
    """Squares (n, 4, 4) of the twists."""
    inertias: Any
    """Pseudo-inertia (n, 4, 4) of each joint's body."""
    armature: Any
    """Inertia of each joint's rotors, (n,), kg m^2 (kg)."""
    poses: Any
    """Work space (n + 1, 4, 4): pose of each body; the first pose is the pose of the base."""
    turned: Any
    """Work space (n, 4, 4): twist of each joint in the world frame."""
    carried: Any
    """Work space (n, 4, 4): pseudo-inertia, in the world frame, of all bodies that each joint carries."""
    room: Any
    """Work space (4, 4) for a product of matrices."""


def find_masses(chain: Chain, positions: Any, matrix: Any) -> None:
    """Compute the mass matrix (n, n) in kg m^2 (kg) at the positions (n,) in rad (m)."""
    count, poses, room = len(chain.parents), chain.poses, chain.room
    for k in range(count):
        chain.carried[k] = 0.0
    for j in range(count):
        k = chain.places[j]
        q, twist, square = positions[j], chain.twists[k], chain.squares[k]
        first, second = (q if chain.slides[k] else math.sin(q)), 1.0 - math.cos(q)
        for a in range(4):
            for b in range(4):
                room[a, b] = first * twist[a, b] + second * square[a, b] + (1.0 if a == b else 0.0)
        multiply(chain.origins[k], room, chain.turned[k])
    for k in range(count):
        multiply(poses[chain.parents[k]], chain.turned[k], poses[k + 1])
        turn_twist(poses[k + 1], chain.twists[k], room, chain.turned[k])
    for k in range(count - 1, -1, -1):
        add_turned(poses[k + 1], chain.inertias[k], room, chain.carried[k])
        if chain.parents[k]:
            above = chain.carried[chain.parents[k] - 1]
            for a in range(4):
                for b in range(4):
                    above[a, b] += chain.carried[k, a, b]
    for j in range(count):
        k = chain.places[j]
        multiply(chain.turned[k], chain.carried[k], room)
        for i in range(count):
            if not _carries(chain, chain.places[i], k):
                if not _carries(chain, k, chain.places[i]):
                    matrix[i, j] = matrix[j, i] = 0.0
                continue
            other, total = chain.turned[chain.places[i]], 0.0
            for a in range(4):
                for b in range(4):
                    total += room[a, b] * other[a, b]
            matrix[i, j] = matrix[j, i] = total
        matrix[j, j] += chain.armature[k]


def _carries(chain: Chain, above: int, k: int) -> bool:
    """Whether joint `above` carries the body of joint k."""
    while k > above:
        k = chain.parents[k] - 1
    return k == above


def multiply(first: Any, second: Any, product: Any) -> None:
    """Write the product of two matrices (4, 4)."""
    for a in range(4):
        for b in range(4):
            total = 0.0
            for c in range(4):
                total += first[a, c] * second[c, b]
            product[a, b] = total


def turn_twist(pose: Any, twist: Any, room: Any, turned: Any) -> None:
    """Write the twist of a body in the world frame, from its twist in the body frame: pose twist pose^-1."""
    multiply(pose, twist, room)
    for a in range(4):
        for b in range(3):
            total = 0.0
            for c in range(3):
                total += room[a, c] * pose[b, c]
            turned[a, b] = total
    for a in range(4):
        total = room[a, 3]
        for c in range(3):
            total -= turned[a, c] * pose[c, 3]
        turned[a, 3] = total


def add_turned(pose: Any, inertia: Any, room: Any, target: Any) -> None:
    """Add the pseudo-inertia of a body in the world frame: pose inertia pose^T."""
    multiply(pose, inertia, room)
    for a in range(4):
        for b in range(4):
            total = 0.0
            for c in range(4):
                total += room[a, c] * pose[b, c]
            target[a, b] += total


def work_space(bodies: int, base: Any) -> dict[str, Any]:
    """Work space of a chain with this number of moving bodies on a base with this pose (4, 4)."""
    poses = np.zeros((bodies + 1, 4, 4))
    poses[0] = base
    return {"poses": poses, "turned": np.zeros((bodies, 4, 4)), "carried": np.zeros((bodies, 4, 4)), "room": np.zeros((4, 4))}
