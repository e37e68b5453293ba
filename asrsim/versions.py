"""Versions of installed packages. They are read without `importlib.metadata`, whose import would slow every start."""

from __future__ import annotations

import sys
from pathlib import Path


def version(package: str) -> str:
    """Version of an installed package, found by the name of its metadata folder; empty if it is not installed."""
    module = sys.modules.get(package)
    known = getattr(module, "__version__", None)
    if isinstance(known, str):
        return known
    for place in sys.path:
        for folder in sorted(Path(place or ".").glob(f"{package}-*.dist-info")):
            return folder.name.removesuffix(".dist-info").removeprefix(f"{package}-")
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    try:
        return installed(package)
    except PackageNotFoundError:
        return ""
