"""Coulomb friction and stops of joints, solved exactly by principal pivoting on the impulses of one step.

These functions run as Python or compiled. In one step each degree of freedom is in one of five states, `regime`:

     AT_LOWER   it reaches its lower stop at the end of the step, or rests there; the stop pushes
     NEGATIVE   it slides in negative direction, with the full Coulomb friction
     STICKING   it stands still, and the friction is below the Coulomb level
     POSITIVE   it slides in positive direction, with the full Coulomb friction; without friction it moves freely
     AT_UPPER   it reaches its upper stop at the end of the step, or rests there

Stops are inelastic. A joint that would pass its stop during the step moves just fast enough to reach the stop; in the next step
the joint rests at the stop. The impulse of the impact is thus divided over two steps, in proportion to the time that each part
acts, so that the positions of the other joints remain second-order accurate.
"""

from __future__ import annotations

from typing import Any

AT_LOWER, NEGATIVE, STICKING, POSITIVE, AT_UPPER = range(-2, 3)
"""States of a degree of freedom; the docstring of the module explains them."""
SINGLE_AFTER = 12
"""Number of pivoting rounds after which only one state changes per round, which guarantees that the search ends."""
SLACK = 1e-12
"""Tolerance for rounding: relative amount by which an impulse may exceed its bound."""


def settle(room: Any) -> None:
    """Compute `room.change`, the change of velocity in a step under the applied impulses, friction and stops.

    `room` has arrays for the v degrees of freedom. Inputs: `matrix` (v, v) kg m^2, positive definite; `impulse` (v,) N m s of
    all forces except friction and stops; `velocity` (v,) before the step; `bound` (v,) N m s, largest impulse of friction;
    `slowest` (v,) <= 0 and `fastest` (v,) >= 0, the velocities that the stops allow. Input and output: `regime` (v,), the
    states of the degrees of freedom, on entry those of the last step. Work space: `square` (v, v), `push` and `places` (v,).
    """
    size = len(room.bound)
    for i in range(size):
        if room.bound[i] == 0.0 and abs(room.regime[i]) != AT_UPPER:
            room.regime[i] = POSITIVE
    for attempt in range(3 * size + 4 * SINGLE_AFTER):
        solve_states(room)
        if not _swap(room, attempt >= SINGLE_AFTER):
            break


def solve_states(room: Any) -> None:
    """Compute the change of velocity for the states in `regime`, and the impulses that stop the other, non-sliding degrees of
    freedom, which are stored in `push`."""
    matrix, change, regime, square, push, places = room.matrix, room.change, room.regime, room.square, room.push, room.places
    size = len(change)
    free = 0
    for i in range(size):
        change[i] = 0.0
        state = regime[i]
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
            value += room.bound[i] if regime[i] == NEGATIVE else -room.bound[i]
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
            if regime[i] != POSITIVE and regime[i] != NEGATIVE:
                value = -room.impulse[i]
                for k in range(size):
                    value += matrix[i, k] * change[k]
                push[i] = value


def _solve(square: Any, values: Any, count: int) -> None:
    """Solve a positive definite system of `count` equations in place (L D L^T; the diagonal becomes 1/D). `square` holds the
    lower triangle of the matrix."""
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
    """Change the state of each degree of freedom whose impulse or velocity contradicts the state. single: whether to change
    only the first of these states. Returns whether any state changed."""
    changed = False
    regime = room.regime
    for i in range(len(regime)):
        before = regime[i]
        if abs(before) == POSITIVE:
            regime[i] = _state_by_velocity(room, i, room.velocity[i] + room.change[i])
        else:
            regime[i] = _state_by_impulse(room, i, room.push[i])
        if regime[i] != before:
            changed = True
            if single:
                return True
    return changed


def _state_by_impulse(room: Any, i: int, impulse: float) -> int:
    """Next state of degree of freedom `i`, which sticks or rests at a stop and needs `impulse` (N m s) to do so."""
    most, slack, state = room.bound[i], SLACK * room.bound[i], room.regime[i]
    if state == AT_LOWER and impulse >= most - slack:
        return AT_LOWER
    if state == AT_UPPER and impulse <= slack - most:
        return AT_UPPER
    # A joint that already touches its stop can also stick.
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
    """Next state of degree of freedom `i`, which slides and would have `velocity` after the step."""
    if velocity > room.fastest[i]:
        return AT_UPPER
    if velocity < room.slowest[i]:
        return AT_LOWER
    state: int = room.regime[i]
    if room.bound[i] > 0.0 and velocity * state < 0.0:
        return STICKING
    return state
