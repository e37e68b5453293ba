"""Libraries that not everybody has: each comes with an extra of asrsim, and where it is absent we say how to get it."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from asrsim.errors import InputError


def library(name: str, extra: str) -> Any:
    """A module that an extra brings. Raises InputError with how to get it."""
    try:
        return import_module(name)
    except ImportError as error:
        # A library that is there and broken gives its own reason.
        absent = isinstance(error, ModuleNotFoundError) and (error.name or name).split(".")[0] == name.split(".")[0]
        why = "is not installed here" if absent else f"cannot be loaded: {str(error).splitlines()[0]}"
        raise InputError(f"{name} {why}", hint=install(extra), code="no-library") from error


def install(extra: str) -> str:
    """The command that brings an extra, also to an environment without a pip of its own (as README makes one)."""
    where = "" if find_spec("pip") else f" --python {sys.prefix}"
    return f"pip{where} install 'asrsim[{extra}]'"
