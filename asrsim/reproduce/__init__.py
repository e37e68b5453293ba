"""The paper's experiments run again: figures, claims and verdicts (`asrsim reproduce`)."""

from __future__ import annotations

from asrsim.reproduce import arm_sine, arm_steps, box, chirp, steps, teaching  # noqa: F401 - each registers its figure
from asrsim.reproduce.claim import Claim
from asrsim.reproduce.figure import FIGURES, Figure, Part, Picture, Reproduction, Table

__all__ = ["FIGURES", "Claim", "Figure", "Part", "Picture", "Reproduction", "Table"]
