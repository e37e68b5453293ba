"""Thinned curves, and those of the world's objects: displacements and contact forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asrsim.plots.decimate import Envelope
from asrsim.samples import Array, Samples


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A thinned series."""

    time: Array
    """(k,) s."""
    values: Array
    """(k,) SI."""

    @property
    def extent(self) -> float:
        """Largest magnitude, 0 without samples."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.max(np.abs(finite))) if len(finite) else 0.0


class WorldEnvelope:
    """Displacements and contact forces of the world's objects, chunk by chunk; `first` is the first chunk."""

    _AXES = ("dx", "dy", "dz", "force")

    def __init__(self, first: Samples, *, start: float, end: float, bins: int) -> None:
        self._origins = {name: poses[0, :3] for name, poses in first.bodies.items()}
        self._envelopes = {name: Envelope(4, start=start, end=end, bins=bins) for name in self._origins}

    def add(self, part: Samples) -> None:
        """The next chunk."""
        for name, origin in self._origins.items():
            if name not in part.bodies:
                continue
            total = np.zeros((len(part.time), 3))
            for pair, force in part.contacts.items():
                one, _, other = pair.partition("/")
                # The force acts on the first body.
                sign = 1.0 if one == name else -1.0 if other == name else 0.0
                # Without the ground: what the robot and other objects do to it.
                if sign and other != "ground":
                    total += sign * np.nan_to_num(force)
            moved = part.bodies[name][:, :3] - origin
            force = np.linalg.norm(total, axis=1)
            self._envelopes[name].add(part.time, np.concatenate([moved, force[:, None]], axis=1))

    def curves(self) -> dict[str, dict[str, Curve]]:
        """Object -> dx, dy, dz (m from the first sample), force (N)."""
        result: dict[str, dict[str, Curve]] = {}
        for name, envelope in self._envelopes.items():
            if envelope.samples:
                columns = [envelope.column(index) for index in range(4)]
                result[name] = {
                    axis: Curve(time=time, values=values) for axis, (time, values) in zip(self._AXES, columns, strict=True)
                }
        return result
