"""What functions give over ranges is what they gave when somebody last looked: numbers to a thousandth, and where they decide
otherwise.

`ASRSIM_RECORD=1 python -m pytest tests/test_over_ranges.py` records it anew: read the difference before you keep it.
"""

from __future__ import annotations

import os
import warnings
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from given import Detail, value_line
from over_ranges import bodies, checks, core, drives, identification, learning, metrics, motors, pictures, rare, recordings
from seen import differences

pytestmark = pytest.mark.once

RECORDED = Path(__file__).parent / "seen" / "ranges"
ASKED = {
    "measures": metrics.measures, "metrics": metrics.of_metrics, "recordings": recordings.of_recordings,
    "headers": recordings.of_headers,
    "identification": identification.of_identification, "core": core.of_the_core, "learning": learning.of_learning,
    "kicks": motors.kicks, "signals": motors.of_signals, "bodies": bodies.of_bodies, "robots": bodies.of_robots,
    "files": bodies.of_files, "waiting": bodies.of_waiting, "drives": drives.of_drives,
    "pictures": pictures.of_pictures, "sweeps": pictures.of_sweeps, "rare": rare.of_the_rare, "checks": checks.of_checks,
}  # fmt: skip


def _answer(function: Any, arguments: tuple[Any, ...]) -> str:
    try:
        return value_line("", function(*arguments), Detail(words=40)).strip()
    except Exception as error:  # what it refuses is an answer, too
        return " ".join(f"{type(error).__name__}: {error}".split())[:120]


@pytest.mark.parametrize("name", ASKED)
def test_answers_over_ranges(name: str) -> None:
    shown = []
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for label, function, asked in ASKED[name]():
            answers = [_answer(function, arguments) for arguments in asked]
            for text, alike in groupby(answers):
                shown.append(f"{label}: {text} x{len(list(alike))}")
    path = RECORDED / f"{name}.txt"
    if "ASRSIM_RECORD" in os.environ:
        path.parent.mkdir(exist_ok=True)
        path.write_text("\n".join(shown) + "\n", encoding="utf-8")
    found = differences(shown, path.read_text(encoding="utf-8").splitlines())
    assert not found, "\n".join(found[:20])
