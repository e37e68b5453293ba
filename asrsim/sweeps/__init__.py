"""Sweeps: many runs of varied scenarios, on all cores or a cluster, as rows of a table (`asrsim sweep`)."""

from __future__ import annotations

from asrsim.sweeps.run import sweep
from asrsim.sweeps.study import Study, make_study, read_study
from asrsim.sweeps.table import Table

__all__ = ["Study", "Table", "make_study", "read_study", "sweep"]
