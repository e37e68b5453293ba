"""Pictures of logs and recordings: figure functions that draw on given axes, and files in png, pdf and svg."""

from __future__ import annotations

from asrsim.plots.curves import RunCurves, read_curves
from asrsim.plots.decimate import Curve, Envelope, decimate
from asrsim.plots.figures import FIGURES, FigurePage, RunFigure, draw_run, joint_names

__all__ = [
    "FIGURES",
    "Curve",
    "Envelope",
    "FigurePage",
    "RunCurves",
    "RunFigure",
    "decimate",
    "draw_run",
    "joint_names",
    "read_curves",
]
