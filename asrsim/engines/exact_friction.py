"""Coulomb friction and stops of joints, solved exactly by principal pivoting on the impulses of one step.

Ordinary code on the state of :class:`asrsim.engines.mujoco_world.World`, run as it is or compiled. In one step each joint is
in one of five states, `held`:

     AT_LOWER   it reaches its lower stop at the end of the step, or rests there; the stop pushes
     NEGATIVE   it slides in negative direction under all of its friction
     STICKING   it stands, and friction takes no more than its bound
     POSITIVE   it slides in positive direction under all of its friction; a joint without friction moves freely
     AT_UPPER   it reaches its upper stop at the end of the step, or rests there

Stops are inelastic. A joint that would pass its stop during the step moves just fast enough to reach it; in the next step it
rests there. Both impulses together are those of the impact, each weighted by the share of the step that it acts on the motion,
so the other joints' positions stay of second order.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

AT_LOWER, NEGATIVE, STICKING, POSITIVE, AT_UPPER = range(-2, 3)
"""States of a joint; see the module."""
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
    """Find the change of velocity under the given impulses and those of friction and stops."""
    mj_makeM(world.model, world.data)
    step = world.scheme[0]
    bounded = 0
    world.known[FULL] = world.known[FACTORS] = 0
    for j in range(len(world.friction)):
        position = world.qpos[world.joint_q[j]]
        world.most[j] = world.friction[j] * kick
        # A joint beyond its stop is held where it is: to push it back would leave it with a velocity of its own.
        world.slowest[j] = min((world.lower[j] - position) / step, 0.0)
        world.fastest[j] = max((world.upper[j] - position) / step, 0.0)
        world.known[j] = 0
        if world.most[j] == 0.0 and abs(world.held[j]) != AT_UPPER:
            world.held[j] = POSITIVE
        if world.most[j] > 0.0 or world.slowest[j] > -inf or world.fastest[j] < inf:
            bounded += 1
    if not bounded:
        _give(world, world.at_change, world.at_impulse)
        return
    for attempt in range(3 * len(world.friction) + 4 * SINGLE_AFTER):
        _try(world)
        if not _swap(world, attempt >= SINGLE_AFTER):
            break


def is_held(state: int) -> bool:
    """Whether a joint in this state has a given velocity; otherwise its impulse is given."""
    return state != NEGATIVE and state != POSITIVE


def _target(world: Any, j: int) -> float:
    """Velocity of a held joint."""
    if world.held[j] == AT_LOWER:
        return world.slowest[j]  # type: ignore[no-any-return]
    if world.held[j] == AT_UPPER:
        return world.fastest[j]  # type: ignore[no-any-return]
    return 0.0


def sliding_impulse(world: Any, j: int) -> float:
    """Impulse of the friction of a joint that slides."""
    return world.most[j] if world.held[j] == NEGATIVE else -world.most[j]  # type: ignore[no-any-return]


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
        if is_held(world.held[j]):
            world.pick[count] = j
            count += 1
        else:
            world.push[world.joint_v[j]] += sliding_impulse(world, j)
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
        world.push[a] = _target(world, world.pick[a]) - world.qvel[dof] - world.change[dof]
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
        change[dof] = _target(world, world.pick[a]) - world.qvel[dof]
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
    """Move every joint whose impulse or velocity contradicts its state to the next state; `single`: only the first of them.
    Whether any moved."""
    changed = False
    count = 0
    for j in range(len(world.friction)):
        before = world.held[j]
        if is_held(before):
            world.held[j] = _state_by_impulse(world, j, world.push[count])
            count += 1
        else:
            dof = world.joint_v[j]
            world.held[j] = _state_by_velocity(world, j, world.qvel[dof] + world.change[dof])
        if world.held[j] != before:
            changed = True
            if single:
                return True
    return changed


def _state_by_impulse(world: Any, j: int, impulse: float) -> int:
    """State after a solution in which the held joint j needs this impulse to have its velocity."""
    most, slack = world.most[j], SLACK * world.most[j]
    if world.held[j] == AT_LOWER and impulse >= most - slack:
        return AT_LOWER
    if world.held[j] == AT_UPPER and impulse <= slack - most:
        return AT_UPPER
    # At a stop that it touches already, a joint can stick, too.
    lowest = world.slowest[j] if world.held[j] == AT_LOWER else 0.0
    highest = world.fastest[j] if world.held[j] == AT_UPPER else 0.0
    if most > 0.0 and lowest == 0.0 and highest == 0.0:
        if impulse > most + slack:
            return AT_LOWER if world.slowest[j] == 0.0 else NEGATIVE
        if impulse < -most - slack:
            return AT_UPPER if world.fastest[j] == 0.0 else POSITIVE
        return STICKING
    if most > 0.0 and world.held[j] == AT_LOWER:
        return NEGATIVE
    return POSITIVE


def _state_by_velocity(world: Any, j: int, velocity: float) -> int:
    """State after a solution in which the sliding joint j has this velocity."""
    if velocity > world.fastest[j]:
        return AT_UPPER
    if velocity < world.slowest[j]:
        return AT_LOWER
    if world.most[j] > 0.0 and velocity * world.held[j] < 0.0:
        return STICKING
    return world.held[j]  # type: ignore[no-any-return]
