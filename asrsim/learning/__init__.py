"""Iterative learning control (paper section 4.3) and its transfer to plants that differ from the learned one."""

from __future__ import annotations

from asrsim.learning.contraction import choose_gains, factors, learnable, safe_filter
from asrsim.learning.iterate import learn
from asrsim.learning.law import updated, zero_phase
from asrsim.learning.linear import linearise_along
from asrsim.learning.table import write_inputs
from asrsim.learning.transfer import draw_plants, transfer
from asrsim.learning.trial import LearningProblem

__all__ = [
    "LearningProblem",
    "choose_gains",
    "draw_plants",
    "factors",
    "learn",
    "learnable",
    "linearise_along",
    "safe_filter",
    "transfer",
    "updated",
    "write_inputs",
    "zero_phase",
]
