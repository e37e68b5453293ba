"""Translates scalar Python functions to functions of NVIDIA Warp, from their source. The laws of the actuators and the
simulation kernel thus need no second version for the GPU.
"""

from __future__ import annotations

from asrsim.warping.program import WarpProgram, warp_available
from asrsim.warping.values import BOOL, FLOAT, INT, NumberType, Row, TranslationError, Value

__all__ = ["BOOL", "FLOAT", "INT", "NumberType", "Row", "TranslationError", "Value", "WarpProgram", "warp_available"]
