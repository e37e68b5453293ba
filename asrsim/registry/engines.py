"""Registry of the physics engines. The module of an engine is imported only when the engine is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from asrsim.registry import Registry


@dataclass(frozen=True, kw_only=True)
class EngineEntry:
    """A registered engine."""

    make: Callable[..., tuple[Any, tuple[Any, ...]]]
    """Function that takes a scenario and a robot, and returns an `asrsim.engines.Engine` and its warnings. The robot has the
    scenario's modes and parameters already."""
    doc: str
    module: str = ""
    """Python module that the engine needs; empty if it needs no module."""
    prescribed: bool = False
    """Whether the scenario's `motion` prescribes the motion of the links."""
    masses_of_file: bool = False
    """Whether the links have the masses of the robot's file: then asrsim checks the balance of their energy, and `--certify`
    compares the run with another engine."""
    faster: str = ""
    """Name of an engine that computes the same motion many times faster in a world without contacts; empty: there is no such
    engine.
    """

    @property
    def available(self) -> bool:
        """Whether the engine's module is installed."""
        return not self.module or find_spec(self.module) is not None


ENGINES: Registry[EngineEntry] = Registry("engine", entry_point_group="asrsim.engines", instance=EngineEntry)


def _make(name: str, scenario: Any, robot: Any) -> tuple[Any, tuple[Any, ...]]:
    """Engine and warnings by the function `make` of the engine's module, which is imported only now."""
    made: tuple[Any, tuple[Any, ...]] = import_module(f"asrsim.engines.{name}").make(scenario, robot)
    return made


ENGINES.own(
    "bullet",
    EngineEntry(
        make=partial(_make, "bullet"),
        doc="PyBullet, with contacts; the default where it is installed",
        module="pybullet",
        masses_of_file=True,
        faster="mujoco",
    ),
)
ENGINES.own(
    "mujoco",
    EngineEntry(
        make=partial(_make, "mujoco"),
        doc="MuJoCo, many times faster than PyBullet; its contacts are softer",
        module="mujoco",
        masses_of_file=True,
    ),
)
ENGINES.own(
    "bench", EngineEntry(make=partial(_make, "bench"), doc="a test bench: the links' motion is prescribed", prescribed=True)
)


def default_engine() -> str:
    """Name of the engine for a scenario without an engine: PyBullet if it is installed, else MuJoCo."""
    return "bullet" if ENGINES.get("bullet").available else "mujoco"
