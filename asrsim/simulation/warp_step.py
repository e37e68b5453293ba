"""A substep of one joint on Warp: the functions of `asrsim.simulation.joint`, translated, and the further functions that MuJoCo
Warp needs.

`asrsim.warping` also translates the functions of this file. MuJoCo Warp moves the links once in a substep: if an input jumps,
it receives the means of the loads over the pieces of the kick.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.stages import Stage
from asrsim.records import columns
from asrsim.simulation import laws
from asrsim.simulation.drives import SteppedJoint
from asrsim.simulation.fields import (
    JOINT,
    JointConstants,
    JointKind,
    JointState,
    MotorState,
    Scheme,
    columns_of_stages,
    motor_column,
)
from asrsim.simulation.joint import find_state, load_joint, move_on, settle
from asrsim.simulation.layout import TASK
from asrsim.simulation.shape import RowShape
from asrsim.simulation.staged import Composed, StageAccess, compose
from asrsim.warping import BOOL, FLOAT, INT, Row, TranslationError, Value, WarpProgram
from asrsim.warping.translate import Call, Translation
from asrsim.warping.values import number_as

LOAD, ARMATURE, FRICTION, FRACTION = range(4)
"""Columns of the loads of a joint. LOAD: torque in N m; ARMATURE: inertia in kg m^2 that has the effect of implicit damping;
FRICTION: friction in N m; FRACTION: length of the kick as a fraction of a substep.
"""
LOADS = 4


def later(table: Any, at: int) -> Any:
    """The part of a row that begins at index `at`."""
    return table[at:]


def load(
    joint: JointState, link: JointConstants, kind: JointKind, scheme: Scheme, inputs: Any, stride: int, lengths: Any, step: int,
    begin: int, end: int, on_time: int, first: bool, recorded: bool, loads: Any,
) -> None:  # fmt: skip
    """Advance a joint by a kick, and store its loads. inputs: input rows of the joint, which begin `stride` numbers apart;
    other arguments as in `asrsim.simulation.joint.load_joint`.
    """
    loads[LOAD] = loads[ARMATURE] = loads[FRICTION] = loads[FRACTION] = 0.0
    load_joint(
        joint, link, kind, scheme, (inputs, stride), lengths, (loads, later(lengths, begin)), 0, step, begin, end, on_time,
        first, recorded,
    )  # fmt: skip
    fraction, damping = loads[FRACTION], loads[ARMATURE]
    # Apply damping to a mean of the velocities before and after the kick.
    loads[LOAD] = (loads[LOAD] - damping * joint.engine_velocity) / fraction
    loads[ARMATURE] = scheme.link_implicitness * scheme.step * damping
    loads[FRICTION] = loads[FRICTION] / fraction


def add_load(loads: Any, lengths: Any, piece: int, torque: float, damping: float, friction: float) -> None:
    """Add the loads in a piece of a kick, weighted by its length, in place of `asrsim.simulation.laws.put_load`."""
    length = lengths[piece]
    loads[LOAD] += length * torque
    loads[ARMATURE] += length * damping
    loads[FRICTION] += length * friction
    loads[FRACTION] += length


def shortened(joint: JointState, scheme: Scheme, fraction: float, velocity: float) -> tuple[float, float]:
    """Velocity and position of a link after a kick that is a fraction of the engine's kick. velocity: velocity of the link
    after the engine's kick, rad/s."""
    after = joint.engine_velocity + fraction * (velocity - joint.engine_velocity)
    return after, joint.position + scheme.step * after


# -- as a program of Warp -----------------------------------------------------------------------------------------------

NUMBERS, WHOLE_NUMBERS = Row(FLOAT), Row(INT)
STATE, CONSTANTS, KIND, SCHEME = (
    Row(INT if one is JointKind else FLOAT, record=one) for one in (JointState, JointConstants, JointKind, Scheme)
)


JointLaw = tuple[Any, int, tuple[type[Stage], ...]]
"""Actuator, number of positions that its laws take, and stages."""


def program(drives: Iterable[SteppedJoint], shape: RowShape) -> tuple[WarpProgram, list[JointLaw]]:
    """The program that advances joints with these drives, and their laws: `spring_law` of a joint is the number of its law,
    from 1. Raises TranslationError that names the actuator and the line.
    """
    found = [law_of(drive, stages) for drive, stages in zip(drives, shape.stages, strict=True)]
    used = list(dict.fromkeys(law for law in found if law is not None))
    made = WarpProgram(
        {
            laws.motor_of: _part(JointState, MotorState),
            laws.drive_of: _part(JointConstants, MotorConstants),
            laws.memory_of: _memory,
            laws.spring_law: _call_law,
            # Warp does not support steppings with their own step function.
            laws.joint_step: _nothing,
            laws.inputs_of: _inputs,
            laws.put_load: _put_load,
            later: _later,
            find_state: _nothing,
        }
    )
    made.add(_law_text(made, used))
    joint = STATE, CONSTANTS, KIND, SCHEME
    for function, kinds in (
        (load, (*joint, NUMBERS, INT, NUMBERS, INT, INT, INT, INT, BOOL, BOOL, NUMBERS)),
        (settle, (*joint, FLOAT, FLOAT, BOOL, BOOL)),
        (shortened, (STATE, SCHEME, FLOAT, FLOAT)),
        (move_on, (STATE, SCHEME, FLOAT, FLOAT, BOOL)),
    ):
        name, _ = made.function(function, kinds)
        made.add(f"{function.__name__} = {name}")
    made.add(KERNELS)
    return made, used


def law_of(drive: SteppedJoint, stages: tuple[type[Stage], ...]) -> JointLaw | None:
    """Law of a joint with these stages; None without actuator."""
    return None if drive.actuator is None else (drive.actuator, drive.positions, stages)


def _nothing(caller: Translation, given: list[Value]) -> Value:
    return Value(None)


def _part(whole: Any, part: Any) -> Call:
    """Function that returns part number i of a row. The row begins with the record `whole`, and the parts follow the record."""
    first, size = len(columns(whole)), len(columns(part))
    return lambda caller, given: given[0].from_place(f"{first} + {given[1].text} * {size}", part)


def _memory(caller: Translation, given: list[Value]) -> Value:
    return given[0].from_place(given[1].field("memory").text)


def _later(caller: Translation, given: list[Value]) -> Value:
    return given[0].from_place(given[1].text)


def _inputs(caller: Translation, given: list[Value]) -> Value:
    rows, stride = given[0].items
    return rows.from_place(f"{given[1].text} * {stride.text}")


def _put_load(caller: Translation, given: list[Value]) -> Value:
    return caller.call(add_load, [*given[0].items, given[1], *given[3:]])


def _call_law(caller: Translation, given: list[Value]) -> Value:
    which, joint, link, kind, q, task = given
    values = [which.text, *(text for row in (joint, link, kind) for text in row.arguments), q.text, number_as(task, INT).text]
    caller.line(f"spring_law({', '.join(values)})")
    return Value(None)


ROWS = "s: wp.array(dtype=float), s_at: int, p: wp.array(dtype=float), p_at: int, k: wp.array(dtype=int), k_at: int"
"""Arguments of a function that receives the state, the constants and the kind of a joint."""


def _law_text(made: WarpProgram, used: Sequence[JointLaw]) -> str:
    """A function that calls the laws with a number."""
    lines = ["@wp.func", f"def spring_law(which: int, {ROWS}, q: float, task: int):"]
    for number, law in enumerate(used, start=1):
        lines += [f"    if which == {number}:", *(f"        {line}" for line in _lines_of(made, *law, f"r_{number}"))]
    return "\n".join([*lines, "    return"])


def _lines_of(made: WarpProgram, actuator: Any, count: int, stages: tuple[type[Stage], ...], own: str) -> Iterator[str]:
    """Lines of code that carry out a task of the laws of an actuator with stages. own: prefix of the names in these lines."""
    kinds = [*[FLOAT] * (1 + count), Row(FLOAT, len(actuator.parameters))]
    law = f"p_at + int(k[k_at + {columns(JointKind)['law']}])"
    staged = compose(stages, partial(_access, made, actuator, stages)) if stages else None
    place = staged.place if staged is not None else None
    ends = [f"s[s_at + {motor_column('theta' if place is None else 'end', i)}]" for i in range(count)]
    try:
        torques, found = made.function(actuator.elastic_torques, kinds)
        stiffness, one = made.function(actuator.stiffness, kinds)
        names = dict.fromkeys(Composed._fields, "")
        if staged is not None:
            rows = [(task, rule) for task, rule in staged._asdict().items() if rule is not None]
            for task, rule in rows:
                names[task], _ = made.function(rule, [*JOINT_ROWS, *[FLOAT] * (task in ("place", "add"))])
    except TranslationError as error:
        of = "".join(f" with the stage '{stage.name}'" for stage in stages)
        raise TranslationError(f"the laws of '{actuator.name}'{of} have no translation to Warp: {error}") from error
    joint, results = "s, s_at, p, p_at, k, k_at", [f"{own}_{i}" for i in range(len(found.kinds))]

    def called(rule: str, q: str = "q") -> str:
        return f"{rule}({', '.join([q, *ends, 'p', law])})"

    def placed(q: str) -> Iterator[str]:
        if place is not None:
            yield f"{names['place']}({joint}, {q})"

    if staged is not None:
        yield f"if task == {TASK.remember}:"
        yield f"    {names['remember']}({joint})"
        yield "    return"
    if place is not None:
        yield f"if task == {TASK.whole}:"
        sums = []
        for sign, side in (("-", "below"), ("+", "above")):
            yield from (f"    {line}" for line in placed(f"q {sign} {SLOPE_ON_WARP}"))
            yield f"    {', '.join(f'{one}_{side}' for one in results)} = {called(torques, f'q {sign} {SLOPE_ON_WARP}')}"
            sums.append(
                " + ".join(
                    number_as(Value(kind, f"{name}_{side}"), FLOAT).text
                    for name, kind in zip(results[: len(results) - actuator.housed], found.kinds, strict=False)
                )
            )
        yield f"    s[s_at + {JOINT['stiffness']}] = (({sums[0]}) - ({sums[1]})) / {2.0 * SLOPE_ON_WARP}"
    yield from placed("q")
    yield f"{', '.join(results)} = {called(torques)}"
    for i, (name, kind) in enumerate(zip(results, found.kinds, strict=True)):
        yield f"s[s_at + {motor_column('pull', i)}] = {number_as(Value(kind, name), FLOAT).text}"
    if place is None:
        yield f"if task == {TASK.whole}:"
        yield f"    s[s_at + {JOINT['stiffness']}] = {number_as(Value(one, called(stiffness)), FLOAT).text}"
    if staged is not None:
        yield f"{names['add']}({joint}, q)"


SLOPE_ON_WARP = 1e-3
"""Distance as in `asrsim.simulation.staged.SLOPE`, for single precision."""
JOINT_ROWS = STATE, CONSTANTS, KIND


def _access(made: WarpProgram, actuator: Any, stages: Sequence[type[Stage]], number: int, stage: type[Stage]) -> StageAccess:
    """Functions, for translated code, that find the parts of stage `number` of a joint with this actuator."""
    first = len(actuator.parameters) + columns_of_stages(stages[:number], actuator.motors)
    size, memory = 1 + len(columns(stage.Constants)), len(columns(stage.Memory))
    place = str(len(columns(JointKind)) + number)

    def at(row: Value, column: Value, begin: int, i: Value, apart: int) -> str:
        return f"int({column.text}) + {begin} + {i.text} * {apart}"

    def acts(caller: Translation, given: list[Value]) -> Value:
        return given[0].part(at(given[0], given[1].field("law"), first, given[2], size))

    def own(caller: Translation, given: list[Value]) -> Value:
        return given[0].from_place(at(given[0], given[1].field("law"), first + 1, given[2], size), stage.Constants)

    def remembered(caller: Translation, given: list[Value]) -> Value:
        return given[0].from_place(at(given[0], given[1].part(place), 1, given[2], memory), stage.Memory)

    def lose(caller: Translation, given: list[Value]) -> Value:
        there = given[0].part(given[1].part(place).text)
        caller.line(f"{there.text} = {there.text} + {given[2].text}")
        return Value(None)

    return StageAccess(*(made.special(one) for one in (acts, own, remembered, lose)))


KERNELS = """
@wp.func
def stop_of(q: float, v: float, low: float, high: float, h: float):
    # MuJoCo's stops act only on joints beyond them, so an impact would be late by part of a step. A joint that would pass its
    # stop within this step counts as just beyond, and keeps the velocity that takes it to the stop; a joint at its stop keeps
    # no velocity.
    gap, speed, near = high - q, v, wp.vec2(low, q - 1.0e-6)
    if q - low < gap:
        gap, speed, near = q - low, -v, wp.vec2(q + 1.0e-6, high)
    if gap > 0.0 and gap < 1.0e-4:
        return near, wp.vec2(0.0, -1.0 / h)
    if gap > 0.0 and speed * h > gap:
        return near, wp.vec2(0.0, -(1.0 - gap / (h * speed)) / h)
    if gap <= 0.0:
        # Beyond its stop a joint returns slowly, so that it does not rebound.
        return wp.vec2(low + 1.0e-6, high - 1.0e-6), wp.vec2(-0.2 / (h * h), -1.0 / h)
    return wp.vec2(low, high), wp.vec2(0.0, -1.0 / h)


@wp.kernel
def load_joints(
    s: wp.array(dtype=float), p: wp.array(dtype=float), k: wp.array(dtype=int), z: wp.array(dtype=float),
    sizes: wp.array(dtype=int), inputs: wp.array(dtype=float), lengths: wp.array(dtype=float), pieces: wp.array(dtype=int),
    which: wp.array2d(dtype=int), done: wp.array(dtype=int), ran: wp.array(dtype=int), freedoms: wp.array(dtype=int),
    loads: wp.array(dtype=float), force: wp.array2d(dtype=float), armature: wp.array2d(dtype=float),
    friction: wp.array2d(dtype=float), coordinates: wp.array(dtype=int), stops: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float), qvel: wp.array2d(dtype=float), ranges: wp.array2d(dtype=wp.vec2),
    references: wp.array2d(dtype=wp.vec2),
):
    w, j = wp.tid()
    joints, rows, columns = sizes[0], sizes[1], sizes[2]
    i = w * joints + j
    step = ran[w] + sizes[3]
    substep = done[w] + ran[w]
    at = (which[w, 2] * rows + step) * 3
    load(
        s, i * sizes[4], p, i * sizes[5], k, j * sizes[6], z, 0, inputs, (which[w, 1] * rows * joints + j) * columns,
        joints * columns, lengths, which[w, 2] * rows, step, pieces[at], pieces[at + 1], pieces[at + 2], substep == 0,
        substep % sizes[7] == 0, loads, i * 4,
    )
    freedom = freedoms[j]
    force[w, freedom] = loads[i * 4]
    armature[w, freedom] = loads[i * 4 + 1]
    friction[w, freedom] = loads[i * 4 + 2]
    joint = int(stops[j * 4 + 2])
    limits, reference = stop_of(qpos[w, coordinates[j]], qvel[w, freedom], stops[j * 4], stops[j * 4 + 1], stops[j * 4 + 3])
    ranges[w, joint] = limits
    references[w, joint] = reference


@wp.kernel
def settle_joints(
    s: wp.array(dtype=float), p: wp.array(dtype=float), k: wp.array(dtype=int), z: wp.array(dtype=float),
    sizes: wp.array(dtype=int), pieces: wp.array(dtype=int), which: wp.array2d(dtype=int), done: wp.array(dtype=int),
    ran: wp.array(dtype=int), freedoms: wp.array(dtype=int), coordinates: wp.array(dtype=int), loads: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float), qvel: wp.array2d(dtype=float), columns: wp.array(dtype=int), rows: wp.array4d(dtype=float),
):
    w, j = wp.tid()
    i = w * sizes[0] + j
    substep = done[w] + ran[w]
    at = i * sizes[4]
    velocity = qvel[w, freedoms[j]]
    position = qpos[w, coordinates[j]]
    if loads[i * 4 + 3] < 0.99:
        # The first kick is shorter than a substep.
        velocity, position = shortened(s, at, z, 0, loads[i * 4 + 3], velocity)
        qvel[w, freedoms[j]] = velocity
        qpos[w, coordinates[j]] = position
    on_time = pieces[(which[w, 2] * sizes[1] + ran[w] + sizes[3]) * 3 + 2]
    settle(s, at, p, i * sizes[5], k, j * sizes[6], z, 0, velocity, wp.nan, substep == 0, on_time >= 0)
    if substep % sizes[7] == 0:
        place = substep // sizes[7] - (done[w] + sizes[7] - 1) // sizes[7]
        for c in range(columns.shape[0]):
            rows[place, w, j, c] = s[at + columns[c]]
    move_on(s, at, z, 0, position, velocity, substep == 0)


@wp.kernel
def count_steps(ran: wp.array(dtype=int)):
    w = wp.tid()
    ran[w] = ran[w] + 1
"""
"""Kernels over worlds and joints. sizes: joints, rows and columns of an input table, its first row, columns of S, P and K,
substeps between recorded rows.
"""
