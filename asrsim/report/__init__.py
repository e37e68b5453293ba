"""Reports: one self-contained HTML page about a run or its variants."""

from __future__ import annotations

from asrsim.report.write import write_report

__all__ = ["write_report"]
