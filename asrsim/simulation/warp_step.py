"""A substep of one joint on Warp: the order in which `asrsim.simulation.kernel.run` calls the functions of the kernel.

The functions here are source for `asrsim.warping`, as those of the kernel are. Unlike there, MuJoCo Warp moves the links once in
a substep: if an input jumps, it receives the means of the torques over the pieces of the kick.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from asrsim.simulation import kernel, laws
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.layout import (
    APPLIED,
    BRAKE,
    CONTROLLERS,
    DRAG,
    ENGINE_VELOCITY,
    EXTERNAL,
    LAST_ENGINE_VELOCITY,
    LINK_IMPLICITNESS,
    P_DAMPING_RATIO,
    P_LEVEL,
    POSITION,
    PUSH,
    STAGGERED,
    STEP,
    STIFFNESS,
    TORQUE,
    WEIGHT_LAST,
    WEIGHT_NOW,
)  # fmt: skip
from asrsim.warping import BOOL, FLOAT, INT, NotTranslatable, Program, Row, Value
from asrsim.warping.kinds import number_as
from asrsim.warping.translate import Translation

LOAD, ARMATURE, FRICTION, FRACTION = range(4)
"""Columns of the loads of a joint: torque in N m, inertia in kg m^2 by which implicit damping acts, friction in N m, length of
the kick as a fraction of a substep."""
LOADS = 4


def later(table: Any, at: int) -> Any:
    """The row that begins at the index `at` of a row."""
    return table[at:]


def load(
    s: Any, p: Any, k: Any, z: Any, inputs: Any, stride: int, pieces: Any, lengths: Any, step: int, first: bool, recorded: bool,
    loads: Any,
) -> None:  # fmt: skip
    """Advance motors and springs of a joint by a substep, with the link at its present position, and store its loads.

    inputs: input rows of the joint, `stride` numbers apart; pieces: first row and last row + 1 of the pieces of the kick, and
    row of the piece that begins at the time of the substep, or -1 for a kick of one piece; lengths: lengths of the rows' pieces;
    step: row of the substep; first: whether the run begins; recorded: whether the values are recorded.
    """
    v = z[WEIGHT_NOW] * s[ENGINE_VELOCITY] + z[WEIGHT_LAST] * s[LAST_ENGINE_VELOCITY]
    if k[CONTROLLERS]:
        kernel.remember_positions(s, p, k, z)
    begin, end, on_time = pieces[0], pieces[1], pieces[2]
    jumped = on_time >= 0
    since = 0.0 if first else -0.5 * z[STAGGERED]
    until = -since
    torque = applied = push = drag = force = damping = friction = fraction = 0.0
    for turn in range(begin, end + 1 if jumped else end):
        at, length, noted = turn, 1.0, not jumped
        if jumped and turn == on_time:
            at, length, noted, since, until = step, 0.0, True, 0.0, 0.0
        elif jumped:
            at = turn - 1 if turn > on_time else turn
            length = lengths[at]
            until = since + length
        u = later(inputs, at * stride)
        if k[CONTROLLERS]:
            kernel.read_sensors(s, p, k, z, u, since, until)
        since = until
        kernel.advance(s, p, k, z, u, length * z[STEP], noted, recorded or p[P_DAMPING_RATIO] != 0.0)
        s[BRAKE] = kernel.limit(s, p, v)
        s[PUSH] = kernel.push_of(s, p, u[EXTERNAL])
        s[DRAG] = kernel.damping_of(s, p)
        if noted:
            torque, applied, push, drag = s[TORQUE], s[APPLIED], s[PUSH], s[DRAG]
        fraction += length
        force += length * (s[APPLIED] + s[PUSH])
        damping += length * (s[DRAG] + s[BRAKE])
        friction += length * kernel.friction_of(s, p, v)
    s[TORQUE], s[APPLIED], s[PUSH], s[DRAG] = torque, applied, push, drag
    # Damping acts on a mean of the velocities before and after the kick.
    loads[LOAD] = (force - damping * s[ENGINE_VELOCITY]) / fraction
    loads[ARMATURE] = z[LINK_IMPLICITNESS] * z[STEP] * damping
    loads[FRICTION] = friction / fraction
    loads[FRACTION] = fraction


def settle(s: Any, p: Any, k: Any, z: Any, velocity: float, first: bool) -> None:
    """Store the values at the time of the substep after the engine has moved the link. velocity: of the link now, rad/s."""
    now = 0.5 * (s[ENGINE_VELOCITY] + velocity)
    if first or z[STAGGERED] == 0.0:
        now = s[ENGINE_VELOCITY]
    kernel.read_engine(s, p, z, velocity, now, False)
    if p[P_LEVEL] > 0.0:
        kernel.remember_springs(s, p, k)


def move_on(s: Any, z: Any, position: float, velocity: float, first: bool) -> None:
    """Store the position (rad) and velocity (rad/s) of the link for the next substep."""
    last = s[ENGINE_VELOCITY]
    if first and z[STAGGERED] != 0.0:
        last = 2.0 * s[ENGINE_VELOCITY] - velocity
    s[LAST_ENGINE_VELOCITY], s[ENGINE_VELOCITY], s[POSITION] = last, velocity, position


# -- as a program of Warp -----------------------------------------------------------------------------------------------

FLOATS, INTEGERS = Row(FLOAT), Row(INT)


def program(drives: Iterable[SteppedJoint]) -> tuple[Program, tuple[Any, ...]]:
    """The program that advances joints with these drives, and their actuators: `SPRING_LAW` of a joint is the number of its
    actuator, from 1. Raises NotTranslatable that names the actuator and the line."""
    actuators = tuple(dict.fromkeys(drive.actuator for drive in drives if drive.actuator is not None))
    positions = {drive.actuator: drive.positions for drive in drives}
    made = Program({laws.numbers: _numbers, laws.spring_law: _call_law, later: _later, kernel.find_state: _nothing})
    made.add(_law_text(made, actuators, positions))
    for function, kinds in (
        (load, (*[FLOATS] * 2, INTEGERS, *[FLOATS] * 2, INT, INTEGERS, FLOATS, INT, BOOL, BOOL, FLOATS)),
        (settle, (FLOATS, FLOATS, INTEGERS, FLOATS, FLOAT, BOOL)),
        (move_on, (FLOATS, FLOATS, FLOAT, FLOAT, BOOL)),
    ):
        name, _ = made.function(function, kinds)
        made.add(f"{function.__name__} = {name}")
    made.add(KERNELS)
    return made, actuators


def _nothing(caller: Translation, given: list[Value]) -> Value:
    return Value(None)


def _numbers(caller: Translation, given: list[Value]) -> Value:
    return given[0].from_place(given[1].text, laws.MOTOR_NUMBERS)


def _later(caller: Translation, given: list[Value]) -> Value:
    return given[0].from_place(given[1].text)


def _call_law(caller: Translation, given: list[Value]) -> Value:
    # `call` is also the function by which other steppings advance a joint: they do not run on Warp.
    if len(given) != 8:
        return Value(None)
    which, s, thetas, torques, p, law, q, whole = given
    row = p.from_place(law.text)
    values = [which.text, *s.arguments, thetas.text, torques.text, *row.arguments, q.text, number_as(whole, INT).text]
    caller.line(f"spring_law({', '.join(values)})")
    return Value(None)


def _law_text(made: Program, actuators: Iterable[Any], positions: Any) -> str:
    """A function that calls the laws of the actuator with a number."""
    lines = ["@wp.func", (
        "def spring_law(which: int, s: wp.array(dtype=float), s_at: int, thetas: int, torques: int, p: wp.array(dtype=float), "
        "p_at: int, q: float, whole: int):"
    ), "    t = s_at + thetas", "    r = s_at + torques"]  # fmt: skip
    for number, actuator in enumerate(actuators, start=1):
        count = positions[actuator]
        kinds = [*[FLOAT] * (1 + count), Row(FLOAT, len(actuator.parameters))]
        values = ", ".join(["q", *(f"s[t + {i}]" for i in range(count)), "p", "p_at"])
        try:
            torques, found = made.function(actuator.elastic_torques, kinds)
            stiffness, one = made.function(actuator.stiffness, kinds)
        except NotTranslatable as error:
            raise NotTranslatable(f"the laws of '{actuator.name}' have no translation to Warp: {error}") from error
        names = [f"r_{number}_{i}" for i in range(len(found.kinds))]
        lines += [f"    if which == {number}:", f"        {', '.join(names)} = {torques}({values})"]
        lines += [
            f"        s[r + {i}] = {number_as(Value(kind, name), FLOAT).text}"
            for i, (name, kind) in enumerate(zip(names, found.kinds, strict=True))
        ]
        lines += ["        if whole != 0:"]
        lines += [f"            s[s_at + {STIFFNESS}] = {number_as(Value(one, f'{stiffness}({values})'), FLOAT).text}"]
    return "\n".join([*lines, "    return"])


KERNELS = '''
@wp.kernel
def load_joints(
    s: wp.array(dtype=float), p: wp.array(dtype=float), k: wp.array(dtype=int), z: wp.array(dtype=float),
    sizes: wp.array(dtype=int), inputs: wp.array(dtype=float), lengths: wp.array(dtype=float), pieces: wp.array(dtype=int),
    which: wp.array2d(dtype=int), done: wp.array(dtype=int), ran: wp.array(dtype=int), freedoms: wp.array(dtype=int),
    loads: wp.array(dtype=float), force: wp.array2d(dtype=float), armature: wp.array2d(dtype=float),
    friction: wp.array2d(dtype=float),
):
    w, j = wp.tid()
    joints, rows, columns = sizes[0], sizes[1], sizes[2]
    i = w * joints + j
    step = ran[w] + sizes[3]
    substep = done[w] + ran[w]
    at = (which[w, 2] * rows + step) * 3
    load(
        s, i * sizes[4], p, i * sizes[5], k, j * sizes[6], z, 0, inputs, (which[w, 1] * rows * joints + j) * columns,
        joints * columns, pieces, at, lengths, which[w, 2] * rows, step, substep == 0, substep % sizes[7] == 0, loads, i * 4,
    )
    freedom = freedoms[j]
    force[w, freedom] = loads[i * 4]
    armature[w, freedom] = loads[i * 4 + 1]
    friction[w, freedom] = loads[i * 4 + 2]


@wp.kernel
def settle_joints(
    s: wp.array(dtype=float), p: wp.array(dtype=float), k: wp.array(dtype=int), z: wp.array(dtype=float),
    sizes: wp.array(dtype=int), done: wp.array(dtype=int), ran: wp.array(dtype=int), freedoms: wp.array(dtype=int),
    coordinates: wp.array(dtype=int), loads: wp.array(dtype=float), qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float), columns: wp.array(dtype=int), rows: wp.array4d(dtype=float),
):
    w, j = wp.tid()
    i = w * sizes[0] + j
    substep = done[w] + ran[w]
    at = i * sizes[4]
    velocity = qvel[w, freedoms[j]]
    position = qpos[w, coordinates[j]]
    if loads[i * 4 + 3] < 0.99:
        # The first kick is shorter than a substep.
        before = s[at + ENGINE_VELOCITY]
        velocity = before + loads[i * 4 + 3] * (velocity - before)
        position = s[at + POSITION] + z[STEP] * velocity
        qvel[w, freedoms[j]] = velocity
        qpos[w, coordinates[j]] = position
    settle(s, at, p, i * sizes[5], k, j * sizes[6], z, 0, velocity, substep == 0)
    if substep % sizes[7] == 0:
        place = substep // sizes[7] - (done[w] + sizes[7] - 1) // sizes[7]
        for c in range(columns.shape[0]):
            rows[place, w, j, c] = s[at + columns[c]]
    move_on(s, at, z, 0, position, velocity, substep == 0)


@wp.kernel
def count_steps(ran: wp.array(dtype=int)):
    w = wp.tid()
    ran[w] = ran[w] + 1
'''.replace("ENGINE_VELOCITY", str(ENGINE_VELOCITY)).replace("POSITION", str(POSITION)).replace("STEP]", f"{STEP}]")
"""Kernels over worlds and joints. sizes: joints, rows and columns of an input table, its first row, columns of S, P and K,
substeps between recorded rows."""
