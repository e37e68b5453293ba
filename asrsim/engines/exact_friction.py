"""Coulomb friction and stops of joints, solved exactly by principal pivoting on the impulses of one step.

Ordinary code, run as it is or compiled. In one step each degree of freedom is in one of five states, `held`:

     AT_LOWER   it reaches its lower stop at the end of the step, or rests there; the stop pushes
     NEGATIVE   it slides in negative direction under its full friction
     STICKING   it stands still, and friction is within its bound
     POSITIVE   it slides in positive direction under its full friction; without friction it moves freely
     AT_UPPER   it reaches its upper stop at the end of the step, or rests there

Stops are inelastic. A joint that would pass its stop during the step moves just fast enough to reach it; in the next step it
rests there. Both impulses together are those of the impact, each weighted by the share of the step that it acts on the motion,
so the other joints' positions stay of second order.
"""

from __future__ import annotations

from typing import Any

AT_LOWER, NEGATIVE, STICKING, POSITIVE, AT_UPPER = range(-2, 3)
"""States of a degree of freedom; see the module."""
SINGLE_AFTER = 12
"""Rounds of pivoting after which only one state changes at a time, which cannot go in circles."""
SLACK = 1e-12
"""Relative excess of an impulse over its bound that rounding may give."""


def settle(room: Any) -> None:
    """Find `room.change`, the change of velocity in a step under the given impulses and those of friction and stops.

    `room` has arrays for the v degrees of freedom. Given: `matrix` (v, v) kg m^2, positive definite; `impulse` (v,) N m s of
    all that pushes but friction and stops; `velocity` (v,) before the step; `bound` (v,) largest impulse of friction;
    `slowest` and `fastest` (v,) velocities that stops allow, not above and not below 0. Given and left: `held` (v,), the
    states of the last step, from which the search begins. Work space: `square` (v, v), `push` and `places` (v,).
    """
    size = len(room.bound)
    for i in range(size):
        if room.bound[i] == 0.0 and abs(room.held[i]) != AT_UPPER:
            room.held[i] = POSITIVE
    for attempt in range(3 * size + 4 * SINGLE_AFTER):
        _try(room)
        if not _swap(room, attempt >= SINGLE_AFTER):
            break


def _try(room: Any) -> None:
    """Change of velocity with each degree of freedom held or sliding as `held` says; the impulses of held ones are left in
    `push`."""
    matrix, change, held, square, push, places = room.matrix, room.change, room.held, room.square, room.push, room.places
    size = len(change)
    free = 0
    for i in range(size):
        change[i] = 0.0
        state = held[i]
        if abs(state) == POSITIVE:
            places[free] = i
            free += 1
        elif state == AT_LOWER:
            change[i] = room.slowest[i] - room.velocity[i]
        elif state == AT_UPPER:
            change[i] = room.fastest[i] - room.velocity[i]
        else:
            change[i] = -room.velocity[i]
    for a in range(free):
        i = places[a]
        value = room.impulse[i]
        if room.bound[i] > 0.0:
            value += room.bound[i] if held[i] == NEGATIVE else -room.bound[i]
        if free < size:
            for k in range(size):
                value -= matrix[i, k] * change[k]
        push[a] = value
        for b in range(a, free):
            square[b, a] = matrix[places[b], i]
    _solve(square, push, free)
    for a in range(free):
        change[places[a]] = push[a]
    if free < size:
        for i in range(size):
            if held[i] != POSITIVE and held[i] != NEGATIVE:
                value = -room.impulse[i]
                for k in range(size):
                    value += matrix[i, k] * change[k]
                push[i] = value


def _solve(square: Any, values: Any, count: int) -> None:
    """Solve a positive definite system of `count`, whose lower half is given, in place (L D L^T; the diagonal becomes 1/D)."""
    for a in range(count):
        inverse = 1.0 / square[a, a]
        square[a, a] = inverse
        for b in range(a + 1, count):
            factor = square[b, a] * inverse
            for c in range(a + 1, b):
                square[b, c] -= square[b, a] * square[c, a]
            square[b, b] -= square[b, a] * factor
            square[b, a] = factor
            values[b] -= factor * values[a]
    for a in range(count - 1, -1, -1):
        value = values[a] * square[a, a]
        for c in range(a + 1, count):
            value -= square[c, a] * values[c]
        values[a] = value


def _swap(room: Any, single: bool) -> bool:
    """Change the state of each degree of freedom whose impulse or velocity contradicts it; `single`: of the first one only.
    Returns whether any changed."""
    changed = False
    held = room.held
    for i in range(len(held)):
        before = held[i]
        if abs(before) == POSITIVE:
            held[i] = _state_by_velocity(room, i, room.velocity[i] + room.change[i])
        else:
            held[i] = _state_by_impulse(room, i, room.push[i])
        if held[i] != before:
            changed = True
            if single:
                return True
    return changed


def _state_by_impulse(room: Any, i: int, impulse: float) -> int:
    """State after a solution in which a held degree of freedom needs this impulse for its velocity."""
    most, slack, state = room.bound[i], SLACK * room.bound[i], room.held[i]
    if state == AT_LOWER and impulse >= most - slack:
        return AT_LOWER
    if state == AT_UPPER and impulse <= slack - most:
        return AT_UPPER
    # At a stop that it touches already, a joint can stick, too.
    lowest = room.slowest[i] if state == AT_LOWER else 0.0
    highest = room.fastest[i] if state == AT_UPPER else 0.0
    if most > 0.0 and lowest == 0.0 and highest == 0.0:
        if impulse > most + slack:
            return AT_LOWER if room.slowest[i] == 0.0 else NEGATIVE
        if impulse < -most - slack:
            return AT_UPPER if room.fastest[i] == 0.0 else POSITIVE
        return STICKING
    if most > 0.0 and state == AT_LOWER:
        return NEGATIVE
    return POSITIVE


def _state_by_velocity(room: Any, i: int, velocity: float) -> int:
    """State after a solution in which a sliding degree of freedom has this velocity."""
    if velocity > room.fastest[i]:
        return AT_UPPER
    if velocity < room.slowest[i]:
        return AT_LOWER
    state: int = room.held[i]
    if room.bound[i] > 0.0 and velocity * state < 0.0:
        return STICKING
    return state
