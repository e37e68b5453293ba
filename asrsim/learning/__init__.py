"""Iterative learning control (paper section 4.3), in simulation and on the real robot."""

from __future__ import annotations

from asrsim.learning.session import LearningSession, learn
from asrsim.learning.trial import FixedGain, LearningProblem, iterate, zero_phase

__all__ = ["FixedGain", "LearningProblem", "LearningSession", "iterate", "learn", "zero_phase"]
