"""Reports: one HTML page about a run or its variants, with everything in it."""

from __future__ import annotations

from asrsim.report.write import write_report

__all__ = ["write_report"]
