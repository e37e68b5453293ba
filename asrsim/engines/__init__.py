"""Physics engines: they move the links under joint torques. Springs and motors are computed outside of the engines."""

from __future__ import annotations

from asrsim.engines.base import Engine
from asrsim.registry.engines import ENGINES, EngineEntry, default_engine

__all__ = ["ENGINES", "Engine", "EngineEntry", "default_engine"]
