"""MuJoCo's C library: access to its routines from Python and from compiled code."""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from asrsim.compiled.compiling import Callback, compile_packed
from asrsim.compiled.rebind import rebind
from asrsim.engines import mujoco_step
from asrsim.engines.rigid import INLINE, skip
from asrsim.errors import Problem, SimulationError

LIBRARY = "libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"
"""File names of MuJoCo's C library in the folder of the Python package: Linux, macOS, Windows."""
PACKAGES = {"mujoco": "mujoco", "mujoco_core": "mujoco-core"}
"""Name on PyPI of each package that installs files into the folder `mujoco`, by the name of the package's metadata folder."""


def load() -> Any:
    """The module `mujoco`. Its warnings are ignored after this call. Raises SimulationError if it cannot be imported."""
    try:
        import mujoco
    except ImportError as error:
        raise SimulationError("; ".join((f"MuJoCo cannot be imported: {error}", *map(str, overlaps())))) from error
    # MuJoCo would write its warnings to a file in the working folder. They are not needed, since asrsim checks the motion
    # itself.
    mujoco.set_mju_user_warning(_ignore)
    return mujoco


def _ignore(message: str) -> None:
    pass


def library_version() -> str:
    """Version that the loaded library reports. The version in the metadata of its package may differ."""
    return str(load().mj_versionString())


@cache
def overlaps(folder: Path | None = None) -> tuple[Problem, ...]:
    """A warning if packages of different MuJoCo versions are installed in the same folder, so that one has overwritten files of
    the other.

    folder: the site-packages folder to check; None: the folder that `mujoco` is imported from.
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
    # Before version 4, the package `mujoco` contained the library. Since version 4, it depends on `mujoco-core` of the same
    # version.
    alone = "--no-deps " if found["mujoco"].startswith(("2.", "3.")) else ""
    hint = (
        "run `pip uninstall -y mujoco mujoco-core`, then `pip install mujoco-core`, or, if another package needs this version "
        f"of mujoco, `pip install {alone}mujoco=={found['mujoco']}`"
    )
    return (Problem(message, hint=hint, code="mujoco-overlap"),)


@cache
def _library() -> Any:
    """The C library that the Python bindings use, opened by ctypes."""
    files = [path for pattern in LIBRARY for path in sorted(Path(load().__file__).parent.glob(pattern))]
    # Another version of the package may have left a second library in the folder, so use the library of the loaded version.
    path = next((path for path in files if library_version() in path.name), files[0])
    # PyDLL keeps the interpreter's lock. To release the lock would take longer than the routines.
    library = ctypes.PyDLL(str(path))
    kinds = {"m": ctypes.c_void_p, "i": ctypes.c_int}
    for name, arguments in mujoco_step.ROUTINES.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [kinds[kind] for kind in arguments], None
    return library


def exact_xml(spec: Any) -> str:
    """MJCF text of an MjSpec, with 17 digits. With MuJoCo's 6 digits, rounded moments of inertia may violate A + B >= C."""
    # Versions of MuJoCo that lack this routine write 6 digits.
    set_digits = getattr(_library(), "_mjPRIVATE__set_xml_precision", lambda digits: None)
    set_digits(17)
    try:
        return str(spec.to_xml())
    finally:
        set_digits(6)


def stop_the_clock() -> None:
    """Switch off MuJoCo's timing of its own routines, which takes a tenth of their computing time. MuJoCo's Python bindings
    would switch it on again."""
    ctypes.c_void_p.in_dll(_library(), "mjcb_time").value = None


@cache
def bound(function: Any) -> Any:
    """The given function of `asrsim.engines.mujoco_step`, with the routines that it calls bound to the library through
    ctypes."""
    return rebind(function, names={name: getattr(_library(), name) for name in mujoco_step.ROUTINES})


@cache
def compiled_step(version: str, left_out: tuple[str, ...], kind: Any) -> Callback:
    """`asrsim.engines.mujoco_step.step` compiled by Numba for records of the type `kind`. left_out: names of functions that the
    robot does not need (`asrsim.engines.rigid.unused`); robots that need the same functions share the code."""
    from llvmlite import binding
    from numba import types

    binding.load_library_permanently(_library()._name)
    kinds = {"m": types.intp, "i": types.intc}
    routines = {
        name: types.ExternalFunction(name, types.void(*(kinds[kind] for kind in arguments)))
        for name, arguments in mujoco_step.ROUTINES.items()
    }
    names = {**routines, **dict.fromkeys(left_out, skip)}
    return compile_packed(mujoco_step.step, kind, mujoco_step.sizes, names=names, version=version, inline=INLINE)
