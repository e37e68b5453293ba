"""Optional libraries. Each belongs to an extra of asrsim; the error for a missing library states how to install this extra."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from asrsim.errors import InputError


def library(name: str, extra: str) -> Any:
    """The module `name`, which an extra installs. If it is missing, raises InputError with the command that installs the
    extra."""
    try:
        return import_module(name)
    except ImportError as error:
        # The error of a library that is installed but broken states another reason.
        absent = isinstance(error, ModuleNotFoundError) and (error.name or name).split(".")[0] == name.split(".")[0]
        why = "is not installed here" if absent else f"cannot be loaded: {str(error).splitlines()[0]}"
        raise InputError(f"{name} {why}", hint=install(extra), code="no-library") from error


def install(extra: str) -> str:
    """Command that installs an extra, also into an environment without its own pip, as README creates it."""
    where = "" if find_spec("pip") else f" --python {sys.prefix}"
    return f"pip{where} install 'asrsim[{extra}]'"
