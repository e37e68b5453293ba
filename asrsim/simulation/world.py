"""Poses and contact forces of the world's objects, looked up where a sample is handed on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from asrsim.engines.base import Engine
from asrsim.samples import Samples


@dataclass
class WorldRecorder:
    """Keeps poses and contacts until the samples of their rows come."""

    engine: Engine
    last: int
    bodies: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    contacts: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)

    def look(self, k: int) -> None:
        """Before substep `k`, where a row is logged."""
        if k <= self.last:
            scene = self.engine.scene()
            for name, pose in scene.bodies.items():
                self.bodies.setdefault(name, []).append(pose)
            for name, force in scene.contacts.items():
                self.contacts.setdefault(name, []).append(force)

    def add_to(self, samples: Samples) -> Samples:
        """`samples` with what was kept for its rows."""
        n = len(samples.time)
        bodies = {name: np.array(rows[:n]) for name, rows in self.bodies.items()}
        contacts = {name: np.array(rows[:n]) for name, rows in self.contacts.items()}
        for rows in (*self.bodies.values(), *self.contacts.values()):
            del rows[:n]
        return replace(samples, bodies={**bodies, **samples.bodies}, contacts=contacts)

    def kept(self) -> Any:
        """What waits for its samples."""
        return self.bodies, self.contacts

    def put_back(self, kept: Any) -> None:
        """Wait for samples with that."""
        self.bodies, self.contacts = kept
