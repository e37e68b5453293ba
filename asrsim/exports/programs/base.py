"""Interface of the programs that an exported file can be made for."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from asrsim.exports.constructs import Constructs
from asrsim.samples import Array
from asrsim.simulation.prepared import Prepared


class Program:
    """A program that reads MJCF: what a file for it may contain, and how it replays a motion. Only the names are required."""

    name: ClassVar[str]
    """Name on the command line."""
    title: ClassVar[str]
    """Name in texts."""
    packages: ClassVar[tuple[str, ...]] = ()
    """Names of the program's packages on PyPI; the modules have these names with `_` instead of `-`."""
    modules: ClassVar[tuple[str, ...]] = ()
    """Modules that the program needs here."""
    constructs: ClassVar[Constructs] = Constructs()
    """Constructs of MJCF that the program simulates correctly."""
    longest: ClassVar[int] = 10**9
    """Largest number of time steps of a replay: programs for thousands of robots are slow with a single robot."""

    def missing(self) -> str:
        """Reason why the program cannot be tried here; empty if it can."""
        if type(self).positions is Program.positions:
            return f"asrsim has no replay in {self.title}"
        for module in self.modules:
            try:
                if find_spec(module) is None:
                    return f"{module} is not installed here"
            except ModuleNotFoundError:
                return f"{module.partition('.')[0]} is not installed here"
        return ""

    def version(self) -> str:
        """Names and versions of the installed packages."""
        return ", ".join(_versions(self.packages))

    def positions(self, path: Path, model: Any, start: Any, controls: Array, torques: Array) -> Array:
        """Positions (n, nq) of the model at `path`, at its time steps, with controls (n, nu) and torques on joints (n, nv).

        model, start: the model and its start as MjModel and MjData. Rows after a divergence are NaN. A program without this
        method is not tried: the scenario is replayed in MuJoCo.
        """
        raise NotImplementedError

    def write(self, path: Path, prepared: Prepared, timestep: float, ranges: Path | None) -> list[Path]:
        """Write the further files that the program needs beside the model at `path`, and return their paths. timestep: of the
        model, s; ranges: file of the ranges of a fit.
        """
        return []


def _versions(packages: tuple[str, ...]) -> Iterator[str]:
    for package in packages:
        try:
            yield f"{package} {version(package)}"
        except PackageNotFoundError:
            continue
