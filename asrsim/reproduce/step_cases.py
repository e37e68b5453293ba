"""The eight cases of figure 8: four actuators, soft and stiff, on one joint under gravity."""

from __future__ import annotations

from typing import TYPE_CHECKING

from asrsim.reproduce.statics import Rest, rest

if TYPE_CHECKING:
    from asrsim.api import Result

ACTUATORS = {"sea": "SEA", "awas_ii": "AwAS-II", "bavs": "BAVS", "qbmove": "qbMove"}
CASES = tuple((name, variant) for name in ACTUATORS for variant in ("soft", "stiff"))
STEP, AT = 0.8, 0.1
"""rad, s: the step of the reference."""
RESIDUAL = 1e-6
"""rad that the last swings may still have."""


def label_of(case: tuple[str, str]) -> str:
    """A case for people."""
    return f"{ACTUATORS[case[0]]} {case[1]}"


def expected(result: Result) -> Rest:
    """Where the run's joint must rest, with the motors where its run left them."""
    series = result["joint_1"]
    preset = float(series.reference_2[-1]) if "reference_2" in series else 0.0
    return rest(result.run.robot, STEP, preset)
