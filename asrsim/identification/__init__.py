"""Identification: parameters from recordings, with intervals and verdicts (`asrsim identify`)."""

from __future__ import annotations

from asrsim.identification.folder import FitFolder, read_fit
from asrsim.identification.result import Result
from asrsim.identification.run import FitProgress, identify
from asrsim.identification.task import Task, task_of

__all__ = ["FitFolder", "FitProgress", "Result", "Task", "identify", "read_fit", "task_of"]
