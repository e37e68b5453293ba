"""Identification of parameters from recordings, with intervals and verdicts (`asrsim identify`)."""

from __future__ import annotations

from typing import Any

from asrsim.identification.causes import CAUSES, Cause
from asrsim.identification.extensions import Extension
from asrsim.identification.folder import FitFolder, read_fit
from asrsim.identification.result import FitResult
from asrsim.identification.run import FitProgress, identify
from asrsim.identification.task import Task, task_of
from asrsim.renamed import new_name

__all__ = ["CAUSES", "Cause", "Extension", "FitFolder", "FitProgress", "FitResult", "Task", "identify", "read_fit", "task_of"]


def __getattr__(name: str) -> Any:
    return globals()[new_name("asrsim.identification", name)]
