"""Iterative learning control (paper section 4.3), in simulation and on the real robot."""

from __future__ import annotations

from asrsim.learning.trial import FixedGain, LearningProblem, learn, zero_phase

__all__ = ["FixedGain", "LearningProblem", "learn", "zero_phase"]
