"""Colours that show a quantity on the bodies, and the colour scale that explains the colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asrsim.quantities import unit_of
from asrsim.samples import Array
from asrsim.viewer.figure import Rgb

SCALES: dict[str, tuple[tuple[int, int, int], ...]] = {
    # Blue for negative deflections, grey for 0, red for positive deflections.
    "deflection": ((33, 102, 172), (146, 197, 222), (240, 240, 240), (244, 165, 130), (178, 24, 43)),
    # Yellow for soft joints, violet for stiff joints.
    "stiffness": ((253, 231, 37), (94, 201, 98), (33, 145, 140), (59, 82, 139), (68, 1, 84)),
}
"""Colours at even distances along the scale of a quantity, for each quantity that can colour the bodies."""


class ColourScale:
    """Colours for the values of a quantity. The ends of the scale are the smallest and the largest value so far; a scale of
    deflections is symmetric about 0.
    """

    def __init__(self, quantity: str) -> None:
        self.quantity = quantity
        self._low, self._high = np.inf, -np.inf

    def colours(self, values: Array) -> list[Rgb | None]:
        """Colour of each value; None for a value that is not finite."""
        finite = values[np.isfinite(values)]
        if not len(finite):
            return [None] * len(values)
        low, high = float(finite.min()), float(finite.max())
        if self.quantity == "deflection":
            high = max(abs(low), abs(high), 1e-9)
            low = -high
        self._low, self._high = min(self._low, low), max(self._high, high)
        anchors = np.array(SCALES[self.quantity], dtype=float)
        width = self._high - self._low
        share = np.clip(
            (values - self._low) / width if width > 1e-12 * abs(self._high) else np.full(len(values), 0.5), 0.0, 1.0
        )
        place = np.linspace(0.0, 1.0, len(anchors))
        mixed = np.transpose([np.interp(share, place, channel) for channel in anchors.T])
        found: list[Rgb | None] = []
        for value, (red, green, blue) in zip(values.tolist(), np.nan_to_num(mixed).round().astype(int).tolist(), strict=True):
            found.append((red, green, blue) if np.isfinite(value) else None)
        return found

    def legend(self) -> str:
        """HTML of the scale with the values at its ends; empty before the first value."""
        if not self._low <= self._high:
            return ""
        stops = ", ".join(f"rgb{anchor}" for anchor in SCALES[self.quantity])
        unit = unit_of(self.quantity)
        ends = [f"{value:.3g}" for value in (self._low, self._high)]
        return (
            f'<div style="font-size:0.8em;padding:0 0.8em">{words_of(self.quantity)}, {unit}'
            f'<div style="height:0.8em;border-radius:3px;background:linear-gradient(to right, {stops})"></div>'
            f'<div style="display:flex;justify-content:space-between"><span>{ends[0]}</span><span>{ends[1]}</span></div></div>'
        )


def words_of(quantity: str) -> str:
    """Name of a quantity in words."""
    return quantity.replace("_", " ")


def label_of(quantity: str, units: Sequence[str] = ()) -> str:
    """Name of a quantity in words with its unit. units: units of the shown joints, in place of the quantity's unit."""
    unit = " or ".join(dict.fromkeys(units)) or unit_of(quantity)
    return f"{words_of(quantity)}, {unit}" if unit else words_of(quantity)
