"""A check of the simulator against an external fact: data for the tests and for the document."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Check:
    """A measured figure and its bound."""

    name: str
    """A short phrase; checks with the same text before the first comma or colon share a row of the document."""
    figure: float
    """Measured value."""
    bound: float
    """Largest allowed figure, or smallest if `at_least`."""
    unit: str = "1"
    source: str = ""
    """Source of the true value."""
    at_least: bool = False
    """Whether the bound is a lower bound, as for an order of convergence."""

    @property
    def passed(self) -> bool:
        """Whether the figure is within its bound; NaN is not."""
        return self.figure >= self.bound if self.at_least else self.figure <= self.bound

    def __str__(self) -> str:
        sign = ">=" if self.at_least else "<="
        verdict = "" if self.passed else "  FAILED"
        return f"{self.name}: {self.figure:.3g} {self.unit} ({sign} {self.bound:.3g}; {self.source}){verdict}"


@dataclass(frozen=True, kw_only=True)
class Section:
    """Group of related checks with an explanation."""

    title: str
    text: str
    measures: tuple[Callable[[], Iterator[Check]], ...]
    slow: frozenset[str] = frozenset()
    """Names of the functions that take longer than a few seconds."""
    engines: bool = True
    """Whether the checks run in every engine."""
    solvers: bool = False
    """Whether each engine computes the motion with a contact solver of its own, so that the engines differ."""
    needs: str = ""
    """Requirement: `data` (recorded truth) or `pinocchio`; empty: none."""


_ENGINE: ContextVar[str] = ContextVar("engine")


def installed_engines() -> tuple[str, ...]:
    """Installed engines with dynamics; the default engine is first."""
    from asrsim.engines import ENGINES

    entries = ((name, ENGINES.get(name)) for name in ENGINES.names())
    return tuple(name for name, entry in entries if entry.available and not entry.prescribed)


def engine() -> str:
    """Name of the engine in which checks currently run."""
    return _ENGINE.get(installed_engines()[0])


@contextmanager
def on(name: str) -> Iterator[None]:
    """Run the checks of the `with` block in this engine."""
    token = _ENGINE.set(name)
    try:
        yield
    finally:
        _ENGINE.reset(token)


DATA = Path(__file__).parents[3] / "shared" / "data"
"""Recorded outputs of the released toolbox and of Gazebo; checks that need them are skipped where the folder is missing."""


def available(section: Section) -> bool:
    """Whether the requirement of the section is met."""
    if section.needs == "data":
        return (DATA / "ideal.npz").exists()
    if section.needs == "pinocchio":
        from importlib.util import find_spec

        return find_spec("pinocchio") is not None
    return True
