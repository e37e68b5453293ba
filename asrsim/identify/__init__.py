"""Identification: parameters from recordings, with intervals and verdicts (`asrsim identify`)."""

from __future__ import annotations

from asrsim.identify.run import Progress, Result, identify
from asrsim.identify.task import Experiment, Task, Tie, Wish, make_task, read_task

__all__ = ["Experiment", "Progress", "Result", "Task", "Tie", "Wish", "identify", "make_task", "read_task"]
