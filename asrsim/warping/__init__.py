"""Scalar Python functions as functions of NVIDIA Warp, from their source: laws and kernel run unchanged on CPU and GPU."""

from __future__ import annotations

from asrsim.warping.kinds import BOOL, FLOAT, INT, Row, TranslationError, Value, WarpKind
from asrsim.warping.program import WarpProgram, warp_available

__all__ = ["BOOL", "FLOAT", "INT", "Row", "TranslationError", "Value", "WarpKind", "WarpProgram", "warp_available"]
