"""Logs of runs: one MCAP file for each run. Samples that are read back equal the written samples bit for bit."""

from __future__ import annotations

from asrsim.log.reader import Log, LogReader, open_log, read_log, read_origin
from asrsim.log.writer import LogWriter

__all__ = ["Log", "LogReader", "LogWriter", "open_log", "read_log", "read_origin"]
