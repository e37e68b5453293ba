"""Identification: parameters from recordings, with intervals and verdicts (`asrsim identify`)."""

from __future__ import annotations

from asrsim.identification.progress import Progress
from asrsim.identification.result import Result
from asrsim.identification.run import identify
from asrsim.identification.task import Experiment, Task, Tie, Wish, make_task, read_task

__all__ = ["Experiment", "Progress", "Result", "Task", "Tie", "Wish", "identify", "make_task", "read_task"]
