"""Thinned curves, among them displacements and contact forces of the world's objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asrsim.plots.decimate import Envelope
from asrsim.samples import TIP, TIP_GOAL, Array, Samples


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Thinned time series."""

    time: Array
    """Times (k,), s."""
    values: Array
    """Values (k,), SI units."""

    @property
    def extent(self) -> float:
        """Largest magnitude of the values; 0 without samples."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.max(np.abs(finite))) if len(finite) else 0.0


@dataclass(frozen=True, kw_only=True)
class BodyPanel:
    """Panel of a world object: axis label, unit and curves."""

    words: str
    unit: str
    entries: Mapping[str, str]
    """Name in the legend for each curve, such as `dx`."""


_MOVED = BodyPanel(words="displacement", unit="m", entries={"dx": "along x", "dy": "along y", "dz": "along z"})
_PUSHED = BodyPanel(words="contact force without ground", unit="N", entries={"force": "magnitude"})
_GOAL = {f"goal_{axis}": f"goal along {axis}" for axis in "xyz"}
_LED = BodyPanel(words="displacement", unit="m", entries={**_GOAL, **_MOVED.entries})
_MISSED = BodyPanel(words="distance to the goal", unit="m", entries={"error": "distance"})


def body_panels(name: str) -> tuple[BodyPanel, ...]:
    """Panels of a body: displacement and force; for the tip of a task, goal and distance to the goal."""
    return (_LED, _MISSED) if name == TIP else (_MOVED, _PUSHED)


class WorldEnvelope:
    """Thins displacements and contact forces of the world's objects chunk by chunk; `first` is the first chunk."""

    def __init__(self, first: Samples, *, start: float, end: float, bins: int) -> None:
        self._origins = {
            name: poses[0, :3] for name, poses in first.bodies.items() if name != TIP_GOAL or TIP not in first.bodies
        }
        self._axes = {name: tuple(axis for panel in body_panels(name) for axis in panel.entries) for name in self._origins}
        self._envelopes = {name: Envelope(start=start, end=end, bins=bins) for name, axes in self._axes.items()}

    def add(self, part: Samples) -> None:
        """Add the next chunk."""
        for name, origin in self._origins.items():
            if name not in part.bodies:
                continue
            moved = part.bodies[name][:, :3] - origin
            if name == TIP:
                goal = part.bodies[TIP_GOAL][:, :3] - origin if TIP_GOAL in part.bodies else np.full_like(moved, np.nan)
                columns = [goal, moved, np.linalg.norm(moved - goal, axis=1)[:, None]]
            else:
                columns = [moved, _push(name, part)[:, None]]
            self._envelopes[name].add(part.time, np.concatenate(columns, axis=1))

    def curves(self) -> dict[str, dict[str, Curve]]:
        """Curves of each object by name: displacement from the first sample (m), force (N), goal of a tip (m)."""
        result: dict[str, dict[str, Curve]] = {}
        for name, envelope in self._envelopes.items():
            if envelope.samples:
                columns = [envelope.column(index) for index in range(len(self._axes[name]))]
                result[name] = {
                    axis: Curve(time=time, values=values)
                    for axis, (time, values) in zip(self._axes[name], columns, strict=True)
                }
        return result


def _push(name: str, part: Samples) -> Array:
    """Contact force on a body from robot and other objects, without the ground: magnitude (n,), N."""
    forces = [force for other, force in part.forces_on(name).items() if other != "ground"]
    return np.asarray(np.linalg.norm(sum(forces, np.zeros((len(part.time), 3))), axis=1))
