"""Translates scalar Python functions to functions of NVIDIA Warp, so that laws and kernel run unchanged on CPU and GPU."""

from __future__ import annotations

from asrsim.warping.program import WarpProgram, warp_available
from asrsim.warping.values import BOOL, FLOAT, INT, NumberType, Row, TranslationError, Value

__all__ = ["BOOL", "FLOAT", "INT", "NumberType", "Row", "TranslationError", "Value", "WarpProgram", "warp_available"]
