"""Recorded curves of a comparison, stored beside its pictures for the plots of a report."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path

from asrsim import __version__
from asrsim.outfile import write_text
from asrsim.plots.pairing import RunComparison

RECORDED = "recorded.json"


def write_recorded(path: Path, compared: Iterable[RunComparison]) -> Path:
    """Write the recorded curves, thinned and on the run's clock, for a report and return the file. Raises OutputError."""
    curves = [
        {
            "run": one.label, "joint": pair.joint, "quantity": pair.quantity,
            "time": [round(t, 6) for t in pair.recording.time.tolist()],
            "values": [float(f"{v:.6g}") if math.isfinite(v) else None for v in pair.recording.values.tolist()],
        }
        for one in compared for pair in one.pairs.values()
    ]  # fmt: skip
    data = {"generator": f"asrsim {__version__}", "curves": curves}
    write_text(path, json.dumps(data, separators=(",", ":"), allow_nan=False), "json")
    return path
