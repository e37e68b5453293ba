"""Iterative learning control (paper section 4.3), in simulation and on the real robot."""

from __future__ import annotations

from asrsim.learning.law import FixedGain, zero_phase
from asrsim.learning.trial import LearningProblem, learn

__all__ = ["FixedGain", "LearningProblem", "learn", "zero_phase"]
