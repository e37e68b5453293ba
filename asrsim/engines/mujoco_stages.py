"""One step of a robot without contacts on MuJoCo's rigid-body routines: ordinary code, run as it is or compiled.

The routines named below are bound by :mod:`asrsim.engines.mujoco`: to the library through ctypes for plain Python, to its
symbols for compiled code. Coulomb friction and joint stops are exact: impulses in bounds, found by principal pivoting.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from asrsim.engines.exact_friction import is_held, settle, sliding_impulse
from asrsim.engines.mujoco_world import BEFORE, FRACTION, NOW, STEP, Numbers, World


def _unbound(*arguments: Any) -> None:
    raise NotImplementedError("bound by asrsim.engines.mujoco")


mj_kinematics = mj_comPos = mj_comVel = _unbound  # noqa: N816  (the library's names)
mj_rne = mj_integratePos = mj_applyFT = _unbound  # noqa: N816

ROUTINES = {
    "mj_kinematics": "mm", "mj_comPos": "mm", "mj_makeM": "mm", "mj_factorM": "mm", "mj_comVel": "mm", "mj_rne": "mmim",
    "mj_solveM": "mmmmi", "mj_fullM": "mmm", "mj_integratePos": "mmmd", "mj_applyFT": "mmmmmim",
}  # fmt: skip
"""Routines of the library with the kinds of their arguments: m address, i int, d double."""


LOOK, MOVE, HOLD, CORRECT = range(4)
"""What :func:`stage` does.

LOOK: positions and velocities of the joints, after what of the model depends on positions alone. MOVE: a step under the forces.
The others serve another engine in the state of `positions` and `velocities`, which takes velocity torques at the lagging
velocity: CORRECT adds to the forces, and as `lag` to those on a free base, what they lack to be of the whole step; HOLD adds
those of friction and stops, too.
"""


def stage(world: World, number: int) -> None:
    """Do LOOK, MOVE, HOLD or CORRECT. Every part is called at one place only, since compiling puts its code wherever it is
    called, and all four are compiled together."""
    if number != MOVE:
        if number != LOOK:
            _put_joints(world)
        mj_kinematics(world.model, world.data)
        mj_comPos(world.model, world.data)
        if number == LOOK:
            _read_joints(world)
            return
        mj_comVel(world.model, world.data)
        mj_rne(world.model, world.data, 0, world.at_lag)
    _find_bias(world)
    if number != CORRECT:
        kick = _push(world)
        settle(world, kick)
        if number == MOVE:
            _drift(world)
            return
        _add_held(world, kick)
    _add_lag(world)


class Handle(NamedTuple):
    """What compiled loops know of the world: its address, and the arrays that they read and write."""

    address: int
    positions: Numbers
    velocities: Numbers
    forces: Numbers
    wrench: Numbers
    friction: Numbers


compiled_stage: Callable[[int, int], None] = _unbound


def correct_at(handle: Handle) -> None:
    """CORRECT from a compiled loop."""
    compiled_stage(handle.address, CORRECT)


def hold_at(handle: Handle) -> None:
    """HOLD from a compiled loop."""
    compiled_stage(handle.address, HOLD)


def look_at(handle: Handle) -> None:
    """LOOK from a compiled loop."""
    compiled_stage(handle.address, LOOK)


def move_at(handle: Handle) -> None:
    """MOVE from a compiled loop."""
    compiled_stage(handle.address, MOVE)


def _put_joints(world: World) -> None:
    # In plain Python a name of a record takes as long to look up as a number to be copied.
    qpos, qvel, joint_q, joint_v = world.qpos, world.qvel, world.joint_q, world.joint_v
    positions, velocities = world.positions, world.velocities
    for j in range(len(joint_q)):
        qpos[joint_q[j]] = positions[j]
        qvel[joint_v[j]] = velocities[j]


def _read_joints(world: World) -> None:
    for j in range(len(world.joint_q)):
        world.positions[j] = world.qpos[world.joint_q[j]]
        world.velocities[j] = world.qvel[world.joint_v[j]]


def _drift(world: World) -> None:
    qvel, step = world.qvel, world.scheme[STEP]
    for i in range(len(qvel)):
        qvel[i] += world.change[i]
    if world.free:
        mj_integratePos(world.model, world.at_qpos, world.at_qvel, step)
    else:
        for i in range(len(qvel)):
            world.qpos[i] += step * qvel[i]


def _add_held(world: World, kick: float) -> None:
    """Mean torques of friction and stops."""
    count = 0
    for j in range(len(world.friction)):
        if is_held(world.held[j]):
            world.forces[j] += world.push[count] / kick
            count += 1
        else:
            world.forces[j] += sliding_impulse(world, j) / kick


def _add_lag(world: World) -> None:
    """What velocity torques at the lagging velocity lack."""
    lag, bias, forces, joint_v = world.lag, world.bias, world.forces, world.joint_v
    for i in range(len(lag)):
        lag[i] -= bias[i]
    for j in range(len(joint_v)):
        forces[j] += lag[joint_v[j]]


def _find_bias(world: World) -> None:
    """Coriolis and centrifugal torques, at the velocity of the whole step, and gravity."""
    now, before = world.scheme[NOW], world.scheme[BEFORE]
    qvel, velocity, previous = world.qvel, world.velocity, world.previous
    for i in range(len(qvel)):
        lagging = qvel[i]
        velocity[i] = lagging
        qvel[i] = now * lagging + before * previous[i]
        previous[i] = lagging
    mj_comVel(world.model, world.data)
    mj_rne(world.model, world.data, 0, world.at_bias)
    for i in range(len(qvel)):
        qvel[i] = velocity[i]


def _push(world: World) -> float:
    """Impulses of everything but friction and stops; returns the kick's length in s."""
    kick: float = world.scheme[FRACTION] * world.scheme[STEP]
    for i in range(len(world.qvel)):
        world.impulse[i] = -kick * world.bias[i]
    for j in range(len(world.joint_v)):
        world.impulse[world.joint_v[j]] += kick * world.forces[j]
    if len(world.wrench):
        _add_wrenches(world, world.scheme[STEP])
    return kick


def _add_wrenches(world: World, kick: float) -> None:
    """Impulses of forces and torques on links; a wrench is a mean over the whole step, the first kick's share in it."""
    for i in range(len(world.qvel)):
        world.push[i] = 0.0
    for index in range(len(world.wrench)):
        body = world.wrench_body[index]
        for row in range(3):
            point = world.xpos[body, row]
            for column in range(3):
                point += world.xmat[body, 3 * row + column] * world.wrench_point[index, column]
            world.vectors[2, row] = point
            for kind in range(2):
                if world.wrench_local[index]:
                    value = 0.0
                    for column in range(3):
                        part = 0.0
                        for axis in range(3):
                            part += world.wrench_turn[index, column, axis] * world.wrench[index, 3 * kind + axis]
                        value += world.xmat[body, 3 * row + column] * part
                    world.vectors[kind, row] = value
                else:
                    world.vectors[kind, row] = world.wrench[index, 3 * kind + row]
        at = world.at_vectors
        mj_applyFT(world.model, world.data, at, at + 24, at + 48, int(body), world.at_push)
        for i in range(6):
            world.wrench[index, i] = 0.0
    for i in range(len(world.qvel)):
        world.impulse[i] += kick * world.push[i]
