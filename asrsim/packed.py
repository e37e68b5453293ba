"""Records in memory that compiled code takes by their address: one code for all sizes of arrays, called without a look at them.

A record is a named tuple of integers and C-contiguous arrays. In memory it is a row of words: an integer as it is, an array by
address and shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def pack(record: Any) -> NDArray[np.int64]:
    """(k,) the record's words; whoever uses their address must hold them and the record's arrays."""
    words: list[int] = []
    for value in record:
        words += [value.ctypes.data, *value.shape] if isinstance(value, np.ndarray) else [value]
    return np.array(words, dtype=np.int64)


def reader(kind: Any) -> Any:
    """A function that compiled code may call: the record of Numba's type `kind` at an address; its arrays are not counted."""
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils
    from numba.extending import intrinsic
    from numba.np import arrayobj

    helpers: Any = cgutils
    arrays: Any = arrayobj
    word = ir.IntType(64)

    def array_at(context: Any, builder: Any, layout: Any, take: Any) -> Any:
        content = context.get_data_type(layout.dtype)
        data = builder.inttoptr(take(), content.as_pointer())
        shape = [take() for _ in range(layout.ndim)]
        size = ir.Constant(word, context.get_abi_sizeof(content))
        strides = [size]
        for extent in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], extent))
        array = context.make_array(layout)(context, builder)
        shape, strides = helpers.pack_array(builder, shape), helpers.pack_array(builder, strides)
        arrays.populate_array(array, data, shape, strides, size, meminfo=None)
        return array._getvalue()

    def read_packed(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            table = builder.inttoptr(arguments[0], word.as_pointer())
            places = iter(range(1 << 16))

            def take() -> Any:
                return builder.load(builder.gep(table, [ir.Constant(word, next(places))]))

            parts = [
                array_at(context, builder, member, take) if isinstance(member, types.Array) else take()
                for member in tuple(kind)
            ]
            return context.make_tuple(builder, kind, parts)

        return kind(address), generate

    return intrinsic(read_packed)
