"""MuJoCo's library: its routines for plain Python and for compiled code."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

from asrsim.compiling import PackedFunction, compile_packed, type_of
from asrsim.engines import mujoco_stages as stages
from asrsim.engines.mujoco_world import World
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
    # The routines take less time than giving back the interpreter's lock does.
    library = ctypes.PyDLL(str(path))
    kinds = {"m": ctypes.c_void_p, "i": ctypes.c_int, "d": ctypes.c_double}
    for name, arguments in stages.ROUTINES.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [kinds[kind] for kind in arguments], None
    return library


def stop_the_clock() -> None:
    """Its bindings time each of its routines, which takes a tenth as long as these. Their own way to ask for no clock brings
    back the one that they come with."""
    ctypes.c_void_p.in_dll(_library(), "mjcb_time").value = None


@cache
def plain_stage() -> Any:
    """:func:`asrsim.engines.mujoco_stages.stage`, which calls the library through ctypes."""
    return rebind(stages.stage, names={name: getattr(_library(), name) for name in stages.ROUTINES})


def compiled_stage(world: World, version: str) -> PackedFunction:
    """:func:`asrsim.engines.mujoco_stages.stage` through Numba: the same code for all robots."""
    return _compiled_stage(type_of(world), version)


@cache
def _compiled_stage(kind: Any, version: str) -> PackedFunction:
    from llvmlite import binding
    from numba import types

    binding.load_library_permanently(_library()._name)
    kinds = {"m": types.intp, "i": types.intc, "d": types.float64}
    names = {
        name: types.ExternalFunction(name, types.void(*(kinds[kind] for kind in arguments)))
        for name, arguments in stages.ROUTINES.items()
    }
    return compile_packed(stages.stage, kind, names=names, version=version, inline=INLINE)
