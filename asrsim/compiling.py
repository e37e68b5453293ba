"""Ordinary functions through Numba, kept in the user's cache; the only module that imports numba.

Compiled functions know each other by names that carry module, function, argument types and a number local to the process. So
code kept by two processes and loaded by a third would share names, and the first definition would serve both. Every name
here carries a digest of all code that belongs to it: what has the same name is the same.
"""

from __future__ import annotations

import hashlib
import sys
import types
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from asrsim.kernel_cache import cache_file
from asrsim.rebind import called_names, rebind

T = TypeVar("T")

LOADED = 64
"""Compiled functions of this process that are held for the next who asks."""
_loaded: OrderedDict[tuple[str, Path | None], Any] = OrderedDict()


def available() -> bool:
    """Numba is installed (the extra `fast`)."""
    from importlib.util import find_spec

    return find_spec("numba") is not None


def compile_function(
    function: Any,
    arguments: tuple[Any, ...],
    *,
    names: Mapping[str, Any] | None = None,
    version: str = "",
    inline: tuple[str, ...] = (),
) -> Callable[..., Any]:
    """`function` compiled for arguments of the types of `arguments` (examples, or types of Numba's); layouts are taken for
    granted afterwards.

    It must have no closure; what it calls may have, and is compiled with it. names: globals of the code that stand for others
    (functions of the loop, symbols of a library); version: of what they are; inline: modules whose functions become part of
    their callers (with many arguments, calls cost more than what they do). The code must not make arrays. Raises whatever
    Numba finds to say.
    """
    import numba

    signature = tuple(type_of(value) for value in arguments)

    def compiled(copy: types.FunctionType, cached: bool) -> Callable[..., Any]:
        # Threads may run worlds side by side.
        options: dict[str, Any] = {"cache": cached, "nogil": True, "_nrt": False}
        dispatcher: Any = numba.njit(signature, **options)(copy)
        entry: Callable[..., Any] = dispatcher.overloads[dispatcher.signatures[0]].entry_point

        # The machine code itself: the dispatcher would check the types at every call. It owns that code, so it is kept alive.
        def call(*values: Any) -> Any:
            return entry(*values)

        call.owner = dispatcher  # type: ignore[attr-defined]
        call.entry = entry  # type: ignore[attr-defined]
        return call

    return _through_cache(compiled, function, dict(names or {}), f"{version}\n{signature}", inline)


@dataclass(frozen=True)
class PackedFunction:
    """A compiled function of a record in memory, a state, an exchange, wrenches and a number; arrays are given by addresses."""

    address: int
    call: Callable[[int, int, int, int, float], None]
    """From Python, without the interpreter's lock."""
    owner: Any


def compile_packed(
    function: Any,
    record: Any,
    sizes: Callable[[Any], tuple[int, int, int]],
    *,
    names: Mapping[str, Any] | None = None,
    version: str = "",
    inline: tuple[str, ...] = (),
) -> PackedFunction:
    """`function(record, state, exchange, wrenches, fraction)` compiled for records of these types in memory, of any sizes; see
    :mod:`asrsim.packed` and :class:`asrsim.engines.base.Native`.

    sizes: of a record, how many numbers a state has, and how many rows the other two. Other arguments as in
    :func:`compile_function`.
    """
    import ctypes

    from asrsim.packed import reader, table_reader

    kind = type_of(record)
    given = {**(names or {}), "_unpacked": reader(kind), "_function": function, "_sizes": sizes, "_table": table_reader()}
    callback = compile_law(_at_address, given, "aaaad", version=f"{version}\n{kind}", inline=inline)
    words = ctypes.c_ssize_t
    call = ctypes.CFUNCTYPE(None, words, words, words, words, ctypes.c_double)(callback.address)
    return PackedFunction(callback.address, call, callback)


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("bound by compile_packed")


_unpacked = _function = _sizes = _table = _unbound


def _at_address(address: int, state: int, exchange: int, wrenches: int, fraction: float) -> None:
    record = _unpacked(address)
    size, joints, pushes = _sizes(record)
    _function(record, _table(state, 1, size)[0], _table(exchange, joints, 5), _table(wrenches, pushes, 6), fraction)


def compile_law(
    function: Any, names: Mapping[str, Any], kinds: str, *, version: str = "", inline: tuple[str, ...] = ()
) -> Callback:
    """`function` as a C function; names, version, inline: as in :func:`compile_function`. kinds: of its arguments, one letter
    each: `d` a number, `i` an integer, `a` an address."""
    import numba

    types_of: Any = {"d": numba.types.float64, "i": numba.types.intp, "a": numba.types.intp}

    def compiled(copy: types.FunctionType, cached: bool) -> Callback:
        signature = numba.types.void(*(types_of[kind] for kind in kinds))
        callback: Any = numba.cfunc(signature, cache=cached)(copy)
        return Callback(callback.address, callback)

    return _through_cache(compiled, function, names, f"{version}\n{kinds}", inline)


@dataclass(frozen=True)
class Callback:
    """A compiled function at an address; the owner must live."""

    address: int
    owner: Any


@cache
def numbers_reader(count: int) -> Any:
    """A function that compiled code may call: read(address) -> `count` numbers that stand there, as a tuple."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types

    def read(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            first = builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())
            places = (ir.Constant(ir.IntType(64), i) for i in range(count))
            return context.make_tuple(builder, signature.return_type, [builder.load(builder.gep(first, [at])) for at in places])

        return kinds.UniTuple(kinds.float64, count)(kinds.intp), generate

    # The name is all that the digest of code that calls it sees of it.
    read.__name__ = f"read_{count}_numbers"
    return intrinsic(read)


@cache
def row_at(integers: bool = False) -> Any:
    """A function that compiled code may call: row(address) -> the array (n,) of floats, or integers, there; of unknown
    length."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    from asrsim.packed import array_at

    kinds: Any = types
    layout = kinds.Array(kinds.int64 if integers else kinds.float64, 1, "C")

    def row(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return array_at(context, builder, layout, arguments[0], [ir.Constant(ir.IntType(64), 1 << 30)])

        return layout(kinds.intp), generate

    row.__name__ = f"row_of_{'integers' if integers else 'floats'}"
    return intrinsic(row)


@cache
def _without_algebra() -> None:
    """Load what Numba loads before its first code, but for SciPy's linear algebra.

    Numba imports that only to see whether it is there, which is half of its start and 18 MB; code that calls it later finds it.
    """
    from importlib.util import find_spec

    name = "scipy.linalg.cython_blas"
    if find_spec("scipy") is None or name in sys.modules:
        return
    stand_in = sys.modules[name] = types.ModuleType(name)
    try:
        from numba.np import arraymath  # noqa: F401
    finally:
        if sys.modules.get(name) is stand_in:
            del sys.modules[name]


def type_of(value: Any) -> Any:
    """Numba's type of an example; a type of Numba's itself."""
    import numba

    kinds: Any = numba
    return value if isinstance(value, numba.types.Type) else kinds.typeof(value)


def _through_cache(
    compiled: Callable[[types.FunctionType, bool], T],
    function: Any,
    names: Mapping[str, Any],
    version: str,
    inline: tuple[str, ...],
) -> T:
    """compiled(copy, cached) of a copy of the function that carries the digest of all its code; cached: Numba may cache it.

    This process has each only once: loading what is kept costs as much as thousands of substeps.
    """
    import numba

    _without_algebra()
    ingredients = [repr(inline), numba.__version__, sys.version, version, repr(_code(function, names, set()))]
    digest = hashlib.sha256("\n".join(ingredients).encode()).hexdigest()[:24]
    cached = cache_file(digest)
    key = digest, cached
    if key in _loaded:
        _loaded.move_to_end(key)
        return _loaded[key]  # type: ignore[no-any-return]
    try:
        made = compiled(_marked(function, names, digest, cached, inline), cached is not None)
    except Exception:
        # The cache may be damaged or not writable: compile without it.
        made = compiled(_marked(function, names, digest, None, inline), False)
    _loaded[key] = made
    if len(_loaded) > LOADED:
        _loaded.popitem(last=False)
    return made


def _marked(
    function: Any, names: Mapping[str, Any], digest: str, cached: Path | None, inline: tuple[str, ...]
) -> types.FunctionType:
    import numba

    first: list[types.FunctionType] = []

    def wrap(copy: types.FunctionType) -> Any:
        if not first:
            first.append(copy)
            return copy
        # Nobody calls it from Python, and wrappers for that would be half of the time that compiling takes.
        options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        if inline:
            # Counting references of arrays is most of what a short substep costs, and such code makes no arrays.
            options |= {"forceinline": copy.__module__ in inline, "_nrt": False}
        return numba.njit(copy, **options)

    copy: types.FunctionType = rebind(function, wrap=wrap, names=names, suffix=f"_{digest}")
    if cached is not None:
        # Numba keeps code beside the file that it believes a function to be from.
        copy.__code__ = copy.__code__.replace(co_filename=str(cached))
    return copy


def _code(function: Any, names: Mapping[str, Any], seen: set[int]) -> Any:
    """What a function does, as plain values: code, defaults, closure, and the globals that it mentions."""
    if not isinstance(function, types.FunctionType):
        return function.tobytes().hex() if hasattr(function, "tobytes") else repr(function)
    if id(function) in seen:
        return function.__qualname__
    seen.add(id(function))
    mentioned = [names.get(name, function.__globals__.get(name)) for name in called_names(function)]
    enclosed = [cell.cell_contents for cell in function.__closure__ or ()]
    inner = [_code(value, names, seen) for value in (*enclosed, *mentioned)]
    return [_plain(function.__code__), repr(function.__defaults__), inner]


def _plain(code: types.CodeType) -> Any:
    constants = [_plain(value) if isinstance(value, types.CodeType) else repr(value) for value in code.co_consts]
    return [code.co_code.hex(), constants, code.co_names, code.co_varnames, code.co_freevars]
