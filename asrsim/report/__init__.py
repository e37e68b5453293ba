"""Reports: one self-contained HTML page about runs, a fit, a study, learning or a twin."""

from __future__ import annotations

from asrsim.report.write import write_report

__all__ = ["write_report"]
