"""Pictures of logs and recordings: figure functions that draw on given axes, and files in png, pdf and svg."""

from __future__ import annotations

from asrsim.plots.curves import RunCurves, read_curves
from asrsim.plots.decimate import Curve, Envelope, decimate
from asrsim.plots.figures import draw_run

__all__ = ["Curve", "Envelope", "RunCurves", "decimate", "draw_run", "read_curves"]
