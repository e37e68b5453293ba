"""The kernel and the laws as machine code. Compiled once for all robots: laws and engine are called by their addresses."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from asrsim import compiling
from asrsim.actuators.vectorised import energy_law
from asrsim.simulation import kernel
from asrsim.simulation.laws import MOTOR_NUMBERS
from asrsim.simulation.layout import STIFFNESS

INLINE = ("asrsim.actuators.motor", "asrsim.actuators.hysteresis", "asrsim.simulation.joint", "asrsim.simulation.ledger")
"""Modules whose functions become part of their callers."""


def compiled_run() -> Any:
    """:func:`asrsim.simulation.kernel.run` for arrays."""
    whole = {n: np.zeros((1,) * n, dtype=np.int64) for n in (1, 2, 3)}
    floats = {n: np.zeros((1,) * n) for n in (1, 2, 3, 4)}
    example = (
        whole[2], 1, 1, 1, whole[1], whole[2], floats[3], floats[3], whole[2], floats[1], floats[2], floats[4],
        floats[4], whole[3], floats[1], np.zeros(1, dtype=bool), floats[3], floats[2], 1, 1, whole[1], floats[4],
    )  # fmt: skip
    return compiling.compile_function(kernel.run, example, names=_pointers(), inline=INLINE)


def compiled_law(actuator: Any, motors: int) -> compiling.Callback:
    """An actuator's laws; see :func:`asrsim.simulation.laws.plain_law`."""
    names = {
        "torques": actuator.elastic_torques, "stiffness": actuator.stiffness, "energy": energy_law(actuator),
        "positions": compiling.numbers_reader(motors), "parameters": compiling.numbers_reader(len(actuator.parameters)),
        "row": compiling.row_at(),
    }  # fmt: skip
    return compiling.compile_law(_laws, names, "daaaa")


# What may raise is called, since Numba takes no arguments with a star inside of `try`. A law may be any code; where it has no
# value the world stops, and the run names the joint.
def _laws(q: float, thetas: int, law: int, result: int, state: int) -> None:
    found, whole = row(result), row(state)
    try:
        if state == 0:
            _put_torques(q, thetas, law, found)
        else:
            _put_all(q, thetas, law, found, whole)
    except Exception:
        found[0] = np.nan


def _put_torques(q: float, thetas: int, law: int, found: Any) -> None:
    values = torques(q, *positions(thetas), parameters(law))
    for i in range(len(values)):
        found[i] = values[i]


def _put_all(q: float, thetas: int, law: int, found: Any, whole: Any) -> None:
    # Nothing is written before all is known, so that the compiler finds what the three laws have in common.
    values = torques(q, *positions(thetas), parameters(law))
    known = stiffness(q, *positions(thetas), parameters(law)), energy(q, *positions(thetas), parameters(law))
    for i in range(len(values)):
        found[i] = values[i]
    whole[0], whole[1] = known


def compiled_joint_step(function: Any) -> compiling.Callback:
    """A stepping's own step of a joint; see :func:`asrsim.simulation.laws.joint_step`."""
    names = {**_pointers(), "own_step": function, "row": compiling.row_at(), "whole_row": compiling.row_at(True)}
    return compiling.compile_law(_joint_step, names, "aaaadi")


def _joint_step(s: int, p: int, k: int, u: int, h: float, note: int) -> None:
    own_step(row(s), row(p), whole_row(k), row(u), h, note)


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("bound where it is compiled")


torques = stiffness = energy = positions = parameters = row = whole_row = own_step = _unbound


@cache
def _pointers() -> dict[str, Any]:
    """What the names of :mod:`asrsim.simulation.laws` are in compiled code: calls through pointers."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types
    double, word, void = ir.DoubleType(), ir.IntType(64), ir.VoidType()
    doubles, words = double.as_pointer(), word.as_pointer()

    def data(context: Any, builder: Any, kind: Any, value: Any, offset: Any = None) -> Any:
        pointer = context.make_array(kind)(context, builder, value).data
        return pointer if offset is None else builder.gep(pointer, [offset])

    def call(builder: Any, address: Any, given: list[Any], arguments: list[Any]) -> None:
        builder.call(builder.inttoptr(address, ir.FunctionType(void, given).as_pointer()), arguments)

    def call_law(typing: Any, address: Any, q: Any, s: Any, thetas: Any, p: Any, law: Any, result: Any, whole: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            address, q, s, thetas, p, law, result, whole = arguments
            of_s, of_p = signature.args[2], signature.args[4]
            state = ir.Constant(word, STIFFNESS)
            taken = (of_s, s, thetas), (of_p, p, law), (of_s, s, result), (of_s, s, state)
            places = [data(context, builder, kind, row, at) for kind, row, at in taken]
            places[3] = builder.select(whole, places[3], ir.Constant(doubles, None))
            call(builder, address, [double, *[doubles] * 4], [q, *places])
            return context.get_dummy_value()

        at = kinds.int64
        return kinds.void(at, kinds.float64, s, at, p, at, at, kinds.boolean), generate

    def call_engine(typing: Any, address: Any, record: Any, x: Any, exchange: Any, wrenches: Any, fraction: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, record, *arrays, fraction = arguments
            places = [data(context, builder, kind, array) for kind, array in zip(signature.args[2:5], arrays, strict=True)]
            call(builder, at, [word, doubles, doubles, doubles, double], [record, *places, fraction])
            return context.get_dummy_value()

        return kinds.void(kinds.int64, kinds.int64, x, exchange, wrenches, kinds.float64), generate

    def call_step(typing: Any, address: Any, s: Any, p: Any, k: Any, u: Any, h: Any, note: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, *rows, h, note = arguments
            places = [data(context, builder, kind, row) for kind, row in zip(signature.args[1:5], rows, strict=True)]
            call(builder, at, [doubles, doubles, words, doubles, double, word], [*places, h, note])
            return context.get_dummy_value()

        return kinds.void(kinds.int64, s, p, k, u, kinds.float64, kinds.int64), generate

    def read_numbers(typing: Any, p: Any, at: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            first = data(context, builder, signature.args[0], arguments[0], arguments[1])
            values = [builder.load(builder.gep(first, [ir.Constant(word, i)])) for i in range(MOTOR_NUMBERS)]
            return context.make_tuple(builder, signature.return_type, values)

        return kinds.UniTuple(kinds.float64, MOTOR_NUMBERS)(p, kinds.int64), generate

    return {
        "spring_law": intrinsic(call_law), "engine_step": intrinsic(call_engine),
        "joint_step": intrinsic(call_step), "numbers": intrinsic(read_numbers),
    }  # fmt: skip
