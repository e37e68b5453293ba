"""Data sheets of actuators after Grioli et al. (2015): numbers, curves and simulated responses (`asrsim datasheet`)."""

from __future__ import annotations

from asrsim.datasheet.sheet import make_sheet
from asrsim.datasheet.sources import Source, sources_of
from asrsim.datasheet.write import write_sheets

__all__ = ["Source", "make_sheet", "sources_of", "write_sheets"]
