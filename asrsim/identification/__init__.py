"""Identification: parameters from recordings, with intervals and verdicts (`asrsim identify`)."""

from __future__ import annotations

from asrsim.identification.causes import CAUSES, Cause
from asrsim.identification.extensions import Extension
from asrsim.identification.folder import FitFolder, read_fit
from asrsim.identification.result import Result
from asrsim.identification.run import FitProgress, identify
from asrsim.identification.task import Task, task_of

__all__ = ["CAUSES", "Cause", "Extension", "FitFolder", "FitProgress", "Result", "Task", "identify", "read_fit", "task_of"]
