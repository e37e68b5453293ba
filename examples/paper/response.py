"""The frequency response of figure 11's joint: of a run, as a table, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asrsim.metrics.frequency import FrequencyResponse, frequency_response
from asrsim.reproduce import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure as Drawing

    from asrsim import Result

JOINT = "joint_1"
BAND = (0.5, 6.0)
"""Hz, of the paper's chirp."""
POINTS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Hz, of the table."""
WIDER = (
    "duration=24",
    f"references.{JOINT}.equilibrium_position={{chirp: {{amplitude: 0.15, from: 0.1, to: 6.7, duration: 24.0}}}}",
)
"""Overrides: the chirp at the same rate over a little more than the band, at whose ends its power fades."""


def response(result: Result) -> FrequencyResponse:
    """Response of the link's position to the reference of its equilibrium."""
    series = result[JOINT]
    return frequency_response(result.time, series.reference_1, series.link_position, band=BAND)


def from_equilibrium(result: Result) -> FrequencyResponse:
    """Response of the link to where its motors are: the spring, the load and friction alone."""
    series = result[JOINT]
    return frequency_response(result.time, series.equilibrium_position, series.link_position, band=BAND)


def response_table(found: Mapping[str, FrequencyResponse]) -> Table:
    """Gain, phase and coherence at some frequencies."""
    rows = []
    for frequency in POINTS:
        cells = [f"{frequency:g}"]
        for one in found.values():
            i = int(np.argmin(np.abs(one.frequency - frequency)))
            cells += [f"{one.gain[i]:.3f}", f"{one.phase[i]:.0f}°", f"{one.coherence[i]:.4f}"]
        rows.append(tuple(cells))
    headings = ("Hz", *(f"{word}, {name}" for name in found for word in ("gain", "phase", "coherence")))
    return Table(caption="Response of the link's position to its reference", headings=headings, rows=tuple(rows))


def response_figure(results: Mapping[str, Result]) -> Drawing:
    """Bode plot of runs, by colour."""
    from asrsim.plots.bode import bode_figure
    from asrsim.plots.responses import responses

    found = []
    for number, (name, result) in enumerate(results.items()):
        if result.log is not None:
            found += responses(result.log, label=name, variant=number, band=BAND)[0]
    return bode_figure(found)
