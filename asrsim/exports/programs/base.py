"""Interface of the programs for which an exported file can be made."""

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
    """A program that reads MJCF. The class states what a file for the program may contain, and how the program replays a
    motion. A subclass must state `name` and `title`."""

    name: ClassVar[str]
    """Name on the command line."""
    title: ClassVar[str]
    """Name for people, in messages and pages."""
    packages: ClassVar[tuple[str, ...]] = ()
    """Names of the program's packages on PyPI; the modules have these names with `_` instead of `-`."""
    modules: ClassVar[tuple[str, ...]] = ()
    """Python modules that a replay in this program needs."""
    constructs: ClassVar[Constructs] = Constructs()
    """Constructs of MJCF that the program simulates correctly."""
    longest: ClassVar[int] = 10**9
    """Largest number of time steps of a replay, since programs for thousands of robots are slow with one robot."""

    def missing(self) -> str:
        """Reason why the program cannot replay a motion on this computer; empty if a replay is possible."""
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
        """Names and versions of the program's installed packages."""
        return ", ".join(_versions(self.packages))

    def positions(self, path: Path, model: Any, start: Any, controls: Array, torques: Array) -> Array:
        """Positions (n, nq) at the time steps of the model at `path`, driven by controls (n, nu) and joint torques (n, nv).

        model, start: the same model and its initial state, as MjModel and MjData. Rows after a divergence are NaN. If a program
        does not have this method, the scenario is replayed in MuJoCo.
        """
        raise NotImplementedError

    def write(self, path: Path, prepared: Prepared, timestep: float, ranges: Path | None, remarks: list[str]) -> list[Path]:
        """Write the files that the program needs in addition to the model at `path`, and return their paths. timestep: time
        step of the model, s; ranges: file of the ranges of a fit, if there is one; remarks: sentences about parts of the
        scenario that the model lacks (`Not in the file`), to which the method may add.
        """
        return []


def _versions(packages: tuple[str, ...]) -> Iterator[str]:
    for package in packages:
        try:
            yield f"{package} {version(package)}"
        except PackageNotFoundError:
            continue
