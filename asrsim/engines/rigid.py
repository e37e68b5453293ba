"""Steps of a robot without contacts, by the rule of `asrsim.engines.base`. A library gives the mass matrix and the bias.

`aim` sets the state at which the library evaluates mass matrix and bias, `kick` computes a piece of the kick, and `finish`
computes the drift. These functions run as Python or compiled. A state is a vector: configuration (base position in m, base
orientation w x y z, joint positions), velocities (base in m/s, base in rad/s about the axes of the base link, joints), the same
velocities before the last kick, and the states of friction and stops, `regime` of `asrsim.engines.exact_friction`.

The library contains no couplings. A joint that follows another one (`asrsim.robot.couplings`) has no velocity in the state: its
velocity is the velocity of its master times the ratio. Let dq = N dz, where dz are the velocities of the joints that follow no
other joint. The equations of motion of these joints have the mass matrix N^T M N and the bias N^T bias. This is exact for every
step, and the equations are solved like the equations of a robot without couplings.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Collection, Sequence
from functools import cache, partial
from math import cos, inf, sin, sqrt
from operator import is_
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from asrsim.compiled import compiling
from asrsim.compiled.compiling import Callback
from asrsim.compiled.packed import pack
from asrsim.engines.base import DAMPING, FRICTION, MIDDLE, POSITION, ROUNDING, TORQUE, VELOCITY, Engine, Native, Scene
from asrsim.engines.exact_friction import AT_UPPER, NEGATIVE, POSITIVE, STICKING, settle, solve_states
from asrsim.engines.loops import AnyArray, Loops, close_loops, find_gamma, find_ratios, make_loops
from asrsim.errors import Problem, RobotError
from asrsim.robot.dynamics import robot_model
from asrsim.robot.model import ZERO, Robot, Vector
from asrsim.robot.poses import frame, rotation_of
from asrsim.samples import Array, HeldWrench
from asrsim.scenario.data import Scenario

STEP, NOW, BEFORE, IMPLICITNESS = range(4)
"""Entries of `Room.scheme`. STEP: length of a step in s; NOW, BEFORE: weights of the present and of the previous velocity in
the velocity at the whole step; IMPLICITNESS: implicitness of the damping."""
SLOW = 1e-9
"""Speed in rad/s or m/s below which a joint at its stop counts as resting there, as a margin for rounding errors."""
INLINE = (
    "asrsim.engines.rigid",
    "asrsim.engines.loops",
    "asrsim.engines.exact_friction",
    "asrsim.engines.mujoco_step",
    "asrsim.engines.bullet",
)
"""Modules whose functions are compiled into the functions that call them."""
OF_LOOPS = "find_ratios", "find_gamma", "close_loops"
"""Functions that only robots with closed chains need. They are left out for other robots, since they would take a third of the
time of the first compilation."""
OF_COUPLINGS = "reduce", "reduce_force", "_place_followers"
"""Functions that only robots with coupled joints need."""


class Room(NamedTuple):
    """Work space of a step. In compiled code, arrays with one axis are pointers: their indices must not be negative, and their
    lengths are among the first four fields."""

    joints: int
    """Number n of joints."""
    freedoms: int
    """Number v of degrees of freedom."""
    speeds: int
    """Number w of velocities in the library, which contains no couplings of joints."""
    coordinates: int
    """Number q of values in a configuration."""
    scheme: AnyArray
    """Constants of the integration scheme, (4,); see `STEP`."""
    free: int
    """Flag: 1 if the base floats, else 0."""
    reduced: int
    """Flag: 1 if joints are coupled or have rotors, so that `reduce` must reduce the equations of the library; else 0."""
    qpos: AnyArray
    """Configuration (q,) at which the library evaluates mass matrix and bias."""
    qvel: AnyArray
    """Velocity (w,) at which the library evaluates mass matrix and bias."""
    full_matrix: AnyArray
    """Mass matrix (w, w) that the library computes, kg m^2. If `reduced` is 0, this array, `full_bias` and `full_force` are the
    arrays `matrix`, `bias` and `force` themselves."""
    full_bias: AnyArray
    """Torques (w,) in N m that the library computes. These torques balance gravity, Coriolis and centrifugal forces."""
    full_force: AnyArray
    """Generalised forces (w,) of the wrenches in a piece of the kick, N m."""
    owner: AnyArray
    """Degree of freedom of each of the library's velocities, (w,)."""
    factor: AnyArray
    """Ratio of each of the library's velocities to the velocity of its degree of freedom, (w,)."""
    matrix: AnyArray
    """Mass matrix (v, v), kg m^2."""
    bias: AnyArray
    """Torques (v,) in N m that balance gravity, Coriolis and centrifugal forces."""
    force: AnyArray
    """Generalised forces (v,) of the wrenches in a piece of the kick, N m."""
    diagonal: AnyArray
    """Diagonal (v,) of the mass matrix, including the implicit damping, kg m^2."""
    parent: AnyArray
    """Index (v,) of the parent of each degree of freedom: the previous degree of freedom on the path from the base; -1: none.
    The mass matrix is 0 for two degrees of freedom of which neither carries the other."""
    rebound: AnyArray
    """Factor (v,) on the velocity after the kick of a joint that leaves its stop; see `aim`."""
    impacts: AnyArray
    """Number of degrees of freedom that have struck their stops in the last drift, (1,)."""
    velocity: AnyArray
    """Velocity (v,) before a piece of the kick. `asrsim.engines.exact_friction.settle` explains this field, and the eight
    fields that follow `middle`."""
    middle: AnyArray
    """Velocity (v,) in the middle of the kick, which is the time of the positions before the drift. It does not contain the
    impact of a joint that strikes its stop in the drift, since the impact is later."""
    impulse: AnyArray
    bound: AnyArray
    slowest: AnyArray
    fastest: AnyArray
    change: AnyArray
    push: AnyArray
    regime: AnyArray
    square: AnyArray
    joint_q: AnyArray
    """Index of each joint's position in a configuration, (n,)."""
    joint_v: AnyArray
    """Index of each joint's velocity among the library's velocities, (n,)."""
    joint_z: AnyArray
    """Degree of freedom of each joint, (n,)."""
    master: AnyArray
    """Index of the joint that each joint follows, (n,). A joint that follows no other joint has its own index."""
    ratio: AnyArray
    """Ratio of each joint's velocity to the velocity of its degree of freedom, (n,)."""
    offset: AnyArray
    """Position of each joint while its master is at position 0, (n,), rad or m."""
    armature: AnyArray
    """Inertia of the rotors of each joint, as felt at the joint, (n,), kg m^2 (kg)."""
    loops: Loops
    """Linkages of the robot, whose joints form closed chains."""
    lower: AnyArray
    """Lower stops of the joints (n,), rad or m."""
    upper: AnyArray
    """Upper stops of the joints (n,), rad or m."""


def make_room(
    robot: Robot,
    *,
    qpos: Array,
    qvel: Array,
    joint_q: Sequence[int] | AnyArray,
    joint_v: Sequence[int] | AnyArray,
    free: bool,
    parent: AnyArray | None = None,
    reduce: bool = True,
) -> Room:
    """Work space for a robot. qpos, qvel: arrays that the library reads. parent: parents of the library's velocities, as in
    `Room`; parents precede the degrees of freedom that they carry. None: the mass matrix may have no zeros. reduce: whether
    asrsim adds couplings and rotors of joints to the equations; False: the library contains couplings and rotors."""
    w, joints = len(qvel), robot.moving_joints
    tree, at = np.arange(-1, w - 1) if parent is None else parent.astype(np.int64), np.array(joint_v, dtype=np.int64)
    lower, upper = np.array([joint.stops for joint in joints], dtype=float).reshape(-1, 2).T.copy()
    couplings, armature = robot.couplings, np.array([joint.armature for joint in joints])
    owner, factor = np.arange(w), np.ones(w)
    reduced = reduce and (bool(couplings) or bool(armature.any()))
    if reduced:
        owner[at], factor[at] = at[couplings.master], couplings.ratio
        kept, owner = np.unique(owner, return_inverse=True)
        tree = _reduced_tree(tree, owner.ravel(), len(kept))
    size = len(tree)
    fields: dict[str, Any] = {name: np.zeros(size) for name in Room._fields}
    square = {"matrix": np.zeros((size, size)), "bias": np.zeros(size), "force": np.zeros(size)}
    whole = {"matrix": np.zeros((w, w)), "bias": np.zeros(w), "force": np.zeros(w)} if reduced else square
    fields |= {
        **square, **{f"full_{name}": array for name, array in whole.items()},
        "joints": len(joints), "freedoms": size, "speeds": w, "coordinates": len(qpos), "scheme": np.zeros(4),
        "free": int(free), "reduced": int(reduced), "qpos": qpos, "qvel": qvel,
        "regime": np.zeros(size, dtype=np.int64), "impacts": np.zeros(1, dtype=np.int64), "parent": tree,
        "square": np.zeros((size, size)), "slowest": np.full(size, -inf), "fastest": np.full(size, inf),
        "owner": owner.astype(np.int64), "factor": factor, "joint_q": np.array(joint_q, dtype=np.int64), "joint_v": at,
        "joint_z": owner[at].astype(np.int64), "master": couplings.master if reduced else np.arange(len(joints)),
        "ratio": couplings.ratio.copy() if reduced else np.ones(len(joints)),
        "offset": couplings.offset if reduced else np.zeros(len(joints)), "armature": armature,
        "loops": make_loops(couplings.linkages if reduced else (), np.array(joint_q, dtype=np.int64), at, w),
        "lower": lower, "upper": upper,
    }  # fmt: skip
    return Room(**fields)


def _reduced_tree(parent: AnyArray, owner: AnyArray, size: int) -> AnyArray:
    """Parents (size,) of the degrees of freedom of the reduced mass matrix, as in `Room.parent`: its elimination tree. parent:
    parents of the library's velocities; owner: degree of freedom of each of these velocities."""
    coupled = np.zeros((size, size), dtype=bool)
    for k in range(len(parent)):
        i = k
        while i >= 0:
            coupled[owner[k], owner[i]] = coupled[owner[i], owner[k]] = True
            i = int(parent[i])
    tree = np.full(size, -1, dtype=np.int64)
    for a in range(size - 1, -1, -1):
        below = np.flatnonzero(coupled[a, :a])
        if below.size:
            tree[a] = below[-1]
            # The elimination of degree of freedom a couples all degrees of freedom that are coupled to a.
            coupled[np.ix_(below, below)] = True
    return tree


WORK_SPACE = (
    "diagonal", "rebound", "impacts", "velocity", "middle", "impulse", "bound", "slowest", "fastest", "change", "push",
    "regime", "parent", "owner", "joint_q", "joint_v", "joint_z", "master", "lower", "upper",
)  # fmt: skip
"""Arrays of a room that are constant, or that a step writes before it reads them, if the step begins with `aim`."""


def plain(record: Any, own: Collection[str] = ()) -> Any:
    """The record with memoryviews in place of arrays, since Python reads single numbers from memoryviews several times faster.
    own: names of the arrays that no other code uses. These arrays become lists, from which Python reads numbers even faster."""

    def field(name: str, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.tolist() if name in own else value.data
        return value if isinstance(value, int) else plain(value, own)

    return type(record)._make(map(field, record._fields, record))


def aim(room: Any, state: Any) -> None:
    """Set the configuration and velocity at the whole step, for which the library evaluates mass matrix and bias, and the
    velocity and the states of friction before the kick.

    Consider a joint that has struck its stop in the last drift, after the fraction f of the drift. Until then it had its old
    velocity v_before, so f = v / v_before, where v is the velocity that leads exactly to the stop. The forces of this kick act
    on the joint only after the impact, for 1.5 - f steps instead of one step. `room.rebound` stores this number; for all other
    degrees of freedom it stores 1.
    """
    qpos, qvel, scheme, velocity, regime, rebound = room.qpos, room.qvel, room.scheme, room.velocity, room.regime, room.rebound
    first, size, impacts = room.coordinates, room.freedoms, 0
    for i in range(first):
        qpos[i] = state[i]
    for i in range(size):
        velocity[i] = state[first + i]
        before = state[first + size + i]
        if room.reduced == 0:
            qvel[i] = scheme[NOW] * velocity[i] + scheme[BEFORE] * before
        regime[i] = int(state[first + 2 * size + i])
        rebound[i] = 1.0
        # Rounding may leave a velocity in a joint that rests on a stop.
        if abs(regime[i]) == AT_UPPER and velocity[i] * regime[i] > ROUNDING * abs(before):
            rebound[i] = 1.5 - min(velocity[i] / before, 1.0) if before * velocity[i] > 0.0 else 0.5
            impacts += 1 if rebound[i] != 1.0 else 0
    room.impacts[0] = impacts
    if room.loops.chains:
        find_ratios(room.loops, room.ratio, room.factor, qpos)
    for k in range(room.speeds if room.reduced else 0):
        i = room.owner[k]
        qvel[k] = room.factor[k] * (scheme[NOW] * velocity[i] + scheme[BEFORE] * state[first + size + i])
    if room.loops.chains:
        find_gamma(room.loops, qpos, qvel)


def reduce(room: Any) -> None:
    """Compute mass matrix and bias of the degrees of freedom from the mass matrix and bias of the library."""
    for i in range(room.freedoms):
        room.bias[i] = 0.0
        for k in range(room.freedoms):
            room.matrix[i, k] = 0.0
    for a in range(room.speeds):
        i = room.owner[a]
        room.bias[i] += room.factor[a] * room.full_bias[a]
        for b in range(room.speeds if room.loops.chains else 0):
            room.bias[i] += room.factor[a] * room.full_matrix[a, b] * room.loops.gamma[b]
        for b in range(room.speeds):
            room.matrix[i, room.owner[b]] += room.factor[a] * room.factor[b] * room.full_matrix[a, b]
    for j in range(room.joints):
        i = room.joint_z[j]
        room.matrix[i, i] += room.ratio[j] * room.ratio[j] * room.armature[j]
        room.bias[i] += room.ratio[j] * room.armature[j] * room.loops.gamma[room.joint_v[j]]


def reduce_force(room: Any) -> None:
    """Compute the generalised forces on the degrees of freedom from the generalised forces on the library's velocities."""
    for i in range(room.freedoms):
        room.force[i] = 0.0
    for a in range(room.speeds):
        room.force[room.owner[a]] += room.factor[a] * room.full_force[a]


def kick(room: Any, exchange: Any, piece: int, lengths: Any) -> None:
    """Change `room.velocity` and `room.middle` in a piece of the kick. lengths: lengths of the pieces as fractions of a step.

    The piece is split at the time at which the velocity of a joint with friction becomes 0. In the rest of the piece, the joint
    sticks or slides in the other direction. Before the first piece, the stops take the rest of the velocity from the joints
    that have struck them in the last drift.
    """
    count, length, last = room.joints, lengths[piece], piece == len(lengths) - 1
    # Compute the time from the beginning of the piece to the middle of the kick, as a fraction of a step.
    ahead = 0.0
    for k in range(len(lengths)):
        ahead += 0.5 * lengths[k] if k >= piece else -0.5 * lengths[k]
    for i in range(room.freedoms if piece == 0 else 0):
        room.middle[i] = room.velocity[i]
    splits, resting, free, noted = 0, -1, False, False
    impact = piece == 0 and room.impacts[0] > 0
    # `whole`: whether this part covers the rest of the piece. Search for a velocity that becomes 0 in the part only in this
    # case.
    part, whole = 0.0 if impact else length, not impact
    # Call `find_change` at only one place, since the compiler copies it to each place at which it is called.
    while True:
        find_change(room, exchange, piece, part, last and not free)
        if whole and splits < count and not free:
            resting = first_standstill(room)
            if resting != -1:
                part *= -room.velocity[resting] / room.change[resting]
                whole = False
                continue
        if ahead > 0.0 and not noted:
            if not free and _has_strike(room):
                # The middle of the kick is before the impact, so compute the change up to the middle without the stop.
                free = True
                continue
            share = min(ahead / part, 1.0) if part > 0.0 else 1.0
            for i in range(room.freedoms):
                room.middle[i] += share * room.change[i]
            if free:
                free, noted = False, True
                continue
        ahead, noted = ahead - part, False
        for i in range(room.freedoms):
            room.velocity[i] += room.change[i]
        if whole:
            break
        if resting != -1:
            # Set a velocity that is 0 except for rounding errors to 0. If damping acts, or if another joint strikes its stop in
            # this part, the velocity is larger.
            if abs(room.velocity[resting]) < ROUNDING * abs(room.change[resting]):
                room.velocity[resting] = 0.0
            length -= part
            splits += 1
        part, whole, resting = length, True, -1


def _has_strike(room: Any) -> bool:
    """Whether a joint strikes its stop in the drift that follows this kick."""
    count = 0
    for i in range(room.freedoms):
        goal = room.velocity[i] + room.change[i]
        if abs(room.regime[i]) == AT_UPPER and (abs(goal) > SLOW or abs(room.velocity[i]) > SLOW):
            count += 1
    return count > 0


def find_change(room: Any, exchange: Any, piece: int, length: float, last: bool) -> None:
    """Compute `room.change`, the change of velocity in a part of a piece of the kick. In this part no sliding direction
    changes.

    length: length of the part as a fraction of a step; last: whether the drift follows this part. If the drift does not follow,
    stops act only on joints that rest at them.
    """
    step, implicitness = room.scheme[STEP], room.scheme[IMPLICITNESS]
    velocity, impulse, diagonal, bound = room.velocity, room.impulse, room.diagonal, room.bound
    slowest, fastest, regime = room.slowest, room.fastest, room.regime
    time = length * step
    for i in range(room.freedoms):
        impulse[i] = time * (room.force[i] - room.bias[i])
        diagonal[i] = room.matrix[i, i]
        bound[i] = 0.0
    for j in range(room.joints):
        i, damping = room.joint_z[j], exchange[piece, j, DAMPING]
        if room.reduced:
            ratio = room.ratio[j]
            impulse[i] += time * (ratio * (exchange[piece, j, TORQUE] - damping * (ratio * velocity[i])))
            diagonal[i] += implicitness * time * (ratio * ratio * damping)
            bound[i] += time * abs(ratio) * exchange[piece, j, FRICTION]
            if room.master[j] != j:
                continue
        else:
            impulse[i] += time * (exchange[piece, j, TORQUE] - damping * velocity[i])
            diagonal[i] += implicitness * time * damping
            bound[i] += time * exchange[piece, j, FRICTION]
        position = room.qpos[room.joint_q[j]]
        # The drift after the kick moves a joint at most to its stop. A joint that is already beyond its stop stays there, since
        # pushing it back would give it a velocity.
        slowest[i] = min((room.lower[j] - position) / step, 0.0)
        fastest[i] = max((room.upper[j] - position) / step, 0.0)
        if not last and slowest[i] < -SLOW:
            slowest[i] = -inf
            regime[i] = max(regime[i], NEGATIVE)
        if not last and fastest[i] > SLOW:
            fastest[i] = inf
            regime[i] = min(regime[i], POSITIVE)
    settle(room)


def first_standstill(room: Any) -> int:
    """Index of the degree of freedom with friction whose velocity is the first to reach 0 under `room.change`; -1 if no
    velocity reaches 0.

    As long as a joint slides, its friction opposes its velocity. If velocities reach 0, `room.change` is therefore computed
    again with full friction on these joints. A velocity reaches 0 after the fraction -velocity / change of the part. The result
    is -1 in a kick with an impact at a stop, since the velocities are then not linear in time.
    """
    velocity, change = room.velocity, room.change
    count = 0
    for i in range(room.freedoms):
        if abs(room.regime[i]) == AT_UPPER and change[i] != 0.0:
            return -1
    for i in range(room.freedoms):
        if _reaches_zero(room, i):
            room.regime[i] = POSITIVE if velocity[i] > 0.0 else NEGATIVE
            count += 1
    first = -1
    if count > 0:
        solve_states(room)
        for i in range(room.freedoms):
            if not _reaches_zero(room, i):
                continue
            if first == -1 or abs(velocity[i] * change[first]) < abs(velocity[first] * change[i]):
                first = i
        if first == -1:
            settle(room)
    return first


def _reaches_zero(room: Any, i: int) -> bool:
    """Whether the degree of freedom `i` has friction, and its velocity reaches 0 or changes its sign under `room.change`."""
    velocity = room.velocity[i]
    if room.bound[i] == 0.0 or velocity == 0.0:
        return False
    return room.regime[i] == STICKING or velocity * (velocity + room.change[i]) < 0.0  # type: ignore[no-any-return]


def _leave_stops(room: Any, state: Any) -> None:
    """Multiply the velocity of each joint that leaves its stop after an impact by `rebound`, with an impulse on this joint.

    If forces reverse the motion of a joint within a step, its velocity does not give the time of its impact: the `rebound` of
    this joint then becomes 1.
    """
    old, leaving = room.coordinates + room.freedoms, 0
    for i in range(room.freedoms):
        room.impulse[i] = room.bound[i] = 0.0
        room.diagonal[i] = room.matrix[i, i]
        if abs(room.regime[i]) != POSITIVE or abs(room.velocity[i]) > abs(state[old + i]):
            room.rebound[i] = 1.0
        elif room.rebound[i] != 1.0:
            # The number of a sliding state, doubled, is the number of the state at a stop. In the state at a stop,
            # `solve_states` gives the joint the velocity that is prescribed here.
            room.slowest[i] = room.fastest[i] = room.rebound[i] * room.velocity[i]
            room.regime[i] *= AT_UPPER
            leaving += 1
    if leaving == 0:
        return
    solve_states(room)
    for i in range(room.freedoms):
        room.velocity[i] += room.change[i]
        room.middle[i] += room.change[i]
        if room.rebound[i] != 1.0:
            room.regime[i] //= AT_UPPER


def finish(room: Any, state: Any, exchange: Any, lengths: Any) -> None:
    """Compute the drift after the kick, and write the new state to `state` and `exchange`."""
    step = room.scheme[STEP]
    if room.impacts[0]:
        _leave_stops(room, state)
    first, size = room.coordinates, room.freedoms
    total = 0.0
    for piece in range(len(lengths)):
        total += lengths[piece]
    rest = 1.0 - 1.0 / total
    for i in range(size):
        before, after = state[first + i], room.velocity[i]
        # After a first kick that is shorter than a step, store a hypothetical old velocity, from which a full kick would have
        # led to the new velocity.
        state[first + size + i] = before + rest * (after - before)
        state[first + i] = after
        state[first + 2 * size + i] = float(room.regime[i])
    if room.free:
        _turn(state, first, step)
    last = len(lengths) - 1
    for j in range(room.joints):
        if room.reduced == 0 or room.master[j] == j:
            speed = state[first + room.joint_z[j]]
            place = room.joint_q[j]
            state[place] += step * speed
            exchange[last, j, POSITION] = state[place]
            exchange[last, j, VELOCITY] = speed
            exchange[last, j, MIDDLE] = room.middle[room.joint_z[j]]
    if room.reduced:
        _place_followers(room, state, step)
        for j in range(room.joints):
            place = room.joint_q[j]
            exchange[last, j, POSITION] = state[place]
            exchange[last, j, VELOCITY] = room.ratio[j] * state[first + room.joint_z[j]]
            exchange[last, j, MIDDLE] = room.ratio[j] * room.middle[room.joint_z[j]]
            if room.loops.chains and room.master[j] != j:
                # Store the mean velocity of the drift, since the ratio of a joint in a loop varies during the drift.
                exchange[last, j, VELOCITY] = (state[place] - room.qpos[place]) / step


def _place_followers(room: Any, state: Any, step: float) -> None:
    """Set the positions of the joints that follow other joints, after a drift of `step` s. At the start of a run, `step` is
    0."""
    loops, first = room.loops, room.coordinates
    for k in range(loops.follower[loops.chains]):
        j = loops.follower_joint[k]
        state[loops.follower_place[k]] += step * room.ratio[j] * state[first + room.joint_z[j]]
    if loops.chains:
        close_loops(loops, state)
    for j in range(room.joints):
        if room.master[j] != j and (loops.chains == 0 or not _in_loop(loops, j)):
            state[room.joint_q[j]] = room.ratio[j] * state[room.joint_q[room.master[j]]] + room.offset[j]


def _in_loop(loops: Any, j: int) -> bool:
    """Whether joint j belongs to a loop."""
    count = 0
    for k in range(loops.follower[loops.chains]):
        if loops.follower_joint[k] == j:
            count += 1
    return count > 0


def advance(room: Any, state: Any, exchange: Any, forces: Any, lengths: Any) -> None:
    """Compute kick and drift from the mass matrix and bias in the room, then aim at the next step.

    forces: generalised forces (p, w, 1) of the wrenches in N m.
    """
    if room.reduced:
        reduce(room)
    for piece in range(len(lengths)):
        for i in range(room.speeds):
            room.full_force[i] = forces[piece, i, 0]
        if room.reduced:
            reduce_force(room)
        kick(room, exchange, piece, lengths)
    finish(room, state, exchange, lengths)
    aim(room, state)


def _turn(state: Any, first: int, step: float) -> None:
    """Compute the drift of a floating base, whose pose is the first seven values of the state. Velocities begin at index
    `first`."""
    for i in range(3):
        state[i] += step * state[first + i]
    x, y, z = state[first + 3], state[first + 4], state[first + 5]
    speed = sqrt(x * x + y * y + z * z)
    half = 0.5 * step * speed
    share = sin(half) / speed if speed > 0.0 else 0.0
    w, x, y, z = cos(half), share * x, share * y, share * z
    a, b, c, d = state[3], state[4], state[5], state[6]
    e, f = a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y
    g, h = a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w
    size = sqrt(e * e + f * f + g * g + h * h)
    state[3] = e / size
    state[4] = f / size
    state[5] = g / size
    state[6] = h / size


def _sizes(room: Any) -> tuple[int, int, int]:
    """Sizes of the other arguments of the step; see `asrsim.compiled.compiling.compile_packed`."""
    return room.joints, room.speeds, 1


def unused(room: Any) -> tuple[str, ...]:
    """Names of the functions that a step never calls for the robot of this room, so that compiled code can leave them out."""
    return () if room.loops.chains else OF_LOOPS if room.reduced else (*OF_LOOPS, *OF_COUPLINGS)


def skip(*arguments: Any) -> None:
    """Do nothing. This function replaces each function that `unused` names."""


_steps: dict[Any, Callback] = {}
"""Functions of rooms that this process has compiled, by `_key`."""


def _key(function: Callable[..., None], room: Any) -> Any:
    """What the compiled function of a room depends on: the function, the types in the room, and the names left out."""
    return function, compiling.type_of(room), unused(room)


def _compiled(function: Callable[..., None], room: Any) -> Callback:
    key = _, kind, left_out = _key(function, room)
    if key not in _steps:
        _steps[key] = compiling.compile_packed(function, kind, _sizes, names=dict.fromkeys(left_out, skip), inline=INLINE)
    return _steps[key]


class Calculation:
    """A function that changes a record (such as a room), a vector of numbers (such as a state) and an exchange. Its further
    arguments are the forces or wrenches, and the lengths (p,) of the pieces of a kick.

    The function runs as Python until it is compiled, unless this process has already compiled it for another room. Python and
    compiled code give bitwise the same results.
    """

    def __init__(
        self,
        function: Callable[..., None],
        record: Any,
        make: Callable[[Any], Callback] | None = None,
        *,
        own: Collection[str] = (),
    ) -> None:
        """make: function that returns the compiled function for records of a Numba type; None: the record is a `Room`. own:
        names of the record's arrays that only this function uses."""
        self._function, self._record, self._make = function, record, make
        self._plain, self.packed = plain(record, own), pack(record)
        self._compiled: Callback | None = None
        self._arrays: tuple[Array, ...] = ()
        """Arrays of the last call, with the arguments that were made from them, since callers often pass the same arrays
        again."""
        self._arguments: tuple[Any, ...] = ()
        self._call = function

    def compile(self) -> Callback:
        """Compile the function for all later calls, and return the compiled function."""
        if self._compiled is None:
            make = self._make
            self._compiled = make(compiling.type_of(self._record)) if make else _compiled(self._function, self._record)
            # Call through CFUNCTYPE, which releases the interpreter's lock.
            self._call = ctypes.CFUNCTYPE(None, *[ctypes.c_ssize_t] * 6)(self._compiled.address)
            self._arrays = ()
        return self._compiled

    def __call__(self, *arrays: Array) -> None:
        """Apply the function to a vector of numbers, an exchange, forces and lengths."""
        if len(self._arrays) != len(arrays) or not all(map(is_, arrays, self._arrays)):
            if not self._arrays and self._make is None and _steps and _key(self._function, self._record) in _steps:
                self.compile()
            self._arrays, self._arguments = arrays, (self._plain, *[array.data for array in arrays])
            if self._compiled is not None:
                self._arguments = *[array.ctypes.data for array in (self.packed, *arrays)], len(arrays[-1])
        self._call(*self._arguments)


class RigidEngine(Engine):
    """The part of an engine for robots without contacts that is the same for every physics library.

    An engine derives from this class and adds `look` and the other members of `asrsim.engines.base.Engine` for its library. It
    sets `robot` before it calls `__init__`.
    """

    robot: Robot
    warnings: tuple[Problem, ...] = ()
    """Warnings about parts of the robot that the engine ignores."""
    root: str
    """Name of the base link."""
    origin: Vector = ZERO
    """Origin of the base's frame, in the frame of the base link, m; see `asrsim.robot.merge.merge_for_engine`."""

    def __init__(
        self, room: Room, home: Array, calculation: Calculation | None = None, *, scenario: Scenario | None = None
    ) -> None:
        """home: initial configuration (q,); its joint positions are not used. calculation: the part of a step that may be
        compiled; None: kick and drift. scenario: scenario whose wrenches act on the robot; None: the engine refuses scenarios
        with wrenches."""
        self.takes_wrenches = scenario is not None
        self._wrenches = scenario.wrenches if scenario else ()
        self._held: tuple[HeldWrench, ...] = ()
        """Wrenches that are held on links."""
        self._make_model = None if scenario is None else cache(partial(robot_model, scenario, self.robot))
        """Function that returns the model that maps wrenches to generalised forces."""
        self._room, self._home = room, home
        self._state = np.zeros(room.coordinates + 3 * room.freedoms)
        self._plain_room, self._numbers = plain(room), self._state.data
        self._changed = True
        """Whether the state was changed from outside since the last step."""
        self._forces = np.zeros((1, room.speeds, 1))
        self._calculation = calculation or Calculation(advance, room)

    def look(self, wrenches: Array, forces: Array) -> None:
        """Compute `full_matrix` and `full_bias` of the room at its `qpos` and `qvel`.

        On entry, `forces` (p, w, 1) contains the generalised forces in N m of the wrenches (p, w, 6), by the Jacobian of
        `asrsim.robot.dynamics.RobotModel`. An engine may replace them by the forces that its library computes.
        """
        raise NotImplementedError

    def map_wrenches(self, wrenches: Array, forces: Array) -> None:
        """Write to `forces` (p, w, 1) the generalised forces in N m of the wrenches (p, w, 6) and of the wrenches that are
        held, at the room's `qpos`."""
        forces[:] = 0.0
        loads = [
            (one.link, one.point, one.frame == "world", wrenches[:, index])
            for index, one in enumerate(self._wrenches)
            if wrenches[:, index].any()
        ]
        loads += [(one.body, one.point, True, np.tile([*one.force, *one.torque], (len(forces), 1))) for one in self._held]
        if self._make_model is None or not loads:
            return
        room, model = self._room, self._make_model()
        positions, rotation, base = room.qpos[room.joint_q], self.rotation, None
        if rotation is not None:
            # Place a floating robot so that the origin of its base's frame is at 0, since the torques on the base are about
            # this point.
            base = frame(-rotation @ self.origin, rotation)
        for link, point, world, values in loads:
            at, turned = model.pose(positions, link, point, base)
            jacobian = model.jacobian(positions, link, point, base)
            for total, value in zip(forces[:, :, 0], values.reshape(-1, 2, 3), strict=True):
                force, torque = value if world else value @ turned.T
                total[room.joint_v] += np.concatenate([force, torque]) @ jacobian
                if rotation is not None:
                    total[:3] += force
                    total[3:6] += (torque + np.cross(at, force)) @ rotation

    @property
    def holdable(self) -> tuple[str, ...]:
        """The robot's links, if the engine takes wrenches."""
        return tuple(link.name for link in self.robot.links) if self.takes_wrenches else ()

    def hold(self, wrenches: Sequence[HeldWrench]) -> None:
        """Hold wrenches on links; see `asrsim.engines.base.Engine`."""
        links = {link.name for link in self.robot.links}
        self._held = tuple(one for one in wrenches if one.body in links)
        self._forces[:] = 0.0

    @property
    def rotation(self) -> Array | None:
        """Rotation matrix (3, 3) of a floating base in the room's configuration; None for a fixed base."""
        if not self._room.free:
            return None
        w, *vector = self._room.qpos[3:7].tolist()
        return rotation_of((*vector, w))

    def start(
        self, positions: Sequence[float], velocities: Sequence[float], *, step: float, staggered: bool, implicitness: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Begin a run; see `asrsim.engines.base.Engine`. The returned positions and velocities satisfy the couplings of
        joints."""
        room, state = self._room, self._state
        first, size = room.coordinates, room.freedoms
        room.scheme[:] = (step, 1.5, -0.5, implicitness) if staggered else (step, 1.0, 0.0, implicitness)
        state[:first] = self._home
        state[first:] = 0.0
        state[room.joint_q] = positions
        own = room.master == np.arange(room.joints)
        state[first + room.joint_z[own]] = np.asarray(velocities)[own]
        state[first + size : first + 2 * size] = state[first : first + size]
        if room.reduced:
            _place_followers(room, state, 0.0)
            self._check_loops()
            positions, velocities = state[room.joint_q].tolist(), (room.ratio * state[first + room.joint_z]).tolist()
        self._changed = True
        self.begin()
        return positions, velocities

    def _check_loops(self) -> None:
        """Raise RobotError if a linkage is not closed at the initial positions, or if its master stands at a dead centre
        there."""
        room = self._room
        for linkage in self.robot.couplings.linkages if room.loops.chains else ():
            reason = linkage.fault(self._state[room.joint_q])
            if reason:
                message = reason if reason.startswith("no positions") else f"joint '{self.joints[linkage.master]}' {reason}"
                raise RobotError(message, file=self.robot.path, key=f"loops.{linkage.loops[0]}", code="loop")
        if room.loops.chains:
            find_ratios(room.loops, room.ratio, room.factor, self._state)

    def begin(self) -> None:
        """Prepare the library for a run that begins at the present state."""

    def step(self, exchange: Array, wrenches: Array, lengths: Array) -> None:
        """Advance the robot by one step; see `asrsim.engines.base.Engine`."""
        if len(self._forces) != len(lengths):
            self._forces = np.zeros((len(lengths), self._room.speeds, 1))
        if self._changed:
            aim(self._plain_room, self._numbers)
            self._changed = False
        if wrenches.size or self._held:
            self.map_wrenches(wrenches, self._forces)
        self.look(wrenches, self._forces)
        self._calculation(self._state, exchange, self._forces, lengths)

    @property
    def native(self) -> Native | None:
        """None, since `look` calls the library from Python. After `native` has been read, the rest of the step runs compiled,
        if Numba is installed. The results are bitwise the same."""
        if compiling.numba_available():
            self._calculation.compile()
        return None

    @property
    def room(self) -> Room:
        """Work space of the step, which also has the indices and stops of the joints."""
        return self._room

    @property
    def coordinates(self) -> NDArray[np.int64]:
        """Indices (3, n) of the joints' positions, velocities, and velocities before the last kick in a state."""
        room = self._room
        velocities = room.coordinates + room.joint_v
        return np.stack([room.joint_q, velocities, velocities + room.freedoms]).astype(np.int64)

    @property
    def state(self) -> Array:
        """The state as a vector, with the parts that the docstring of the module lists."""
        return self._state.copy()

    @state.setter
    def state(self, values: Array) -> None:
        self._state[:] = values
        self._changed = True

    def scene(self) -> Scene:
        """Pose of the base link, if the base floats. The base position in a state is the position of the point `origin` of this
        link."""
        if not self._room.free:
            return Scene({}, {})
        w, *vector = self._state[3:7].tolist()
        origin = self._state[:3] - rotation_of((*vector, w)) @ self.origin
        return Scene({self.root: (*origin.tolist(), *vector, w)}, {})

    def vary(self, robot: Robot) -> bool:
        """Whether the robot has the same inertials as before. An engine that can change inertials overrides this method."""
        return robot.inertials == self.robot.inertials
