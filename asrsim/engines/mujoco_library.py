"""MuJoCo's library: its routines for plain Python and for compiled code."""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from asrsim.compiling import PackedFunction, compile_packed
from asrsim.engines import mujoco_step
from asrsim.engines.rigid import INLINE
from asrsim.errors import Problem, SimulationError
from asrsim.rebind import rebind

LIBRARY = "libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"
"""File names of the library beside the package's bindings: Linux, macOS, Windows."""
PACKAGES = {"mujoco": "mujoco", "mujoco_core": "mujoco-core"}
"""Packages that install into the folder `mujoco`: the name in their folders of metadata, the name for pip."""


def load() -> Any:
    """The module `mujoco`; raises SimulationError if it cannot be imported."""
    try:
        import mujoco
    except ImportError as error:
        raise SimulationError("; ".join((f"MuJoCo cannot be imported: {error}", *map(str, overlaps())))) from error
    return mujoco


def library_version() -> str:
    """Version of the library that is loaded, as the library itself gives it; metadata of packages may name another."""
    return str(load().mj_versionString())


@cache
def overlaps(folder: Path | None = None) -> tuple[Problem, ...]:
    """A warning if packages of different MuJoCo versions are installed in one folder, where each overwrites files of the other.

    folder: site-packages to look into; None: the one that `mujoco` is imported from.
    """
    if folder is None:
        spec = find_spec("mujoco")
        if spec is None or spec.origin is None:
            return ()
        folder = Path(spec.origin).parents[1]
    found = {
        name: place.name.removeprefix(f"{stem}-").removesuffix(".dist-info")
        for stem, name in PACKAGES.items()
        for place in folder.glob(f"{stem}-*.dist-info")
    }
    if len(set(found.values())) < 2:
        return ()
    message = f"{' and '.join(' '.join(one) for one in found.items())} overwrite each other's files in {folder / 'mujoco'}"
    # Before 4, `mujoco` held the library itself; since then it depends on `mujoco-core` of its own version.
    alone = "--no-deps " if found["mujoco"].startswith(("2.", "3.")) else ""
    hint = (
        "run `pip uninstall -y mujoco mujoco-core`, then `pip install mujoco-core`, or, if another package needs this version "
        f"of mujoco, `pip install {alone}mujoco=={found['mujoco']}`"
    )
    return (Problem(message, hint=hint, code="mujoco-overlap"),)


def say_nothing(message: str) -> None:
    """Ignore MuJoCo's warnings: asrsim checks the motion itself."""


@cache
def _library() -> Any:
    """The library that the bindings use, through ctypes."""
    files = [path for pattern in LIBRARY for path in sorted(Path(load().__file__).parent.glob(pattern))]
    # A second library may be left over from another version of the package.
    path = next((path for path in files if library_version() in path.name), files[0])
    # The routines take less time than giving back the interpreter's lock does.
    library = ctypes.PyDLL(str(path))
    kinds = {"m": ctypes.c_void_p, "i": ctypes.c_int}
    for name, arguments in mujoco_step.ROUTINES.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [kinds[kind] for kind in arguments], None
    return library


def stop_the_clock() -> None:
    """Switch off the clock of MuJoCo's bindings, which costs a tenth of each routine. Their own switch would restore it."""
    ctypes.c_void_p.in_dll(_library(), "mjcb_time").value = None


@cache
def bound(function: Any) -> Any:
    """A function of :mod:`asrsim.engines.mujoco_step` that calls the library through ctypes."""
    return rebind(function, names={name: getattr(_library(), name) for name in mujoco_step.ROUTINES})


@cache
def compiled_step(kind: Any, version: str) -> PackedFunction:
    """:func:`asrsim.engines.mujoco_step.step` through Numba, for records of this type: the same code for all robots."""
    from llvmlite import binding
    from numba import types

    binding.load_library_permanently(_library()._name)
    kinds = {"m": types.intp, "i": types.intc}
    names = {
        name: types.ExternalFunction(name, types.void(*(kinds[kind] for kind in arguments)))
        for name, arguments in mujoco_step.ROUTINES.items()
    }
    return compile_packed(mujoco_step.step, kind, mujoco_step.sizes, names=names, version=version, inline=INLINE)
