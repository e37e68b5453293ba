"""Coulomb friction and stops of joints, solved exactly by principal pivoting on the impulses of one step.

These functions run as Python or compiled. In one step each degree of freedom is in one of five states, `regime`:

     AT_LOWER   it reaches its lower stop at the end of the step, or rests there; the stop pushes
     NEGATIVE   it slides in negative direction, with the full Coulomb friction
     STICKING   it stands still, and the friction is below the Coulomb level
     POSITIVE   it slides in positive direction, with the full Coulomb friction; without friction it moves freely
     AT_UPPER   it reaches its upper stop at the end of the step, or rests there

Stops are inelastic. A joint that would pass its stop during the step gets the velocity with which it just reaches the stop; in
the next step the joint rests at the stop, or is pushed back: `asrsim.engines.rigid` counts only the forces after the time of
the impact. The impulse of the impact is thus divided over the two steps, in proportion to the time for which it acts in each,
so that the positions of the other joints remain second-order accurate.
"""

from __future__ import annotations

from typing import Any

AT_LOWER, NEGATIVE, STICKING, POSITIVE, AT_UPPER = range(-2, 3)
"""States of a degree of freedom; the docstring of the module explains them."""
SINGLE_AFTER = 12
"""Number of pivoting rounds after which each round changes only one state, which guarantees that the search ends."""
SLACK = 1e-12
"""Tolerance for rounding errors: relative amount by which an impulse may exceed its bound."""


def settle(room: Any) -> None:
    """Compute `room.change`, the change of velocity in a step under the applied impulses, friction and stops.

    `room` has arrays for the v degrees of freedom. Inputs: `matrix` (v, v) kg m^2, positive definite; `diagonal` (v,), the
    diagonal of `matrix` with implicit damping; `parent` (v,), see `asrsim.engines.rigid.Room`; `impulse` (v,) N m s, impulse of
    all forces except friction and stops; `velocity` (v,), velocity before the step; `bound` (v,) N m s, largest impulse of
    friction; `slowest` (v,) <= 0 and `fastest` (v,) >= 0, the velocities that the stops allow. Input and output: `regime` (v,),
    the states of the degrees of freedom, which on entry are the states of the last step. Work space: `square` (v, v) and `push`
    (v,).
    """
    size = room.freedoms
    for i in range(size):
        if room.bound[i] == 0.0 and abs(room.regime[i]) != AT_UPPER:
            room.regime[i] = POSITIVE
    for attempt in range(3 * size + 4 * SINGLE_AFTER):
        solve_states(room)
        if not _swap(room, attempt >= SINGLE_AFTER):
            break


def solve_states(room: Any) -> None:
    """Compute `room.change` for the states in `regime`.

    A degree of freedom that does not slide has a prescribed velocity after the step: 0, or the velocity with which it reaches
    its stop.
    `room.push` becomes the impulse (N m s) of friction and stop that causes this velocity.
    """
    matrix, diagonal, change, regime, push = room.matrix, room.diagonal, room.change, room.regime, room.push
    impulse, bound = room.impulse, room.bound
    size, prescribed = room.freedoms, 0
    for i in range(size):
        change[i] = 0.0
        push[i] = impulse[i]
        if bound[i] > 0.0:
            push[i] += bound[i] if regime[i] == NEGATIVE else -bound[i]
        if abs(regime[i]) != POSITIVE:
            prescribed += 1
            goal = 0.0
            if regime[i] == AT_LOWER:
                goal = room.slowest[i]
            elif regime[i] == AT_UPPER:
                goal = room.fastest[i]
            change[i] = goal - room.velocity[i]
    # Move the known changes of velocity to the right-hand side of the equations for the unknown changes.
    for k in range(size):
        if change[k] != 0.0:
            for i in range(size):
                push[i] -= matrix[i, k] * change[k]
    _fill(room)
    _solve(room.square, push, room.parent, size)
    for i in range(size):
        change[i] = push[i]
    for i in range(size if prescribed > 0 else 0):
        if abs(regime[i]) != POSITIVE:
            push[i] = -impulse[i]
            for k in range(size):
                push[i] += (diagonal[i] if k == i else matrix[i, k]) * change[k]


def _fill(room: Any) -> None:
    """Set `room.square` and `room.push` to the equations for the degrees of freedom that slide; for the other degrees of
    freedom, to their known changes of velocity."""
    matrix, square, regime, parent = room.matrix, room.square, room.regime, room.parent
    for i in range(room.freedoms):
        slides = abs(regime[i]) == POSITIVE
        square[i, i] = room.diagonal[i] if slides else 1.0
        if not slides:
            room.push[i] = room.change[i]
        k = parent[i]
        while k >= 0:
            square[i, k] = matrix[i, k] if slides and abs(regime[k]) == POSITIVE else 0.0
            k = parent[k]


def _solve(square: Any, values: Any, parent: Any, size: int) -> None:
    """Solve a positive definite system in place, M = L^T D L. `square` holds the lower triangle of M, with zeros except for
    pairs of degrees of freedom of which one carries the other.

    The elimination begins at the last joint, so that these zeros remain zeros (Featherstone 2008, ch. 8.5).
    """
    for a in range(size - 1, -1, -1):
        inverse = 1.0 / square[a, a]
        b = parent[a]
        while b >= 0:
            factor = square[a, b] * inverse
            # Loop over all columns, not along the branch from the base to b: this is faster, since no read from memory depends
            # on the read before. The loop also changes entries outside the branch. They are 0, or NaN after a run that
            # diverged, and have no effect.
            for c in range(b + 1):
                square[b, c] -= factor * square[a, c]
            square[a, b] = factor
            values[b] -= factor * values[a]
            b = parent[b]
        values[a] *= inverse
    for a in range(size):
        b = parent[a]
        while b >= 0:
            values[a] -= square[a, b] * values[b]
            b = parent[b]


def _swap(room: Any, single: bool) -> bool:
    """Change the state of each degree of freedom whose impulse or velocity contradicts the state. single: whether to change
    only the first such degree of freedom. Returns whether any state changed."""
    changed = False
    regime = room.regime
    for i in range(room.freedoms):
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
    """Next state of degree of freedom `i`, which sticks or rests at a stop. impulse: impulse in N m s that keeps it there."""
    most, slack, state = room.bound[i], SLACK * room.bound[i], room.regime[i]
    if state == AT_LOWER and impulse >= most - slack:
        return AT_LOWER
    if state == AT_UPPER and impulse <= slack - most:
        return AT_UPPER
    # A joint that is already at its stop can also stick there by its friction.
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
    """Next state of degree of freedom `i`, which slides and would have the velocity `velocity` after the step."""
    if velocity > room.fastest[i]:
        return AT_UPPER
    if velocity < room.slowest[i]:
        return AT_LOWER
    state: int = room.regime[i]
    if room.bound[i] > 0.0 and velocity * state < 0.0:
        return STICKING
    return state
