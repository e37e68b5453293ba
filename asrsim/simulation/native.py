"""Compilation of kernel and laws. One compiled kernel serves all robots, since it calls laws and engine by address."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from asrsim import compiling
from asrsim.actuators.vectorised import energy_law
from asrsim.errors import SimulationError
from asrsim.simulation import kernel
from asrsim.simulation.laws import MOTOR_NUMBERS
from asrsim.simulation.layout import LAW_ENERGY, STIFFNESS

INLINE = "asrsim.actuators.motor", "asrsim.actuators.hysteresis", "asrsim.simulation.kernel"
"""Modules whose functions are inlined into their callers."""


def compiled_run() -> Any:
    """`asrsim.simulation.kernel.run`, compiled for arrays."""
    whole = {n: np.zeros((1,) * n, dtype=np.int64) for n in (1, 2, 3)}
    floats = {n: np.zeros((1,) * n) for n in (1, 2, 3, 4)}
    example = (
        whole[2], 1, 1, 1, 1, whole[1], whole[2], floats[3], floats[3], whole[2], floats[1], floats[2], floats[4],
        floats[4], floats[4], floats[2], whole[3], floats[3], 1, 1, whole[1], whole[1], floats[4], floats[3],
        floats[4], floats[1], whole[2],
    )  # fmt: skip
    return compiling.compile_function(kernel.run, example, names=_pointers(), inline=INLINE)


def bound_law(actuator: Any, motors: int) -> compiling.Callback:
    """An actuator's laws, compiled to a C function; see `asrsim.simulation.laws.bound_law`. Raises SimulationError."""
    names = {
        "torques": actuator.elastic_torques, "stiffness": actuator.stiffness, "energy": energy_law(actuator),
        "positions": compiling.numbers_reader(motors), "parameters": compiling.numbers_reader(len(actuator.parameters)),
        "row": compiling.row_at(),
    }  # fmt: skip
    try:
        return compiling.compile_law(_laws, names, "aiiaidi")
    except Exception as error:
        reason = str(error).strip().splitlines()[0]
        raise SimulationError(f"Numba cannot compile the laws of '{actuator.name}': {reason}") from error


# Code that may raise is in a separate function, since Numba does not support starred arguments inside `try`. If a law raises,
# the world stops and the error names the joint.
def _laws(s: int, thetas: int, result: int, p: int, law: int, q: float, whole: int) -> None:
    try:
        _put_laws(row(s), thetas, result, row(p), law, q, whole)
    except Exception:
        row(s)[result] = np.nan


def _put_laws(s: Any, thetas: int, result: int, p: Any, law: int, q: float, whole: int) -> None:
    # All laws are evaluated before anything is written, so that the compiler can share their common subexpressions.
    given = q, *positions(s, thetas), parameters(p, law)
    values = torques(*given)
    known = 0.0, 0.0
    if whole != 0:
        known = stiffness(*given), energy(*given)
    for i in range(len(values)):
        s[result + i] = values[i]
    if whole != 0:
        s[STIFFNESS], s[LAW_ENERGY] = known


def bound_step(function: Any) -> compiling.Callback:
    """The function by which a stepping advances a joint, compiled; see `asrsim.simulation.laws.joint_step`."""
    names = {**_pointers(), "own_step": function, "row": compiling.row_at(), "whole_row": compiling.row_at(True)}
    return compiling.compile_law(_joint_step, names, "aaaadi")


def _joint_step(s: int, p: int, k: int, u: int, h: float, note: int) -> None:
    own_step(row(s), row(p), whole_row(k), row(u), h, note)


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("the compiler replaces this function")


torques = stiffness = energy = positions = parameters = row = whole_row = own_step = _unbound


@cache
def _pointers() -> dict[str, Any]:
    """Replacements in compiled code for the functions of `asrsim.simulation.laws`, by name. Each replacement calls through a
    pointer."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types

    def passed(*given: Any) -> Any:
        """Numba signature and code generator of a call of the C function whose address is the first argument. Arrays are passed
        as addresses of their data."""
        signature = kinds.void(*given)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            at, *values = [
                context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
                for kind, value in zip(signature.args, arguments, strict=True)
            ]
            # The loops over motors and columns are short: unrolled versions of them would cost 5 % of the time.
            builder.function.attributes.add("optsize")
            function = ir.FunctionType(ir.VoidType(), [value.type for value in values])
            builder.call(builder.inttoptr(at, function.as_pointer()), values)
            return context.get_dummy_value()

        return signature, generate

    def call_law(typing: Any, address: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any) -> Any:
        return passed(address, a, b, c, d, e, f, g)

    def call_step(typing: Any, address: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any) -> Any:
        return passed(address, a, b, c, d, e, f)

    def find_row(typing: Any, table: Any, j: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            whole = context.make_array(signature.args[0])(context, builder, arguments[0])
            columns = builder.extract_value(whole.shape, 1)
            return builder.gep(whole.data, [builder.mul(arguments[1], columns)])

        return kinds.CPointer(table.dtype)(table, kinds.int64), generate

    return {
        "spring_law": intrinsic(call_law), "engine_step": intrinsic(call_step), "joint_step": intrinsic(call_step),
        "numbers": compiling.numbers_reader(MOTOR_NUMBERS), "row": intrinsic(find_row),
    }  # fmt: skip
