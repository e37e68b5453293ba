"""Iterative learning control, in simulation and on the real robot.

The learning law with fixed gains is from section 4.3 of the paper on the toolbox that asrsim re-creates (doi
10.3389/frobt.2021.713083).
"""

from __future__ import annotations

from asrsim.learning.session import LearningSession, learn
from asrsim.learning.trial import FixedGain, LearningProblem, iterate, zero_phase

__all__ = ["FixedGain", "LearningProblem", "LearningSession", "iterate", "learn", "zero_phase"]
