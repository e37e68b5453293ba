"""Recordings of experiments. They are read, mapped to joints, aligned with a simulation, and compared with it."""

from __future__ import annotations

from asrsim.recordings.align import Alignment, align, resample
from asrsim.recordings.compare import Band, Comparison, Series, band, compare
from asrsim.recordings.data import Column, Recording
from asrsim.recordings.formats import READERS, Reader
from asrsim.recordings.read import read_recording

__all__ = [
    "READERS",
    "Alignment",
    "Band",
    "Column",
    "Comparison",
    "Reader",
    "Recording",
    "Series",
    "align",
    "band",
    "compare",
    "read_recording",
    "resample",
]
