"""Logs: one MCAP file a run, written from Samples and read back into them, bit for bit."""

from __future__ import annotations

from asrsim.log.reader import Log, LogReader, open_log, read_log
from asrsim.log.writer import LogWriter

__all__ = ["Log", "LogReader", "LogWriter", "open_log", "read_log"]
