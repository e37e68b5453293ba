"""Compilation of Python functions by Numba, with a cache in the user's folder; the only module that imports numba.

Numba names compiled functions by module, function, argument types and a number that is unique only within a process. Two
functions that different processes have cached could therefore have the same name in a third process, which would call the first
function in place of the second function. The names made here contain a digest of all code that the function depends on: equal
names mean equal code.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time as clock
import types
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakValueDictionary

import numpy as np

from asrsim.compiled.kernel_cache import cache_file
from asrsim.compiled.rebind import called_names, full_name, rebind

T = TypeVar("T")

LOADED = 64
"""Largest number of compiled functions that stay in the memory of this process for later calls."""
NUMERIC: dict[str, Any] = {"_nrt": False, "error_model": "numpy"}
"""Numba's options for code that creates no arrays: without reference counts of arrays, which would take most of the time of a
substep, and without tests for divisions by 0, which give inf or NaN.
"""
VECTORISED = 0
"""Numba's setting for the vectorisation of loops: off. The loops over joints and motors are short. They read numbers that the
program has just written one by one. To load such numbers as a vector, the processor would have to wait until all of them are
written.
"""
_loaded: OrderedDict[tuple[str, str], Any] = OrderedDict()
"""Functions that this process has compiled or loaded, by the digest of their code and the folder of the cache."""
_inner: WeakValueDictionary[str, Any] = WeakValueDictionary()
"""Numba's dispatchers of the functions that the compiled functions call, by full name. Compiled functions of one process share
them, so that a function is compiled once for all of its callers."""
_spent: list[float] = []
"""Durations in s of all compilations and loadings in this process."""
_types: dict[Any, Any] = {}
"""Numba types of the example values seen so far, by the value's form (see `_form`)."""


def numba_available() -> bool:
    """Whether Numba, which the extra `fast` installs, is installed."""
    from importlib.util import find_spec

    return find_spec("numba") is not None


def time_spent() -> float:
    """Time in s in which this process has compiled or loaded functions so far."""
    return sum(_spent)


def compile_function(
    function: Any,
    arguments: tuple[Any, ...],
    *,
    names: Mapping[str, Any] | None = None,
    version: str = "",
    inline: tuple[str, ...] = (),
) -> Callable[..., Any]:
    """Compiled `function` for arguments of the types of `arguments` (example values, or Numba types). The types are not checked
    when it is called.

    The function must not be a closure; functions that it calls may be closures, and are compiled too. names: global names of
    the code -> their replacements (functions, symbols of a library). version: version of the replacements. inline: modules
    whose functions are inlined into their callers, since calls with many arguments are slow; empty: all modules. The code must
    not create arrays. Raises the errors of Numba.
    """
    import numba

    signature = tuple(type_of(value) for value in arguments)

    def compiled(copy: types.FunctionType, cached: bool) -> Callable[..., Any]:
        # With nogil, the function releases the interpreter's lock, so that threads run worlds in parallel.
        dispatcher: Any = numba.njit(signature, cache=cached, nogil=True, **NUMERIC)(copy)
        entry: Callable[..., Any] = dispatcher.overloads[dispatcher.signatures[0]].entry_point

        # Call the machine code directly, since Numba's dispatcher checks types at every call. The dispatcher owns the machine
        # code and must stay alive.
        def call(*values: Any) -> Any:
            return entry(*values)

        call.owner = dispatcher  # type: ignore[attr-defined]
        return call

    return _through_cache(compiled, function, dict(names or {}), version, f"{signature}", inline)


def compile_packed(
    function: Any,
    record: Any,
    sizes: Callable[[Any], tuple[int, int, int]],
    *,
    names: Mapping[str, Any] | None = None,
    version: str = "",
    inline: tuple[str, ...] = (),
) -> Callback:
    """C function of the addresses of a record, a state, an exchange, wrenches and lengths, and the number of pieces of a kick:
    `function(record, state, exchange, wrenches, lengths)` compiled for records of this type with arrays of any size; see
    `asrsim.compiled.packed` and `asrsim.engines.base.Native`.

    sizes: function that maps a record to the number of rows of an exchange for each piece, and the numbers of rows and columns
    of the wrenches for each piece. Other arguments as in `compile_function`.
    """
    from asrsim.compiled.packed import reader, table_reader

    kind = type_of(record)
    given = {
        **(names or {}),
        "_unpacked": reader(kind),
        "_function": function,
        "_sizes": sizes,
        "_table": table_reader(),
        "_row": row_at(),
    }
    return compile_law(_at_address, given, "aaaaai", version=version, inline=inline)


def _unbound(*arguments: Any) -> Any:
    raise NotImplementedError("compile_packed replaces this function")


_unpacked = _function = _sizes = _table = _row = _unbound


def _at_address(address: int, state: int, exchange: int, wrenches: int, lengths: int, pieces: int) -> None:
    record = _unpacked(address)
    joints, rows, columns = _sizes(record)
    _function(
        record,
        _row(state),
        _table(exchange, pieces, joints, 6),
        _table(wrenches, pieces, rows, columns),
        _table(lengths, 1, 1, pieces)[0, 0],
    )


def compile_law(
    function: Any, names: Mapping[str, Any], kinds: str, *, version: str = "", inline: tuple[str, ...] = ()
) -> Callback:
    """`function` compiled to a C function. kinds: one letter for each argument: `d` a floating-point number, `i` an integer,
    `a` a memory address. names, version, inline: as in `compile_function`.
    """
    import numba

    types_of: Any = {"d": numba.types.float64, "i": numba.types.intp, "a": numba.types.intp}

    def compiled(copy: types.FunctionType, cached: bool) -> Callback:
        signature = numba.types.void(*(types_of[kind] for kind in kinds))
        # Laws of users may raise exceptions, which need Numba's usual options; `asrsim.simulation.native` then stops the world.
        options: dict[str, Any] = NUMERIC if inline else {}
        callback: Any = numba.cfunc(signature, cache=cached, **options)(copy)
        return Callback(callback.address, callback)

    return _through_cache(compiled, function, names, version, kinds, inline)


@dataclass(frozen=True)
class Callback:
    """A compiled function at an address; `owner` must be kept alive as long as the address is used."""

    address: int
    owner: Any


@cache
def numbers_reader(count: int, first: int = 0, apart: int = 1) -> Any:
    """Function for compiled code, read(row, at), that returns `count` numbers of a row as a tuple. The first number is in
    column `at + first`; the columns are `apart` from each other. row: pointer to the row.
    """
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types

    def read(typing: Any, row: Any, at: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            start = builder.gep(arguments[0], [arguments[1]])
            places = (ir.Constant(ir.IntType(64), first + apart * i) for i in range(count))
            return context.make_tuple(builder, signature.return_type, [builder.load(builder.gep(start, [at])) for at in places])

        return kinds.UniTuple(kinds.float64, count)(row, kinds.int64), generate

    read.__name__ = f"read_{count}_numbers_{first}_{apart}"
    return intrinsic(read)


@cache
def row_at(integers: bool = False) -> Any:
    """Function for compiled code, row(address), that returns the row of floats (or integers) at the address as a pointer.
    Indices of this pointer must not be negative, and are not checked.
    """
    from numba import types
    from numba.extending import intrinsic

    kinds: Any = types
    pointer = kinds.CPointer(kinds.int64 if integers else kinds.float64)

    def row(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(pointer))

        return pointer(kinds.intp), generate

    row.__name__ = f"pointer_to_{'integers' if integers else 'floats'}"
    return intrinsic(row)


@cache
def _without_algebra() -> None:
    """Import the modules that Numba needs before its first compilation, except SciPy's linear algebra.

    Numba imports `scipy.linalg` only to test whether it exists, which takes half of the import time and 18 MB. Code that uses
    it can still import it later.
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
    """Numba type of an example value; a Numba type is returned unchanged."""
    import numba

    if isinstance(value, numba.types.Type):
        return value
    # Store the types, since Numba takes a millisecond to find the type of an engine's record.
    form = _form(value)
    if form not in _types:
        kinds: Any = numba
        _types[form] = kinds.typeof(value)
    return _types[form]


def _form(value: Any) -> Any:
    """Key that determines the Numba type of a value. It is the type of a number or an array, the keys of the members of a
    tuple, or else the value itself."""
    if isinstance(value, tuple):
        return type(value), *map(_form, value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.num
    return type(value) if isinstance(value, int | float) else value


def _through_cache(
    compiled: Callable[[types.FunctionType, bool], T],
    function: Any,
    names: Mapping[str, Any],
    version: str,
    signature: str,
    inline: tuple[str, ...],
) -> T:
    """Result of compiled(copy, cached) for a copy of the function whose name contains the digest of all its code. cached:
    whether Numba may store the compiled copy in the cache. signature: types of the function's arguments.

    The process compiles or loads each function only once, since loading takes as long as thousands of substeps.
    """
    from numba.core import config

    settings: Any = config
    _without_algebra()
    digest = _digest(function, names, version, inline, signature)
    key = digest, os.environ.get("XDG_CACHE_HOME", "")
    if key in _loaded:
        _loaded.move_to_end(key)
        return _loaded[key]  # type: ignore[no-any-return]
    cached, began = cache_file(digest), clock.perf_counter()
    usual, settings.LOOP_VECTORIZE = settings.LOOP_VECTORIZE, VECTORISED
    try:
        made = compiled(_marked(function, names, version, digest, cached, inline), cached is not None)
    except Exception:
        # The files in the cache may be damaged or read-only, so compile again without the cache.
        made = compiled(_marked(function, names, version, digest, None, inline), False)
    finally:
        settings.LOOP_VECTORIZE = usual
        _spent.append(clock.perf_counter() - began)
    _loaded[key] = made
    if len(_loaded) > LOADED:
        _loaded.popitem(last=False)
    return made


def _digest(function: Any, names: Mapping[str, Any], version: str, inline: tuple[str, ...], signature: str = "") -> str:
    """Digest of all that the machine code of a function depends on. signature: types of the function's arguments; empty: Numba
    compiles the function for each caller's types."""
    import numba

    code = repr(_code(function, names, version, set()))
    ingredients = [repr((inline, NUMERIC, VECTORISED)), numba.__version__, sys.version, signature, code]
    return hashlib.sha256("\n".join(ingredients).encode()).hexdigest()[:24]


def _marked(
    function: Any, names: Mapping[str, Any], version: str, digest: str, cached: Path | None, inline: tuple[str, ...]
) -> types.FunctionType:
    """Copy of the function that calls dispatchers of Numba. The name of each copy contains a digest of its code.

    digest: digest for the name of the function itself. cached: file beside which Numba stores the compiled code; None: the code
    is not stored. Other arguments as in `_through_cache`.
    """
    import numba

    first: list[types.FunctionType] = []

    def wrap(copy: types.FunctionType) -> Any:
        if not first:
            first.append(copy)
            return copy
        # Make no wrappers for Python, since Python never calls these inner functions. The wrappers would take half of the
        # compilation time.
        options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        options["forceinline"] = not inline or copy.__module__ in inline
        made = _inner[full_name(copy)] = numba.njit(copy, **options, **(NUMERIC if inline else {}))
        return made

    def suffix(one: types.FunctionType) -> str:
        return f"_{digest if one is function else _digest(one, names, version, inline)}"

    copy: types.FunctionType = rebind(function, wrap=wrap, names=names, suffix=suffix, ready=_inner)
    if cached is not None:
        # Numba stores compiled code in the folder of a function's source file, so pretend that the source is a file in our
        # cache.
        copy.__code__ = copy.__code__.replace(co_filename=str(cached))
    return copy


def _code(function: Any, names: Mapping[str, Any], version: str, seen: set[int]) -> Any:
    """Plain values from which the digest of a function is computed: its code, defaults, closure, and the globals that it uses,
    with the version of the replacements if it uses one."""
    # Look inside wrappers. An intrinsic of Numba wraps the generator of its machine code, a dispatcher wraps its source, and a
    # cached function wraps the plain function.
    for wrapped in ("_defn", "py_func", "__wrapped__"):
        function = getattr(function, wrapped, function)
    if not isinstance(function, types.FunctionType):
        return function.tobytes().hex() if hasattr(function, "tobytes") else repr(function)
    if id(function) in seen:
        return function.__qualname__
    seen.add(id(function))
    called = called_names(function)
    mentioned = [names.get(name, function.__globals__.get(name)) for name in called]
    enclosed = [cell.cell_contents for cell in function.__closure__ or ()]
    inner = [_code(value, names, version, seen) for value in (*enclosed, *mentioned)]
    given = version if any(name in names for name in called) else ""
    return [_plain(function.__code__), repr(function.__defaults__), given, inner]


def _plain(code: types.CodeType) -> Any:
    constants = [_plain(value) if isinstance(value, types.CodeType) else repr(value) for value in code.co_consts]
    return [code.co_code.hex(), constants, code.co_names, code.co_varnames, code.co_freevars]
