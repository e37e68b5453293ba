"""Frequency response of the joint in figure 11, as data, table and picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.reproduce import FigureTable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure as Drawing

    from asrsim import Result

JOINT = "joint_1"
BAND = (0.5, 6.0)
"""Band of the paper's chirp, Hz."""
POINTS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Frequencies of the table, Hz."""
WIDER = (
    "duration=24",
    f"references.{JOINT}.equilibrium_position={{chirp: {{amplitude: 0.15, from: 0.1, to: 6.7, duration: 24.0}}}}",
)
"""Overrides: a chirp at the same sweep rate over a slightly wider band, since the power of a chirp fades at its ends."""


def response(result: Result) -> FrequencyResponse:
    """Frequency response from the reference of the equilibrium to the link position."""
    series = result[JOINT]
    return frequency_response(result.time, series.reference_1, series.link_position, band=BAND)


def from_equilibrium(result: Result) -> FrequencyResponse:
    """Frequency response from the equilibrium position to the link position. It does not depend on the motors."""
    series = result[JOINT]
    return frequency_response(result.time, series.equilibrium_position, series.link_position, band=BAND)


def response_table(found: Mapping[str, FrequencyResponse]) -> FigureTable:
    """Table of gain, phase and coherence at the frequencies `POINTS`."""
    rows = []
    for frequency in POINTS:
        cells = [f"{frequency:g}"]
        for one in found.values():
            i = int(np.argmin(np.abs(one.frequency - frequency)))
            cells += [f"{one.gain[i]:.3f}", f"{one.phase[i]:.0f}°", f"{one.coherence[i]:.4f}"]
        rows.append(tuple(cells))
    headings = ("Hz", *(f"{word}, {name}" for name in found for word in ("gain", "phase", "coherence")))
    return FigureTable(caption="Response of the link's position to its reference", headings=headings, rows=tuple(rows))


def response_figure(results: Mapping[str, Result]) -> Drawing:
    """Bode plot with a colour for each run."""
    from asrsim.plots.bode import bode_figure
    from asrsim.plots.responses import responses

    found = []
    for number, (name, result) in enumerate(results.items()):
        if result.log is not None:
            found += responses(result.log, label=name, variant=number, band=BAND)[0]
    return bode_figure(found)
