"""Coulomb friction and stops of joints, exactly: impulses within bounds, found by principal pivoting.

Ordinary code on the state of :class:`asrsim.engines.mujoco_stages.World`, run as it is or compiled. Each joint either moves at
its target velocity (0, or back from its stop) with an impulse within its bounds, or slides under the whole of a bound.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

STOP_SHARE = 0.2
"""Share of a joint's way beyond its stop that one step takes back, as PyBullet does."""
SINGLE_AFTER = 12
"""Rounds of pivoting after which only one joint changes at a time, which cannot go in circles."""
FULL, FACTORS = -2, -1
"""Indices into `known`, behind those of the joints: whether the mass matrix is filled in, and whether it is factorised, which
is not needed where most joints are held."""
SLACK = 1e-12
"""Relative excess of an impulse over its bound that rounding may give."""


def _unbound(*arguments: Any) -> None:
    raise NotImplementedError("bound by asrsim.engines.mujoco_library")


mj_makeM = mj_factorM = mj_solveM = mj_fullM = _unbound  # noqa: N816  (the library's names)


def settle(world: Any, kick: float) -> None:
    """Find the change of velocity under the impulses and those of friction and stops, each of which either keeps its joint at
    `target` or is at its bound."""
    mj_makeM(world.model, world.data)
    active = 0
    world.known[FULL] = world.known[FACTORS] = 0
    for j in range(len(world.friction)):
        most = world.friction[j] * kick
        low, high, target = -most, most, 0.0
        beyond = world.qpos[world.joint_q[j]] - world.upper[j]
        short = world.lower[j] - world.qpos[world.joint_q[j]]
        # A joint that stands exactly on its stop is held there, too.
        if short >= 0.0:
            high, target = inf, STOP_SHARE * short / world.scheme[0]
        if beyond >= 0.0:
            low, target = -inf, target - STOP_SHARE * beyond / world.scheme[0]
        world.low[j], world.high[j], world.target[j] = low, high, target
        world.known[j] = 0
        if high > low:
            active += 1
            if (world.held[j] > 0 and high == inf) or (world.held[j] < 0 and low == -inf):
                world.held[j] = 0
    if not active:
        _give(world, world.at_change, world.at_impulse)
        return
    for attempt in range(3 * len(world.friction) + 4 * SINGLE_AFTER):
        _try(world)
        if not _swap(world, attempt >= SINGLE_AFTER):
            break


def _give(world: Any, at_velocities: int, at_impulses: int) -> None:
    """The changes of velocity that impulses make where nothing holds a joint; both are given by their arrays' addresses."""
    if not world.known[FACTORS]:
        mj_factorM(world.model, world.data)
        world.known[FACTORS] = 1
    mj_solveM(world.model, world.data, at_velocities, at_impulses, 1)


def _try(world: Any) -> None:
    """Change of velocity with the joints held or sliding as `held` says; the impulses of the held ones are left in `push`."""
    count = 0
    for i in range(len(world.qvel)):
        world.push[i] = world.impulse[i]
    for j in range(len(world.friction)):
        if world.high[j] > world.low[j]:
            if world.held[j] == 0:
                world.pick[count] = j
                count += 1
            else:
                world.push[world.joint_v[j]] += world.high[j] if world.held[j] > 0 else world.low[j]
    if 2 * count > len(world.qvel):
        _move_others(world, count)
    else:
        _hold(world, count)


def _hold(world: Any, count: int) -> None:
    """Impulses that hold the `count` held joints, from the changes of velocity that a unit impulse at each of them makes."""
    size = len(world.qvel)
    square = world.square
    _give(world, world.at_change, world.at_push)
    for a in range(count):
        j = world.pick[a]
        if not world.known[j]:
            for i in range(size):
                world.push[i] = 0.0
            world.push[world.joint_v[j]] = 1.0
            _give(world, world.at_columns + 8 * size * int(j), world.at_push)
            world.known[j] = 1
    for a in range(count):
        for b in range(a, count):
            square[b, a] = world.columns[world.pick[a], world.joint_v[world.pick[b]]]
        dof = world.joint_v[world.pick[a]]
        world.push[a] = world.target[world.pick[a]] - world.qvel[dof] - world.change[dof]
    _solve(square, world.push, count)
    for a in range(count):
        for i in range(size):
            world.change[i] += world.push[a] * world.columns[world.pick[a], i]


def _move_others(world: Any, count: int) -> None:
    """The same where most joints are held: first how the others' velocities change, then what holds those `count`."""
    size = len(world.qvel)
    mass, change, loose, square = world.mass, world.change, world.loose, world.square
    if not world.known[FULL]:
        mj_fullM(world.model, world.data, world.at_mass)
        world.known[FULL] = 1
    for i in range(size):
        loose[i] = i
        change[i] = 0.0
    for a in range(count):
        dof = world.joint_v[world.pick[a]]
        loose[dof] = -1
        change[dof] = world.target[world.pick[a]] - world.qvel[dof]
    free = 0
    for i in range(size):
        if loose[i] >= 0:
            loose[free] = loose[i]
            free += 1
    for a in range(free):
        i = loose[a]
        value = world.push[i]
        for k in range(size):
            value -= mass[i, k] * change[k]
        world.rest[a] = value
        for b in range(a, free):
            square[b, a] = mass[loose[b], i]
    _solve(square, world.rest, free)
    for a in range(free):
        change[loose[a]] = world.rest[a]
    for a in range(count):
        dof = world.joint_v[world.pick[a]]
        value = -world.push[dof]
        for k in range(size):
            value += mass[dof, k] * change[k]
        world.rest[a] = value
    for a in range(count):
        world.push[a] = world.rest[a]


def _solve(square: Any, values: Any, count: int) -> None:
    """Solve a positive definite system of `count`, whose lower half is given, in place (Cholesky)."""
    for a in range(count):
        for c in range(a):
            square[a, a] -= square[a, c] * square[a, c]
        square[a, a] = sqrt(square[a, a])
        for b in range(a + 1, count):
            value = square[b, a]
            for c in range(a):
                value -= square[b, c] * square[a, c]
            square[b, a] = value / square[a, a]
    for a in range(count):
        value = values[a]
        for c in range(a):
            value -= square[a, c] * values[c]
        values[a] = value / square[a, a]
    for a in range(count - 1, -1, -1):
        value = values[a]
        for c in range(a + 1, count):
            value -= square[c, a] * values[c]
        values[a] = value / square[a, a]


def _swap(world: Any, single: bool) -> bool:
    """Let joints slide that would need more than their bound, hold those that slide the way their friction pushes; whether any
    changed."""
    changed = False
    count = 0
    for j in range(len(world.friction)):
        if world.high[j] <= world.low[j]:
            continue
        if world.held[j] == 0:
            impulse = world.push[count]
            count += 1
            if impulse > world.high[j] * (1.0 + SLACK):
                world.held[j] = 1
                changed = True
            elif impulse < world.low[j] * (1.0 + SLACK):
                world.held[j] = -1
                changed = True
        else:
            dof = world.joint_v[j]
            velocity = world.qvel[dof] + world.change[dof]
            if (velocity - world.target[j]) * world.held[j] > 0.0:
                world.held[j] = 0
                changed = True
        if changed and single:
            return True
    return changed
