"""The loop over worlds and substeps; the same source runs as Python or compiled.

In a substep, sensors are read, motors move and their springs load the links; the engine moves the links; the energy balance is
updated. If an input jumps, the kick is split into pieces with separate inputs, which act on the links one after the other.
"""

from __future__ import annotations

from typing import Any

from asrsim.simulation.joint import advance, damping_of, friction_of, limit, push_of, read_sensors, remember_springs
from asrsim.simulation.laws import engine_step, row
from asrsim.simulation.layout import (
    APPLIED,
    APPLIED_BEFORE,
    APPLIED_NEXT,
    BRAKE,
    CONTROLLERS,
    DAMPING,
    DRAG,
    DYNAMIC,
    E_DAMPING,
    E_FRICTION,
    E_POSITION,
    E_TORQUE,
    E_VELOCITY,
    ENGINE_VELOCITY,
    EXTERNAL,
    FREE,
    FREE_AFTER,
    FREE_BEFORE,
    HEALTHY,
    LAST_ENGINE_VELOCITY,
    LAW_ENERGY,
    LINK_IMPLICITNESS,
    NO_VALUE,
    P_BRAKE,
    P_DAMPING_RATIO,
    P_EFFORT,
    P_LEVEL,
    PLACED,
    POSITION,
    PUSH,
    PUSHES,
    RAN_AWAY,
    STAGGERED,
    STEP,
    STIFFNESS,
    TORQUE,
    VELOCITY,
    WEIGHT_LAST,
    WEIGHT_NOW,
)  # fmt: skip
from asrsim.simulation.ledger import count_limits, update_energies

FASTEST = 1e4
"""Link speed above which a world counts as diverged, rad/s (m/s)."""
ENDLESS = 1e300
"""Torque above which a torque counts as infinite, N m."""


def run(
    which: Any, first: int, count: int, every: int, watched: int, done: Any, fault: Any, states: Any, constants: Any,
    kinds: Any, z: Any, engine_states: Any, inputs: Any, references: Any, wrenches: Any, lengths: Any, cuts: Any,
    exchange: Any, engine: int, record: int, columns: Any, goals: Any, out: Any, last_rows: Any,
) -> None:  # fmt: skip
    """Advance worlds by `count` substeps.

    which: a row (m, 4) for each world to advance: index of the world, of its inputs and references, of its part of `out`, and
    of its wrenches, lengths and cuts; first: first row of the inputs; every: number of substeps between recorded rows;
    watched: 1 to compute energies, limits and spring stiffness, otherwise 0; done: number (worlds,) of completed substeps;
    fault: health and faulty joint (worlds, 2); states, constants: S and P (worlds, joints, ...) of `asrsim.simulation.layout`;
    kinds: K (joints, ...); z: numbers of the stepping; engine_states: state of the engine (worlds, ...); inputs, references,
    wrenches, lengths, cuts: see `asrsim.simulation.inputs.Given`; exchange: data (pieces, joints, 5) shared with the engine;
    engine: address of the engine's step function, which receives `record`; columns, goals: recorded columns of S and of the
    references; out: recorded values (m, rows, joints, columns of S and of the references); last_rows: last recorded row of each
    world (worlds, joints, ...).
    """
    for chosen in range(len(which)):
        w, own_set, place, timing = which[chosen][0], which[chosen][1], which[chosen][2], which[chosen][3]
        kept = cut = 0
        s_all, p_all, x, u_all, r_all = states[w], constants[w], engine_states[w], inputs[own_set], references[own_set]
        pushes, own_lengths, own_cuts = wrenches[timing], lengths[timing], cuts[timing]
        while cut < len(own_cuts) and 0 <= own_cuts[cut][0] < first:
            cut += 1
        for step in range(first, first + count):
            if fault[w, 0] != HEALTHY:
                break
            substep = done[w]
            asked = substep % every == 0
            jumped = cut < len(own_cuts) and own_cuts[cut][0] == step
            begin, end, on_time = step, step + 1, step
            if jumped:
                begin, end, on_time = own_cuts[cut][1], own_cuts[cut][2], own_cuts[cut][3]
                cut += 1
            for j in range(len(kinds)):
                s, p, k = row(s_all, j), row(p_all, j), row(kinds, j)
                v = z[WEIGHT_NOW] * s[ENGINE_VELOCITY] + z[WEIGHT_LAST] * s[LAST_ENGINE_VELOCITY]
                if k[CONTROLLERS]:
                    read_sensors(s, p, k, z, row(u_all[step], j))
                if jumped:
                    _clear_means(s)
                total = torque = applied = push = drag = stiffness = energy = 0.0
                # A split kick is evaluated once more at the time of the substep, with h = 0: values are recorded, and nothing
                # moves.
                for turn in range(begin, end + 1 if jumped else end):
                    at, h, noted = turn, z[STEP], True
                    whole = (watched and asked) or p[P_DAMPING_RATIO] != 0.0 or k[DYNAMIC] < k[PLACED]
                    if jumped and turn == on_time:
                        h = 0.0
                    elif jumped:
                        at = turn - 1 if turn > on_time else turn
                        h, noted, whole = float(own_lengths[at]) * z[STEP], False, p[P_DAMPING_RATIO] != 0.0
                    u = row(u_all[at], j)
                    advance(s, p, k, z, u, h, noted, whole)
                    s[BRAKE] = limit(s, p, v)
                    s[PUSH] = push_of(s, p, u[EXTERNAL])
                    s[DRAG] = damping_of(s, p)
                    load = s[APPLIED] + s[PUSH]
                    total += load
                    exchange[at - begin, j, E_TORQUE] = load
                    exchange[at - begin, j, E_DAMPING] = s[DRAG] + s[BRAKE]
                    exchange[at - begin, j, E_FRICTION] = friction_of(s, p, v)
                    if jumped and turn == on_time:
                        s[FREE] = 1.0 if s[BRAKE] != 0.0 else 0.0
                        torque, applied, push, drag = s[TORQUE], s[APPLIED], s[PUSH], s[DRAG]
                        stiffness, energy = s[STIFFNESS], s[LAW_ENERGY]
                    elif jumped:
                        _add_piece(s, p, 2.0 * float(own_lengths[at]), turn > on_time)
                if jumped:
                    s[TORQUE], s[APPLIED], s[PUSH], s[DRAG] = torque, applied, push, drag
                    s[STIFFNESS], s[LAW_ENERGY], s[BRAKE] = stiffness, energy, p[P_BRAKE]
                if not abs(total) < ENDLESS:
                    fault[w, 0], fault[w, 1] = NO_VALUE, j
                    break
            if fault[w, 0] != HEALTHY:
                break
            engine_step(engine, record, x, exchange, pushes[begin:end], own_lengths[begin:end], end - begin)
            for j in range(len(kinds)):
                s, p, k = row(s_all, j), row(p_all, j), row(kinds, j)
                velocity = exchange[end - begin - 1, j, E_VELOCITY]
                _read_engine(s, p, z, velocity, jumped, substep == 0)
                if p[P_LEVEL] > 0.0:
                    remember_springs(s, p, k)
                if watched:
                    update_energies(s, p, k, z, substep == 0, jumped, asked)
                    count_limits(s, p, k)
                if asked:
                    for c in range(len(columns)):
                        out[place, kept, j, c] = s[columns[c]]
                    for c in range(len(goals)):
                        out[place, kept, j, len(columns) + c] = r_all[step][j][goals[c]]
                # The first kick of a staggered run is half a kick: the velocity before the kick is extrapolated to the velocity
                # before a full kick.
                s[LAST_ENGINE_VELOCITY] = (
                    2.0 * s[ENGINE_VELOCITY] - velocity if substep == 0 and z[STAGGERED] != 0.0 else s[ENGINE_VELOCITY]
                )
                s[ENGINE_VELOCITY], s[POSITION] = velocity, exchange[end - begin - 1, j, E_POSITION]
                if not abs(velocity) <= FASTEST:
                    fault[w, 0], fault[w, 1] = RAN_AWAY, j
            if asked:
                kept += 1
            done[w] = substep + 1
        for j in range(len(kinds) if kept else 0):
            for c in range(len(columns) + len(goals)):
                last_rows[w, j, c] = out[place, kept - 1, j, c]


def _clear_means(s: Any) -> None:
    """Set the mean torques over the half kicks before and after the time of the substep to 0."""
    for c in range(PUSHES):
        s[APPLIED_BEFORE + c] = s[APPLIED_NEXT + c] = 0.0
    s[FREE_BEFORE] = s[FREE_AFTER] = 0.0


def _add_piece(s: Any, p: Any, share: float, late: bool) -> None:
    """Add the torques in a piece of a kick to the means over half kicks. share: length of the piece as a fraction of a half
    kick; late: whether the piece follows the time of the substep."""
    side = APPLIED_NEXT if late else APPLIED_BEFORE
    s[side] += share * s[APPLIED]
    s[side + 1] += share * s[TORQUE]
    s[side + 3] += share * s[PUSH]
    if s[BRAKE] == p[P_BRAKE]:
        s[FREE_AFTER if late else FREE_BEFORE] += share


def _read_engine(s: Any, p: Any, z: Any, velocity: float, jumped: bool, first: bool) -> None:
    """Compute damping torque, applied torque and link velocity of this kick from the link's new velocity in the engine. Damping
    and derivative action act on the mean velocity over the kick."""
    mean = s[ENGINE_VELOCITY] + z[LINK_IMPLICITNESS] * (velocity - s[ENGINE_VELOCITY])
    brake = -s[BRAKE] * mean
    s[DAMPING] = -s[DRAG] * mean
    s[VELOCITY] = s[ENGINE_VELOCITY] if first or z[STAGGERED] == 0.0 else 0.5 * (s[ENGINE_VELOCITY] + velocity)
    if jumped:
        s[APPLIED_BEFORE] += brake * s[FREE_BEFORE]
        s[APPLIED_NEXT] += brake * s[FREE_AFTER]
        s[APPLIED_BEFORE + 2] = s[APPLIED_NEXT + 2] = s[DAMPING]
        applied = s[APPLIED] - s[FREE] * p[P_BRAKE] * mean
        s[APPLIED] = min(max(applied, -p[P_EFFORT]), p[P_EFFORT])
    else:
        s[APPLIED] += brake
