"""Recordings of experiments: read, mapped to joints, aligned with a simulation and compared with it."""

from __future__ import annotations

from asrsim.recordings.checks import guess_rows, guess_table, suspect_scale
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.read import FORMATS, read_recording

__all__ = ["FORMATS", "Column", "Recording", "guess_rows", "guess_table", "read_recording", "suspect_scale"]
