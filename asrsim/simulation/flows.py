"""What the rows of a record come to: energies that flow from each to the next, and limits that they meet.

One source: on a joint's whole columns in plain Python, row by row in one compiled pass where the loop is compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from asrsim.samples import Array
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.groups import MOTOR_1, MOTOR_2, Group

POSITION, VELOCITY, TORQUE, APPLIED, DAMPING, SPRING_1, SPRING_2 = 0, 1, 2, 3, 4, 5, 6
"""Columns of the raw record (:data:`asrsim.simulation.substep.RAW`)."""
SPEED, DRIVE, FRICTION = 1, 2, 3
"""Columns of a motor behind that of its position."""
MEANS = (TORQUE, APPLIED, DAMPING, *(motor + column for motor in (MOTOR_1, MOTOR_2) for column in (DRIVE, FRICTION)))
"""Columns whose mean over a step is twofold where an input jumps: before the jump, and after."""
FLOWS = 9
"""Kinds of energy that flow at a joint."""
GIVEN, THROUGH, WORK, LOST, DAMPED, LINK, CUT, HEAT, LAGGED = range(FLOWS)
"""Work of actuator and external torques on the link, less what its damping took; sizes of all that went through; work of the
motors, losses in them, by the link's damping, work on the link, taken by the effort limit, heat of windings, lost in
hysteresis: J."""
VANISHED = GIVEN
"""Among sums that are recorded, the place of what has vanished: the other is only asked for at the end."""
LIMITS = 8
"""Kinds of limits that are counted."""
EFFORTS, SPEEDS, SATURATIONS, DEFLECTIONS, STOPS, MOTOR_STOPS, MOTOR_SPEEDS, HELD = range(LIMITS)
"""Numbers of rows in which a joint met a limit: of its torque, of its speed, of a motor's torque, of a spring's deflection, of
its position, of a motor's position, of a motor's speed. HELD: either of the last two, of all rows of the raw record."""
AT_STOP = 1e-12
"""rad or m before a stop from which on a joint or motor is at it: a step reaches the stop but for rounding."""
FULL = 1.0 - 1e-9
"""Share of its greatest speed at which a motor is held."""


def steps(count: int) -> Any:
    """Rows that are taken one after the other; in plain Python all at once."""
    return (slice(0, count),)


def later(row: Any) -> Any:
    """The row after one."""
    return slice(row.start + 1, row.stop + 1)


def number(met: Any) -> int:
    """How many are met."""
    return int(np.count_nonzero(met))


def _one_later(row: Any) -> Any:
    return row + 1


def _one_or_none(met: Any) -> int:
    return 1 if met else 0


def flow(raw: Any, external: Any, links: Any, motors: Any, flows: Any) -> None:
    """J that flow at joints over steps, (FLOWS, joints, n), of raw records (columns, joints, n + 1); where motors have no
    dynamics their work is taken for that on the link. external: N m, (joints, n + 1)."""
    for j in range(flows.shape[1]):
        spring, rest, sprung, count = links[j, 0], links[j, 1], links[j, 2], int(links[j, 3])
        for k in steps(flows.shape[2]):
            after = later(k)
            q, q_after = raw[POSITION, j, k], raw[POSITION, j, after]
            half = 0.5 * (q_after - q)
            applied = raw[APPLIED, j, k] + raw[APPLIED, j, after]
            outside = external[j, k] + external[j, after] + spring * (rest - 0.5 * (q + q_after))
            link, push = applied * half, outside * half
            damped = (raw[DAMPING, j, k] + raw[DAMPING, j, after]) * -half
            flows[LINK, j, k] = link
            flows[CUT, j, k] = sprung * ((raw[TORQUE, j, k] + raw[TORQUE, j, after] - applied) * half)
            flows[DAMPED, j, k] = damped
            flows[GIVEN, j, k] = link + push - damped
            flows[THROUGH, j, k] = abs(link) + abs(push)
            flows[WORK, j, k] = 0.0 if count else link
            flows[LOST, j, k] = 0.0
        for i in range(count):
            motor, viscous = MOTOR_1 + i * (MOTOR_2 - MOTOR_1), motors[i, j, 0]
            for k in steps(flows.shape[2]):
                after = later(k)
                half = 0.5 * (raw[motor, j, after] - raw[motor, j, k])
                rubbed = raw[motor + FRICTION, j, k] + raw[motor + FRICTION, j, after] + viscous * half
                flows[WORK, j, k] += (raw[motor + DRIVE, j, k] + raw[motor + DRIVE, j, after]) * half
                flows[LOST, j, k] += rubbed * half


def at_stop(position: Any, motor: Any) -> Any:
    """Whether a motor is at one of its position stops."""
    return (position <= motor[1]) | (position >= motor[2])


def held(position: Any, velocity: Any, motor: Any) -> Any:
    """Whether a motor is at a stop or at its speed limit."""
    return at_stop(position, motor) | (abs(velocity) >= motor[3])


def meet(raw: Any, velocities: Any, links: Any, motors: Any, counts: Any) -> None:
    """How many of n rows met limits, (LIMITS, joints); velocities: rad/s of the links, (joints, n). Motors that are held count
    in all rows of raw, which has some more."""
    for j in range(velocities.shape[0]):
        effort, fastest, lowest, highest = links[j, 4], links[j, 5], links[j, 6], links[j, 7]
        full_1, full_2, bent_1, bent_2 = motors[0, j, 4], motors[1, j, 4], motors[0, j, 5], motors[1, j, 5]
        efforts = speeds = saturations = deflections = stops = motor_stops = motor_speeds = stuck = 0
        for k in steps(velocities.shape[1]):
            q = raw[POSITION, j, k]
            drive_1, drive_2 = abs(raw[MOTOR_1 + DRIVE, j, k]), abs(raw[MOTOR_2 + DRIVE, j, k])
            bend_1, bend_2 = abs(raw[MOTOR_1, j, k] - q), abs(raw[MOTOR_2, j, k] - q)
            efforts += number(abs(raw[TORQUE, j, k]) > effort)
            speeds += number(abs(velocities[j, k]) > fastest)
            saturations += number((drive_1 >= full_1) | (drive_2 >= full_2))
            deflections += number((bend_1 > bent_1) | (bend_2 > bent_2))
            stops += number((q <= lowest) | (q >= highest))
        for i in range(int(links[j, 3])):
            motor, limits = MOTOR_1 + i * (MOTOR_2 - MOTOR_1), motors[i, j]
            for k in steps(raw.shape[2]):
                stuck += number(held(raw[motor, j, k], raw[motor + SPEED, j, k], limits))
            for k in steps(velocities.shape[1]):
                motor_stops += number(at_stop(raw[motor, j, k], limits))
                motor_speeds += number(abs(raw[motor + SPEED, j, k]) >= limits[3])
        counts[EFFORTS, j], counts[SPEEDS, j], counts[SATURATIONS, j] = efforts, speeds, saturations
        counts[DEFLECTIONS, j], counts[STOPS, j] = deflections, stops
        counts[MOTOR_STOPS, j], counts[MOTOR_SPEEDS, j], counts[HELD, j] = motor_stops, motor_speeds, stuck


def vanished(work: Any, lost: Any, link: Any, cut: Any, lagged: Any, kept: Any) -> Any:
    """J of which nobody knows where they went, all since the start; kept: in springs and motors."""
    return work - lost - link - cut - lagged - kept


def add_up(flows: Any, rows: Any, kept: Any, totals: Any, at: Any) -> None:
    """Sums of flows one after the other, from `totals` (FLOWS, joints) on, which go along; `at` (FLOWS, joints, m) gets those
    before the m `rows`, and for the first what has vanished by then. kept: J since the start, (joints, m)."""
    running = np.cumsum(np.concatenate([totals[:, :, None], flows], axis=2), axis=2)
    at[:], totals[:] = running[:, :, rows], running[:, :, -1]
    at[VANISHED] = vanished(at[WORK], at[LOST], at[LINK], at[CUT], at[LAGGED] if len(at) > LAGGED else 0.0, kept)


def _add_up_each(flows: Any, rows: Any, kept: Any, totals: Any, at: Any) -> None:
    """The same, compiled. Sums with names stay in the processor's registers."""
    rare = len(flows) > LAGGED
    heat = lagged = 0.0
    for j in range(flows.shape[1]):
        given, through, work, lost = totals[GIVEN, j], totals[THROUGH, j], totals[WORK, j], totals[LOST, j]
        damped, link, cut, m = totals[DAMPED, j], totals[LINK, j], totals[CUT, j], 0
        if rare:
            heat, lagged = totals[HEAT, j], totals[LAGGED, j]
        for k in range(flows.shape[2]):
            while m < len(rows) and rows[m] == k:
                at[WORK, j, m], at[LOST, j, m], at[DAMPED, j, m], at[LINK, j, m], at[CUT, j, m] = work, lost, damped, link, cut
                if rare:
                    at[HEAT, j, m], at[LAGGED, j, m] = heat, lagged
                at[VANISHED, j, m] = vanished(work, lost, link, cut, lagged, kept[j, m])
                m += 1
            given += flows[GIVEN, j, k]
            through += flows[THROUGH, j, k]
            work += flows[WORK, j, k]
            lost += flows[LOST, j, k]
            damped += flows[DAMPED, j, k]
            link += flows[LINK, j, k]
            cut += flows[CUT, j, k]
            if rare:
                heat += flows[HEAT, j, k]
                lagged += flows[LAGGED, j, k]
        totals[GIVEN, j], totals[THROUGH, j], totals[WORK, j], totals[LOST, j] = given, through, work, lost
        totals[DAMPED, j], totals[LINK, j], totals[CUT, j] = damped, link, cut
        if rare:
            totals[HEAT, j], totals[LAGGED, j] = heat, lagged


class Passes(NamedTuple):
    """What goes over the rows."""

    flow: Callable[..., None] = flow
    meet: Callable[..., None] = meet
    add_up: Callable[..., None] = add_up


PLAIN = Passes()


@cache
def compiled_passes() -> Passes:
    """The same through Numba: the same bits, and the same code for all robots."""
    from asrsim.compiling import compile_function

    # Their numbers lie apart in general: what comes is a part of a table.
    table, numbers, whole = np.zeros((2, 2, 4))[:, :, ::2], np.zeros((2, 4))[:, ::2], np.zeros((2, 2, 2))
    names = {"steps": range, "later": _one_later, "number": _one_or_none}
    found = whole[0].astype(np.int64)
    return Passes(
        compile_function(flow, (table, numbers, whole[0], whole, whole), names=names),
        compile_function(meet, (table, numbers, whole[0], whole, found), names=names),
        compile_function(_add_up_each, (whole, found[0], whole[0], whole[0], whole)),
    )


def constants_of(drives: Sequence[SteppedJoint], groups: Sequence[Group], substep: float) -> tuple[Array, Array]:
    """Numbers of links (joints, 8) and motors (2, joints, 6) that :func:`flow` and :func:`meet` take. Of a link: twice its
    passive spring (N m/rad) and where it rests (rad), whether an actuator's spring acts, motors with dynamics, and limits: N m,
    rad/s, rad, rad. Of a motor: what damping takes over a step (N m/rad), stops (rad), speed (rad/s), torque (N m), and the
    deflection of its spring (rad)."""
    links, motors = np.zeros((len(drives), 8)), np.empty((2, len(drives), 6))
    motors[:] = 0.0, -np.inf, np.inf, np.inf, np.inf, np.inf
    for link, drive in zip(links, drives, strict=True):
        joint = drive.joint
        link[:4] = 2.0 * joint.spring_stiffness, joint.spring_reference, bool(drive.mode and drive.mode.spring), 0.0
        low, high = joint.stops
        link[4:] = joint.most_effort, joint.velocity or np.inf, low + AT_STOP, high - AT_STOP
    for group in groups:
        links[group.pick, 3] = group.motors
        for i in range(group.motors):
            names = ("damping", "min_position", "max_position", "max_velocity", "max_torque")
            values = [[drive.values[f"motor_{i + 1}_{name}"] for name in names] for drive in group.drives]
            motors[i, group.pick, :5] = np.array(values) * [4.0, 1.0, 1.0, FULL, 1.0]
            motors[i, group.pick, 0] /= substep
            motors[i, group.pick, 1:3] += AT_STOP, -AT_STOP
        if "max_deflection" in group.drives[0].values:
            motors[: group.actuator.motors, group.pick, 5] = [drive.values["max_deflection"] for drive in group.drives]
    return links, motors
