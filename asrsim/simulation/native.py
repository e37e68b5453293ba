"""The kernel and the laws as machine code. Compiled once for all robots: laws and engine are called by their addresses."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from asrsim import compiling
from asrsim.actuators.base import Actuator
from asrsim.simulation import kernel
from asrsim.simulation.laws import energy_law

INLINE = (
    "asrsim.simulation.kernel", "asrsim.simulation.joint", "asrsim.simulation.ledger", "asrsim.actuators.motor",
    "asrsim.actuators.hysteresis",
)  # fmt: skip
"""Modules whose functions become part of their callers."""


@cache
def compiled_run() -> Any:
    """:func:`asrsim.simulation.kernel.run` for arrays."""
    table, rows, cube = np.zeros((1, 1)), np.zeros((1, 1, 1)), np.zeros((1, 1, 1, 1))
    whole = np.zeros(1, dtype=np.int64)
    example = (
        whole, 1, 1, 1, whole, np.zeros((1, 2), dtype=np.int64), rows, rows, np.zeros((1, 1), dtype=np.int64), np.zeros(1),
        table, cube[:, ::1], cube, np.zeros((1, 1, 3), dtype=np.int64), np.zeros(1), np.zeros(1, dtype=bool), rows, table, 1, 1,
        whole, cube,
    )  # fmt: skip
    return compiling.compile_function(kernel.run, example, names=_pointers(), inline=INLINE)


@cache
def compiled_laws(actuator: type[Actuator], motors: int) -> tuple[int, int]:
    """Addresses of an actuator's torques, and of its stiffness and energy; see :func:`asrsim.simulation.laws.plain_laws`."""
    names = {
        "torques": actuator.elastic_torques, "stiffness": actuator.stiffness, "energy": energy_law(actuator),
        "positions": compiling.pointer_reader(motors), "parameters": compiling.pointer_reader(len(actuator.parameters)),
        "store": compiling.pointer_writer(),
    }  # fmt: skip
    return compiling.compile_law(_torques, names), compiling.compile_law(_state, names)


def _torques(q: float, thetas: Any, law: Any, result: Any) -> None:
    try:
        store(result, torques(q, *positions(thetas), parameters(law)))
    except Exception:  # noqa: BLE001  (a law may be any code; what has no value stops the world, which names it)
        store(result, (np.nan,))


def _state(q: float, thetas: Any, law: Any, result: Any) -> None:
    try:
        store(result, (stiffness(q, *positions(thetas), parameters(law)), energy(q, *positions(thetas), parameters(law))))
    except Exception:  # noqa: BLE001
        store(result, (np.nan, np.nan))


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("bound by compiled_laws")


torques = stiffness = energy = positions = parameters = store = _unbound


@cache
def _pointers() -> dict[str, Any]:
    """What the names of :mod:`asrsim.simulation.laws` are in compiled code: calls through pointers."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    double, word = ir.DoubleType(), ir.IntType(64)
    void = ir.VoidType()

    def data(context: Any, builder: Any, kind: Any, value: Any, offset: Any = None) -> Any:
        pointer = context.make_array(kind)(context, builder, value).data
        return builder.gep(pointer, [offset]) if offset is not None else pointer

    def law(typing: Any, address: Any, q: Any, s: Any, thetas: Any, p: Any, law: Any, result: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, q, s, thetas, p, law, result = arguments
            kinds = signature.args
            shape = ir.FunctionType(void, [double, double.as_pointer(), double.as_pointer(), double.as_pointer()])
            function = builder.inttoptr(at, shape.as_pointer())
            own, law_at = data(context, builder, kinds[2], s, thetas), data(context, builder, kinds[4], p, law)
            builder.call(function, [q, own, law_at, data(context, builder, kinds[2], s, result)])
            return context.get_dummy_value()

        return types.void(types.int64, types.float64, s, types.int64, p, types.int64, types.int64), generate

    def engine(typing: Any, address: Any, record: Any, x: Any, exchange: Any, wrenches: Any, fraction: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, record, x, exchange, wrenches, fraction = arguments
            kinds = signature.args
            pointer = double.as_pointer()
            shape = ir.FunctionType(void, [word, pointer, pointer, pointer, double])
            places = [data(context, builder, kinds[i], value) for i, value in ((2, x), (3, exchange), (4, wrenches))]
            builder.call(builder.inttoptr(at, shape.as_pointer()), [record, *places, fraction])
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, x, exchange, wrenches, types.float64), generate

    def step(typing: Any, address: Any, s: Any, p: Any, k: Any, u: Any, h: Any, note: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, s, p, k, u, h, note = arguments
            kinds = signature.args
            pointer, words = double.as_pointer(), word.as_pointer()
            shape = ir.FunctionType(void, [pointer, pointer, words, pointer, double, word])
            rows = [data(context, builder, kinds[i], value) for i, value in ((1, s), (2, p), (3, k), (4, u))]
            builder.call(builder.inttoptr(at, shape.as_pointer()), [*rows, h, note])
            return context.get_dummy_value()

        return types.void(types.int64, s, p, k, u, types.float64, types.int64), generate

    def read(typing: Any, p: Any, at: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            first = data(context, builder, signature.args[0], arguments[0], arguments[1])
            values = [builder.load(builder.gep(first, [ir.Constant(word, i)])) for i in range(16)]
            return context.make_tuple(builder, signature.return_type, values)

        return types.UniTuple(types.float64, 16)(p, types.int64), generate

    return {
        "spring_law": intrinsic(law), "state_law": intrinsic(law), "engine_step": intrinsic(engine), "joint_step": intrinsic(step),
        "numbers": intrinsic(read),
    }  # fmt: skip
