"""Identification: parameters from recordings, with intervals and verdicts (`asrsim identify`)."""

from __future__ import annotations

from asrsim.identification.result import Result
from asrsim.identification.run import Progress, identify
from asrsim.identification.task import Task, task_of

__all__ = ["Progress", "Result", "Task", "identify", "task_of"]
