"""Iterative learning control (paper section 4.3) and its transfer to plants that differ from the learned one."""

from __future__ import annotations

from asrsim.learning.contraction import choose_gains, factors, learnable, safe_filter
from asrsim.learning.iterate import learn
from asrsim.learning.law import FixedGain, updated, zero_phase
from asrsim.learning.linear import Linearised, linearise_along
from asrsim.learning.optimal import Lifted, NormOptimal
from asrsim.learning.settings import LearningSettings, parse_settings, wants_model_gains
from asrsim.learning.table import write_inputs
from asrsim.learning.transfer import Spread, TransferReport, draw_plants, transfer
from asrsim.learning.trial import Law, LearningProblem, LearningResult, Proposal, Trial

__all__ = [
    "FixedGain",
    "Law",
    "LearningProblem",
    "LearningResult",
    "LearningSettings",
    "Lifted",
    "Linearised",
    "NormOptimal",
    "Proposal",
    "Spread",
    "TransferReport",
    "Trial",
    "choose_gains",
    "draw_plants",
    "factors",
    "learn",
    "learnable",
    "linearise_along",
    "parse_settings",
    "safe_filter",
    "transfer",
    "updated",
    "wants_model_gains",
    "write_inputs",
    "zero_phase",
]
