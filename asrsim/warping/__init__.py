"""Scalar Python functions as functions of NVIDIA Warp, from their source: laws and kernel run unchanged on CPU and GPU."""

from __future__ import annotations

from asrsim.warping.kinds import BOOL, FLOAT, INT, Kind, Row, TranslationError, Value
from asrsim.warping.program import Program, available

__all__ = ["BOOL", "FLOAT", "INT", "Kind", "Program", "Row", "TranslationError", "Value", "available"]
