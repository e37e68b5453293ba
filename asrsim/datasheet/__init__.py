"""Data sheets of actuators after Grioli et al. (2015): numbers, curves and simulated responses (`asrsim datasheet`)."""

from __future__ import annotations

from asrsim.datasheet.bench import measured_curve
from asrsim.datasheet.fitted import fitted_sheets
from asrsim.datasheet.sheet import make_sheet
from asrsim.datasheet.sources import Source, sources_of
from asrsim.datasheet.write import write_sheets

__all__ = ["Source", "fitted_sheets", "make_sheet", "measured_curve", "sources_of", "write_sheets"]
