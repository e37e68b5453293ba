"""MuJoCo's library: its routines for plain Python and for compiled code."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

from asrsim.compiling import compile_function
from asrsim.engines import mujoco_stages as stages
from asrsim.rebind import rebind

LIBRARY = "libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"
"""File names of the library beside the package's bindings: Linux, macOS, Windows."""
INLINE = ("asrsim.engines.mujoco_stages", "asrsim.engines.exact_friction")
"""Compiled into their callers."""


def say_nothing(message: str) -> None:
    """What MuJoCo warns of shows in the motion, which is checked."""


@cache
def _library() -> Any:
    """The library that the bindings use, through ctypes."""
    import mujoco

    folder = Path(mujoco.__file__).parent
    path = next(path for pattern in LIBRARY for path in sorted(folder.glob(pattern)))
    library = ctypes.CDLL(str(path))
    kinds = {"m": ctypes.c_void_p, "i": ctypes.c_int, "d": ctypes.c_double}
    for name, arguments in stages.ROUTINES.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [kinds[kind] for kind in arguments], None
    return library


@cache
def plain_stage(function: Any) -> Any:
    """A stage that calls the library through ctypes."""
    return rebind(function, names={name: getattr(_library(), name) for name in stages.ROUTINES})


@cache
def symbols() -> dict[str, Any]:
    """The routines for code that Numba compiles: called by their names, so that kept code finds them in every process."""
    from numba import types

    kinds = {"m": types.intp, "i": types.intc, "d": types.float64}
    return {
        name: types.ExternalFunction(name, types.void(*(kinds[kind] for kind in arguments)))
        for name, arguments in stages.ROUTINES.items()
    }


@cache
def load() -> None:
    """Make the routines known to compiled code of this process."""
    from llvmlite import binding

    binding.load_library_permanently(_library()._name)


def compile_stage(function: Any, world: stages.World, version: str) -> Any:
    """A stage through Numba."""
    load()
    return compile_function(function, (world,), names=symbols(), version=version, inline=INLINE)
