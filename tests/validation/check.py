"""A check of the simulator against a fact from outside it: data for the tests and for the document."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Check:
    """One figure held against one bound."""

    name: str
    """What was looked at, a short phrase."""
    figure: float
    """What came out."""
    bound: float
    """What it must stay below (orders: reach)."""
    unit: str = "1"
    source: str = ""
    """Where the truth comes from."""
    at_least: bool = False
    """The bound is a lower one: an order of convergence."""

    @property
    def passed(self) -> bool:
        """Whether the figure is on the right side of the bound; NaN is not."""
        return self.figure >= self.bound if self.at_least else self.figure <= self.bound

    def __str__(self) -> str:
        sign = ">=" if self.at_least else "<="
        verdict = "" if self.passed else "  FAILED"
        return f"{self.name}: {self.figure:.3g} {self.unit} ({sign} {self.bound:.3g}; {self.source}){verdict}"


@dataclass(frozen=True, kw_only=True)
class Section:
    """Checks that belong together, with what there is to know about them."""

    title: str
    text: str
    measures: tuple[Callable[[], Iterator[Check]], ...]
    slow: frozenset[str] = frozenset()
    """Names of the measures that take longer than some seconds."""
    engines: bool = True
    """Runs in every engine; False: what is looked at has none, or one only."""
    needs: str = ""
    """What must be there to run it: `data` (recorded truth) or `pinocchio`; empty: nothing."""


_ENGINE: ContextVar[str] = ContextVar("engine")


def installed_engines() -> tuple[str, ...]:
    """Engines with dynamics that are there, the default one first."""
    from asrsim.engines import ENGINES

    entries = ((name, ENGINES.get(name)) for name in ENGINES.names())
    return tuple(name for name, entry in entries if entry.available and not entry.prescribed)


def engine() -> str:
    """The engine that checks run in now."""
    return _ENGINE.get(installed_engines()[0])


@contextmanager
def on(name: str) -> Iterator[None]:
    """Checks of the block run in this engine."""
    token = _ENGINE.set(name)
    try:
        yield
    finally:
        _ENGINE.reset(token)


DATA = Path(__file__).parents[3] / "shared" / "data"
"""Recorded truth of the released toolbox and of Gazebo, beside the project; checks that need it are left out without it."""


def available(section: Section) -> bool:
    """Whether everything that the section needs is there."""
    if section.needs == "data":
        return (DATA / "ideal.npz").exists()
    if section.needs == "pinocchio":
        from importlib.util import find_spec

        return find_spec("pinocchio") is not None
    return True
