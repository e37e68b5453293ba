"""Records in memory that compiled code receives by address, so that one compiled function serves arrays of all sizes.

A record is a named tuple of integers, C-contiguous arrays and records. In memory it is an array of words: an integer is one
word, and an array is its address followed by its shape.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray


def pack(record: Any) -> NDArray[np.int64]:
    """Words (k,) of the record. The caller must keep these words and the record's arrays alive while their address is used."""
    return np.array(_words(record), dtype=np.int64)


def _words(value: Any) -> list[int]:
    if isinstance(value, tuple):
        return [word for part in value for word in _words(part)]
    return [value.ctypes.data, *value.shape] if isinstance(value, np.ndarray) else [value]


def reader(kind: Any) -> Any:
    """A function for compiled code that returns the record of the Numba type `kind` at an address. Its arrays with one axis
    become pointers, which take fewer registers than arrays; its other arrays have no reference counts."""
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types

    def in_code(member: Any) -> Any:
        """Type of a member of the record in compiled code."""
        if isinstance(member, types.BaseTuple):
            whole: Any = member
            return kinds.NamedTuple([in_code(part) for part in whole.types], whole.instance_class)
        return kinds.CPointer(member.dtype) if isinstance(member, types.Array) and member.ndim == 1 else member

    def read_packed(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            take = _words_at(builder, arguments[0])

            def read(member: Any) -> Any:
                if isinstance(member, types.BaseTuple):
                    whole: Any = member
                    return context.make_tuple(builder, in_code(member), [read(part) for part in tuple(whole)])
                if not isinstance(member, types.Array):
                    return take()
                address, shape = take(), [take() for _ in range(member.ndim)]
                if member.ndim == 1:
                    return builder.inttoptr(address, context.get_value_type(in_code(member)))
                return array_at(context, builder, member, address, shape)

            return read(kind)

        return in_code(kind)(address), generate

    return intrinsic(read_packed)


@cache
def table_reader() -> Any:
    """A function for compiled code that returns the array (n, m, k) of floats at an address."""
    from numba import types
    from numba.extending import intrinsic

    kind: Any = types
    layout = kind.Array(kind.float64, 3, "C")

    def read_table(typing: Any, address: Any, tables: Any, rows: Any, columns: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return array_at(context, builder, layout, arguments[0], list(arguments[1:]))

        return layout(kind.intp, kind.intp, kind.intp, kind.intp), generate

    return intrinsic(read_table)


def _words_at(builder: Any, address: Any) -> Any:
    """A function that returns the next word in memory at each call; the first word is at the address."""
    from llvmlite import ir

    word = ir.IntType(64)
    table = builder.inttoptr(address, word.as_pointer())
    places = iter(range(1 << 16))
    return lambda: builder.load(builder.gep(table, [ir.Constant(word, next(places))]))


def array_at(context: Any, builder: Any, layout: Any, address: Any, shape: list[Any]) -> Any:
    """Array of compiled code with the given layout and shape at an address."""
    from llvmlite import ir
    from numba.core import cgutils
    from numba.np import arrayobj

    helpers: Any = cgutils
    arrays: Any = arrayobj
    content = context.get_data_type(layout.dtype)
    data = builder.inttoptr(address, content.as_pointer())
    size = ir.Constant(ir.IntType(64), context.get_abi_sizeof(content))
    strides = [size]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    array = context.make_array(layout)(context, builder)
    shape, strides = helpers.pack_array(builder, shape), helpers.pack_array(builder, strides)
    arrays.populate_array(array, data, shape, strides, size, meminfo=None)
    return array._getvalue()
