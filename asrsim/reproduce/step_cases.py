"""The eight cases of figure 8: four actuators, soft and stiff, on one joint under gravity."""

from __future__ import annotations

ACTUATORS = {"sea": "SEA", "awas_ii": "AwAS-II", "bavs": "BAVS", "qbmove": "qbMove"}
CASES = tuple((name, variant) for name in ACTUATORS for variant in ("soft", "stiff"))
AT = 0.1
"""s, of the reference's step."""
RESIDUAL = 1e-6
"""rad that the last swings may still have."""


def label_of(case: tuple[str, str]) -> str:
    """A case for people."""
    return f"{ACTUATORS[case[0]]} {case[1]}"
