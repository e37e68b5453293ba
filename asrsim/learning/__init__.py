"""Iterative learning control (paper section 4.3) and its transfer to plants that differ from the learned one."""

from __future__ import annotations

from asrsim.learning.iterate import LearningProblem, LearningResult, Trial, learn
from asrsim.learning.law import updated, zero_phase
from asrsim.learning.linear import JointDynamics, choose_gains, linearise
from asrsim.learning.settings import LearningSettings, parse_settings, wants_model_gains
from asrsim.learning.table import write_inputs
from asrsim.learning.transfer import Spread, TransferReport, draw_plants, transfer

__all__ = [
    "JointDynamics",
    "LearningProblem",
    "LearningResult",
    "LearningSettings",
    "Spread",
    "TransferReport",
    "Trial",
    "choose_gains",
    "draw_plants",
    "learn",
    "linearise",
    "parse_settings",
    "transfer",
    "updated",
    "wants_model_gains",
    "write_inputs",
    "zero_phase",
]
