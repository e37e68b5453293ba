"""What a fit tells of relative changes, and the directions of which it tells nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from asrsim.identification.layout import Entry, Layout
from asrsim.identification.uncertainty import Uncertainty
from asrsim.samples import Array

UNKNOWN = 0.3
"""Relative half width of an interval from which on a direction is not told."""
FAR = 2.3
"""Relative change, in logarithms, beyond which nobody would believe what is not told."""


def percent(share: float, sign: str = "") -> str:
    """A share for people, in two digits and without a power of ten; sign: `+` shows it always."""
    return f"{float(f'{100.0 * share:.2g}'):{sign}g} %"


def relative(layout: Layout, x: Array, jacobian: Array) -> tuple[Array, Array]:
    """Jacobian (m, n) by relative changes of the values, and the values (n,); sizes stand for values near 0."""
    values = layout.values(x)
    scale = np.array([_scale(entry, float(v)) for v, entry in zip(values, layout.entries, strict=True)])
    return jacobian * (scale / layout.slopes(x)), values


def _scale(entry: Entry, value: float) -> float:
    return value if entry.parameter.logarithmic else max(abs(value), 0.05 * entry.parameter.size)


class Told:
    """What is told of relative changes of some entries, and which directions of them are not."""

    def __init__(self, layout: Layout, x: Array, found: Uncertainty, free: Sequence[int], limit: float = UNKNOWN) -> None:
        self.layout, self.found, self.free = layout, found, list(free)
        scaled, self.values = relative(layout, x, found.jacobian)
        self.scaled = scaled[:, self.free]
        """(m, k) Jacobian by relative changes."""
        self.units = relative(layout, x, np.ones((1, len(x))))[0][0][self.free]
        """(k,) change of the vector by a relative change."""
        # The triangle of its factors has the same directions, and is small.
        self._triangle = np.linalg.qr(self.scaled, mode="r")
        _, singular, self._vectors = np.linalg.svd(self._triangle)
        self._sizes = np.full(len(self.free), 1e-100)
        self._sizes[: len(singular)] = np.maximum(singular, 1e-100)
        self.noise = 1.96 * float(np.sqrt(found.variance))
        off = self.noise / self._sizes
        self._known = off <= limit
        self.directions = self._vectors[~self._known]
        """(u, k) that stay unknown."""
        self.extent = np.minimum(off[~self._known], FAR)
        """(u,) relative half widths along these."""
        self.alone = np.sqrt(np.sum((self._vectors * off[:, None]) ** 2, axis=0))
        """(k,) relative half widths of the entries, each alone."""

    def parts(self, direction: Array) -> list[int]:
        """Entries without which an unknown direction would be known, the largest first."""
        rest = direction.copy()
        for i in np.argsort(np.abs(direction)):
            without = rest.copy()
            without[i] = 0.0
            if float(np.linalg.norm(self._triangle @ without)) * UNKNOWN <= self.noise * float(np.linalg.norm(without)):
                rest = without
        return [int(i) for i in np.argsort(-np.abs(rest)) if rest[i] != 0.0 and self.alone[i] > UNKNOWN]

    def moved(self, x: Array, change: Array) -> Array:
        """x with its entries changed by a factor e^change (k,), as scales that nothing tells are."""
        entries = [self.layout.entries[i] for i in self.free]
        plain = np.array([not one.parameter.logarithmic for one in entries]) & (self.values[self.free] > 0.0)
        there = x.copy()
        there[self.free] += np.where(plain, np.expm1(change), change) * self.units
        return there

    def fitted(self, x: Array, base: Array, residuals: Callable[[Array], Array], rounds: int = 3) -> Array:
        """x moved along what is known only, to where residuals are as `base` (m,) was."""
        low, high = self.layout.bounds
        inside = self._vectors[self._known]
        inverse = (inside.T / self._sizes[self._known] ** 2) @ inside
        for _ in range(rounds):
            step = inverse @ (self.scaled.T @ (residuals(x) - base)) * self.units
            x = x.copy()
            x[self.free] -= step
            x = np.clip(x, low, high)
        return x

    def margin(self, exponents: Array) -> float:
        """Relative half width of the 95 % interval of a product of powers."""
        inside = self._vectors[self._known]
        projected = inside @ exponents
        sizes = self._sizes[self._known]
        moves = np.zeros((1, self.found.scores.shape[1]))
        moves[0, self.free] = (inside.T @ (projected / sizes**2)) * self.units
        deviation, quantile = self.found.deviations(moves)
        # What of it is unknown is so as far as that direction is.
        return float(np.hypot(deviation[0] * quantile[0], np.linalg.norm(self.extent * (self.directions @ exponents))))
