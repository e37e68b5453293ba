"""Optional libraries: each belongs to an extra of asrsim; errors for a missing library contain the installation command."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from asrsim.errors import InputError


def library(name: str, extra: str) -> Any:
    """Module that an extra installs. Raises InputError with the installation command."""
    try:
        return import_module(name)
    except ImportError as error:
        # An installed but broken library raises an error with the reason.
        absent = isinstance(error, ModuleNotFoundError) and (error.name or name).split(".")[0] == name.split(".")[0]
        why = "is not installed here" if absent else f"cannot be loaded: {str(error).splitlines()[0]}"
        raise InputError(f"{name} {why}", hint=install(extra), code="no-library") from error


def install(extra: str) -> str:
    """Command that installs an extra, also in an environment without its own pip (as README creates it)."""
    where = "" if find_spec("pip") else f" --python {sys.prefix}"
    return f"pip{where} install 'asrsim[{extra}]'"
