"""Coulomb friction and stops of joints, exactly: impulses within bounds, found by principal pivoting.

Ordinary code on the state of :class:`asrsim.engines.mujoco_stages.World`, run as it is or compiled. Each joint either moves at
its target velocity (0, or back from its stop) with an impulse within its bounds, or slides under the whole of a bound.
"""

from __future__ import annotations

from math import inf
from typing import Any

STOP_SHARE = 0.2
"""Share of a joint's way beyond its stop that one step takes back, as PyBullet does."""
SINGLE_AFTER = 12
"""Rounds of pivoting after which only one joint changes at a time, which cannot go in circles."""
SLACK = 1e-12
"""Relative excess of an impulse over its bound that rounding may give."""


def mj_solveM(*arguments: Any) -> None:  # noqa: N802  (the library's name)
    """Bound by :mod:`asrsim.engines.mujoco_library`."""
    raise NotImplementedError


def settle(world: Any, kick: float) -> None:
    """Change of velocity under the impulses, with friction and stops: each keeps its joint at `target` or gives its bound."""
    active = 0
    for j in range(len(world.friction)):
        most = world.friction[j] * kick
        low, high, target = -most, most, 0.0
        beyond = world.qpos[world.joint_q[j]] - world.upper[j]
        short = world.lower[j] - world.qpos[world.joint_q[j]]
        if short > 0.0:
            high, target = inf, STOP_SHARE * short / world.scheme[0]
        elif beyond > 0.0:
            low, target = -inf, -STOP_SHARE * beyond / world.scheme[0]
        world.low[j], world.high[j], world.target[j] = low, high, target
        world.known[j] = 0
        if high > low:
            active += 1
            if (world.held[j] > 0 and high == inf) or (world.held[j] < 0 and low == -inf):
                world.held[j] = 0
    if not active:
        mj_solveM(world.model, world.data, world.at_change, world.at_impulse, 1)
        return
    for attempt in range(3 * len(world.friction) + 4 * SINGLE_AFTER):
        _try(world)
        if not _swap(world, attempt >= SINGLE_AFTER):
            break


def _try(world: Any) -> None:
    """Change of velocity with the joints held or sliding as `held` says; impulses of the held ones in the square's diagonal."""
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
    mj_solveM(world.model, world.data, world.at_change, world.at_push, 1)
    if not count:
        return
    size = len(world.qvel)
    for a in range(count):
        j = world.pick[a]
        if not world.known[j]:
            for i in range(size):
                world.push[i] = 0.0
            world.push[world.joint_v[j]] = 1.0
            mj_solveM(world.model, world.data, world.at_columns + 8 * size * int(j), world.at_push, 1)
            world.known[j] = 1
    # Cholesky of what a unit impulse at each held joint gives the others.
    square = world.square
    for a in range(count):
        column = world.columns[world.pick[a]]
        for b in range(a, count):
            value = column[world.joint_v[world.pick[b]]]
            for c in range(a):
                value -= square[a, c] * square[b, c]
            if b == a:
                square[a, a] = value**0.5
            else:
                square[b, a] = value / square[a, a]
    for a in range(count):
        j = world.pick[a]
        place = world.joint_v[j]
        value = world.target[j] - world.qvel[place] - world.change[place]
        for c in range(a):
            value -= square[a, c] * world.push[c]
        world.push[a] = value / square[a, a]
    for a in range(count - 1, -1, -1):
        value = world.push[a]
        for c in range(a + 1, count):
            value -= square[c, a] * world.push[c]
        world.push[a] = value / square[a, a]
    for a in range(count):
        column = world.columns[world.pick[a]]
        for i in range(size):
            world.change[i] += world.push[a] * column[i]


def _swap(world: Any, single: bool) -> bool:
    """Let go what needs more than its bound, hold what slides against its bound; whether anything changed."""
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
            place = world.joint_v[j]
            velocity = world.qvel[place] + world.change[place]
            if (velocity - world.target[j]) * world.held[j] > 0.0:
                world.held[j] = 0
                changed = True
        if changed and single:
            return True
    return changed
