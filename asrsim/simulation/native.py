"""Compilation of kernel and laws. One compiled kernel serves all robots, since it calls laws and engine by address."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from asrsim.actuators.motor import MotorConstants
from asrsim.actuators.stages import Stage
from asrsim.actuators.vectorised import energy_law
from asrsim.compiled import compiling
from asrsim.errors import SimulationError, listed
from asrsim.records import columns, numbers, own_fields
from asrsim.simulation import kernel
from asrsim.simulation.arguments import Common, Corrections, EngineCall, RowSelection, Stretch, Tables
from asrsim.simulation.fields import JointConstants, JointKind, JointState, MotorState, Scheme, columns_of_stages
from asrsim.simulation.inputs import Given
from asrsim.simulation.layout import TASK
from asrsim.simulation.staged import SLOPE, StageAccess, compose

INLINE = (
    "asrsim.actuators.motor",
    __name__,
    *(f"asrsim.simulation.{name}" for name in ("kernel", "joint", "sensing", "ledger", "laws", "staged")),
)
"""Modules whose functions are inlined into their callers."""


@cache
def compiled_run() -> Any:
    """`asrsim.simulation.kernel.run`, compiled for arrays."""
    whole = {n: np.zeros((1,) * n, dtype=np.int64) for n in (1, 2, 3)}
    floats = {n: np.zeros((1,) * n) for n in (1, 2, 3, 4)}
    example = (
        Stretch(which=whole[2], first=1, substeps=1),
        Tables(
            states=floats[3],
            constants=floats[3],
            engines=floats[2],
            done=whole[1],
            fault=whole[2],
            rows=floats[3],
            strides=whole[2],
        ),
        Common(
            kinds=whole[2],
            scheme=np.zeros(1, dtype=_dtype(Scheme)),
            sizes=whole[1],
            deflections=floats[2],
            stiffest=floats[2],
            shares=floats[2],
        ),
        Given(inputs=floats[4], references=floats[4], wrenches=floats[4], lengths=floats[2], cuts=whole[3]),
        EngineCall(step=1, records=whole[1], exchange=floats[3]),
        RowSelection(every=1, watched=1, of_state=whole[1], of_inputs=whole[1]),
        Corrections(measured=floats[4], gains=floats[1], coordinates=whole[2]),
        floats[4],
    )
    return compiling.compile_function(kernel.run, example, names={**_pointers(), "record": _record}, inline=INLINE)


def _record(out: Any, place: int, kept: int, j: int, joint: Any, of_state: Any, references: Any, of_inputs: Any) -> None:
    for c in range(len(of_state)):
        out[place, kept, j, c] = value_of(joint, of_state[c])
    for c in range(len(of_inputs)):
        out[place, kept, j, len(of_state) + c] = references[of_inputs[c]]


def bound_law(actuator: Any, motors: int, stages: tuple[type[Stage], ...] = ()) -> compiling.Callback:
    """The laws of an actuator and of the stages of its joint, compiled to a C function; see
    `asrsim.simulation.interpreted.bound_law`. Raises SimulationError.
    """
    first, size = len(columns(JointState)), len(columns(MotorState))
    count = len(actuator.parameters)
    staged = compose(stages, partial(_access, actuator, stages)) if stages else None
    placed = staged is not None and staged.place is not None
    names = {
        **_pointers(),
        "torques": actuator.elastic_torques,
        "stiffness": actuator.stiffness,
        "energy": energy_law(actuator),
        "positions": compiling.numbers_reader(motors, first + columns(MotorState)["end" if placed else "theta"], size),
        "parameters": compiling.numbers_reader(count),
        "row": compiling.row_at(),
        "joint_at": _at(JointState),
        "link_at": _at(JointConstants),
        "kind_at": _at(JointKind),
    }
    laws: Any = _laws
    if staged is not None:
        names |= {name: law for name, law in staged._asdict().items() if law is not None}
        names["springs"], laws = _put_placed if placed else _put_laws, _staged_laws
    try:
        return compiling.compile_law(laws, names, "aaadi")
    except Exception as error:
        reason = str(error).strip().splitlines()[0]
        of = f" with {listed([stage.name for stage in stages], 4)}" if stages else ""
        raise SimulationError(f"Numba cannot compile the laws of '{actuator.name}'{of}: {reason}") from error


# Code that may raise an error is in a separate function, since Numba does not support starred arguments inside `try`. If a law
# raises an error, the world stops, and the error names the joint.
def _laws(s: int, p: int, k: int, q: float, task: int) -> None:
    try:
        _put_laws(s, p, kind_at(k), q, task)
    except Exception:
        motor_of(joint_at(s), 0).pull = np.nan


def _put_laws(s: int, p: int, kind: Any, q: float, task: int) -> None:
    # All laws are evaluated before anything is written, so that the compiler can share their common subexpressions.
    given = q, *positions(row(s), 0), parameters(row(p), kind.law)
    values = torques(*given)
    known = 0.0, 0.0
    if task == TASK.whole:
        known = stiffness(*given), energy(*given)
    joint = joint_at(s)
    for i in range(len(values)):
        motor_of(joint, i).pull = values[i]
    if task == TASK.whole:
        joint.stiffness, joint.law_energy = known


def _put_placed(s: int, p: int, kind: Any, q: float, task: int) -> None:
    """Store the results as in `_put_laws`, with stages in series with the springs. The stiffness is the slope of the torque
    with these stages."""
    joint, link = joint_at(s), link_at(p)
    if task == TASK.whole:
        place(joint, link, kind, q + SLOPE)
        least = _sum(torques(q + SLOPE, *positions(row(s), 0), parameters(row(p), kind.law)), kind.pulling)
        place(joint, link, kind, q - SLOPE)
        most = _sum(torques(q - SLOPE, *positions(row(s), 0), parameters(row(p), kind.law)), kind.pulling)
        joint.stiffness = 0.5 / SLOPE * (most - least)
    place(joint, link, kind, q)
    given = q, *positions(row(s), 0), parameters(row(p), kind.law)
    values = torques(*given)
    if task == TASK.whole:
        joint.law_energy = energy(*given)
    for i in range(len(values)):
        motor_of(joint, i).pull = values[i]


def _sum(values: Any, count: int) -> Any:
    total = 0.0
    for i in range(count):
        total += values[i]
    return total


def _staged_laws(s: int, p: int, k: int, q: float, task: int) -> None:
    try:
        _put_staged(s, p, kind_at(k), q, task)
    except Exception:
        motor_of(joint_at(s), 0).pull = np.nan
        if task >= TASK.remember:
            # The torques of this kick have already been used, so make the torque of the next kick NaN.
            motor_of(joint_at(s), 0).position = np.nan


def _put_staged(s: int, p: int, kind: Any, q: float, task: int) -> None:
    joint, link = joint_at(s), link_at(p)
    if task == TASK.remember:
        remember(joint, link, kind)
    elif task == TASK.store:
        store(joint, link, kind)
    elif task == TASK.lose:
        lose(joint, link, kind)
    else:
        springs(s, p, kind, q, task)
        add(joint, link, kind, q)


def bound_step(function: Any) -> compiling.Callback:
    """The function by which a stepping advances a joint, compiled; see `asrsim.simulation.laws.joint_step`."""
    names = {
        **_pointers(),
        "own_step": function,
        "row": compiling.row_at(),
        "joint_at": _at(JointState),
        "link_at": _at(JointConstants),
        "kind_at": _at(JointKind),
    }
    return compiling.compile_law(_joint_step, names, "aaaadi")


def _joint_step(s: int, p: int, k: int, u: int, h: float, note: int) -> None:
    own_step(joint_at(s), link_at(p), kind_at(k), row(u), h, note)


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("the compiler replaces this function")


torques = stiffness = energy = positions = parameters = row = own_step = joint_at = link_at = kind_at = _unbound
springs = place = add = remember = store = lose = motor_of = value_of = _unbound


@cache
def _type(kind: Any) -> Any:
    """Numba's type of a record: names for numbers in memory, in the order of `asrsim.records.columns`."""
    import numba

    make: Any = numba.from_dtype
    return make(_dtype(kind))


def _dtype(kind: Any) -> np.dtype[Any]:
    def of(field: Any) -> Any:
        inner = field.metadata.get("record")
        return _dtype(inner) if inner else np.int64 if field.metadata.get("integer") else np.float64

    # Give an empty record a field, since Numba does not support records without fields.
    return np.dtype([(field.name, of(field)) for field in own_fields(kind)] or [("nothing", np.float64)], align=True)


@cache
def _at(kind: Any) -> Any:
    """Function for compiled code that returns the record at an address."""
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types
    found = _type(kind)

    def record_at(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(found))

        return found(kinds.intp), generate

    record_at.__name__ = f"{kind.__name__}_at"
    return intrinsic(record_at)


@cache
def _part(whole: Any, part: Any) -> Any:
    """Function for compiled code that returns part number i of a row, in which the parts follow a record."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types
    found, first, size = _type(part), len(columns(whole)), len(columns(part))

    def part_of(typing: Any, record: Any, i: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            numbers = builder.bitcast(arguments[0], ir.DoubleType().as_pointer())
            place = builder.add(
                builder.mul(arguments[1], ir.Constant(ir.IntType(64), size)), ir.Constant(ir.IntType(64), first)
            )
            return builder.bitcast(builder.gep(numbers, [place]), context.get_value_type(found))

        return found(record, kinds.int64), generate

    part_of.__name__ = f"{part.__name__}_of_{whole.__name__}"
    return intrinsic(part_of)


def _access(actuator: Any, stages: Sequence[type[Stage]], number: int, stage: type[Stage]) -> StageAccess:
    """Functions for compiled code that find the parts of stage `number` of a joint with this actuator."""
    first = len(actuator.parameters) + columns_of_stages(stages[:number], actuator.motors)
    own, memory = 1 + len(columns(stage.Constants)), len(columns(stage.Memory))
    law, place = columns(JointKind)["law"], len(columns(JointKind)) + number
    return StageAccess(
        acts=_part_at(None, law, first, own),
        own=_part_at(stage.Constants, law, first + 1, own),
        memory=_part_at(stage.Memory, place, 1, memory),
        lose=_adding_at(place),
    )


def _place_of(builder: Any, row: Any, kind: Any, column: int, i: Any, first: int, apart: int) -> Any:
    """Pointer to a number in a row. The column of this number is the value in column `column` of the kind, plus `first + apart
    * i`.
    """
    from llvmlite import ir

    word = ir.IntType(64)
    begin = builder.load(builder.gep(builder.bitcast(kind, word.as_pointer()), [ir.Constant(word, column)]))
    place = builder.add(builder.add(begin, ir.Constant(word, first)), builder.mul(i, ir.Constant(word, apart)))
    return builder.gep(builder.bitcast(row, ir.DoubleType().as_pointer()), [place])


@cache
def _part_at(part: Any, column: int, first: int, apart: int) -> Any:
    """Function for compiled code that takes a row, a kind and a number i, and returns the record in the row at a place that the
    kind contains. part: class of the record; None: a single number instead of a record.
    """
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types
    found: Any = kinds.float64 if part is None else _type(part)

    def part_of(typing: Any, row: Any, kind: Any, i: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            place = _place_of(builder, arguments[0], arguments[1], column, arguments[2], first, apart)
            return builder.load(place) if part is None else builder.bitcast(place, context.get_value_type(found))

        return found(row, kind, kinds.int64), generate

    part_of.__name__ = f"{'number' if part is None else part.__name__}_by_{column}_{first}_{apart}"
    return intrinsic(part_of)


@cache
def _adding_at(column: int) -> Any:
    """Function for compiled code that adds a value to the number in a row at a place that the kind contains."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types

    def add_to(typing: Any, row: Any, kind: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            zero = ir.Constant(ir.IntType(64), 0)
            place = _place_of(builder, arguments[0], arguments[1], column, zero, 0, 0)
            builder.store(builder.fadd(builder.load(place), arguments[2]), place)
            return context.get_dummy_value()

        return kinds.void(row, kind, kinds.float64), generate

    add_to.__name__ = f"add_by_{column}"
    return intrinsic(add_to)


def scheme_table(schemes: Sequence[Scheme]) -> NDArray[Any]:
    """Table with the constants of steppings."""
    return np.array([numbers(scheme) for scheme in schemes], dtype=_dtype(Scheme))


@cache
def _pointers() -> dict[str, Any]:
    """Replacements in compiled code for the functions of `asrsim.simulation.laws`, by name. Each replacement calls through a
    pointer.
    """
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types
    # Store these results in variables. The digest of the compiled code covers variables that the code uses, but not the results
    # of functions that it calls.
    records, memory = (_type(JointState), _type(JointConstants), _type(JointKind)), columns(JointKind)["memory"]

    def passed(*given: Any) -> Any:
        """Numba signature and code generator of a call of the C function whose address is the first argument. Arrays are passed
        as addresses of their data.
        """
        signature = kinds.void(*given)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, *values = [
                context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
                for kind, value in zip(signature.args, arguments, strict=True)
            ]
            # Do not unroll the loops over motors and columns. They are short, and unrolled loops would cost 5 % of the time.
            builder.function.attributes.add("optsize")
            function = ir.FunctionType(ir.VoidType(), [value.type for value in values])
            builder.call(builder.inttoptr(at, function.as_pointer()), values)
            return context.get_dummy_value()

        return signature, generate

    def call_law(typing: Any, address: Any, a: Any, b: Any, c: Any, d: Any, e: Any) -> Any:
        return passed(address, a, b, c, d, e)

    def call_step(typing: Any, address: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any) -> Any:
        return passed(address, a, b, c, d, e, f)

    def row_in(context: Any, builder: Any, kind: Any, table: Any, *place: Any) -> Any:
        """Pointer to the row at these indices of a table."""
        whole = context.make_array(kind)(context, builder, table)
        at = place[0]
        for axis, index in enumerate(place[1:], start=1):
            at = builder.add(builder.mul(at, builder.extract_value(whole.shape, axis)), index)
        return builder.gep(whole.data, [builder.mul(at, builder.extract_value(whole.shape, len(place)))])

    def find_inputs(typing: Any, table: Any, at: Any, j: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return row_in(context, builder, signature.args[0], *arguments)

        return kinds.CPointer(table.dtype)(table, kinds.int64, kinds.int64), generate

    def find_joint(typing: Any, states: Any, constants: Any, table: Any, j: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            *tables, j = arguments
            rows = [
                builder.bitcast(row_in(context, builder, kind, one, j), context.get_value_type(found))
                for kind, one, found in zip(signature.args, tables, records, strict=False)
            ]
            return context.make_tuple(builder, signature.return_type, rows)

        return kinds.Tuple(records)(states, constants, table, kinds.int64), generate

    def find_value(typing: Any, record: Any, column: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            numbers = builder.bitcast(arguments[0], ir.DoubleType().as_pointer())
            return builder.load(builder.gep(numbers, [arguments[1]]))

        return kinds.float64(record, kinds.int64), generate

    def find_memory(typing: Any, record: Any, kind: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            integers = builder.bitcast(arguments[1], ir.IntType(64).as_pointer())
            place = builder.load(builder.gep(integers, [ir.Constant(ir.IntType(64), memory)]))
            return builder.gep(builder.bitcast(arguments[0], ir.DoubleType().as_pointer()), [place])

        return kinds.CPointer(kinds.float64)(record, kind), generate

    return {
        "spring_law": intrinsic(call_law),
        "engine_step": intrinsic(call_step),
        "joint_step": intrinsic(call_step),
        "inputs_of": intrinsic(find_inputs),
        "joint_of": intrinsic(find_joint),
        "motor_of": _part(JointState, MotorState),
        "drive_of": _part(JointConstants, MotorConstants),
        "value_of": intrinsic(find_value),
        "memory_of": intrinsic(find_memory),
    }
