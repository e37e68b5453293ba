"""The work-precision picture: what an error costs in each stepping."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from validation.models import chain, run
from validation.order import Case, errors, jump_cases, smooth_cases

STEPS = tuple(4e-3 / 2.0**i for i in range(7))
"""s, from the coarsest."""
LOOKS = {
    "leapfrog": ("#0072b2", "o", "default (leapfrog)"),
    "euler": ("#e69f00", "s", "Euler"),
    "toolbox": ("#cc3311", "^", "released code"),
}
"""Colour, marker and name of a stepping."""
CASES = {
    "2 joints, mode 6, qbmove": "two qbMove joints, mode 6, sinusoid",
    "2 joints, mode 3, bavs, jump on the grid": "two BAVS joints, mode 3, step",
}


def work_precision(path: Path) -> None:
    """Write the picture to `path`."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    known = {case.name: case for case in (*smooth_cases(), *jump_cases())}
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.2), sharey=True, layout="constrained")
    for axis, (name, title) in zip(axes, CASES.items(), strict=True):
        panel(axis, known[name])
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("cost: time of a simulated second / ms")
        axis.grid(visible=True, which="major", alpha=0.3)
    axes[0].set_ylabel("largest error of a joint's position / rad")
    axes[0].legend(frameon=False, fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def panel(axis: Any, case: Case) -> None:
    """Error over cost of one motion, a line a stepping, a point a step."""
    steps = np.array(STEPS)
    for stepping, (colour, marker, label) in LOOKS.items():
        found = np.array(errors(case, STEPS, stepping=stepping))
        spent = 1e3 * cost(case, stepping) / steps
        sane = found < 1.0
        axis.loglog(spent[sane], found[sane], color=colour, marker=marker, label=label, linewidth=1.5, markersize=5)
        if stepping == "leapfrog":
            for x, y, step in zip(spent[sane], found[sane], steps[sane], strict=True):
                text = f"{1e3 * step:g} ms" if step > 9e-4 else f"1/{1e-3 / step:.0f} ms"
                axis.annotate(text, (x, y), textcoords="offset points", xytext=(-6, -9), ha="right", fontsize=7, color=colour)
    low, high = axis.get_xlim()
    axis.set_xlim(0.4 * low, 1.5 * high)


def cost(case: Case, stepping: str) -> float:
    """s that a step takes in the plain loop: the best of five runs at 1 ms."""
    best = float("inf")
    for _ in range(5):
        result = run(
            chain(*case.bodies), mode=case.mode, references=case.references, parameters=case.parameters, initial=case.initial,
            duration=2.0, step=1e-3, substeps=1, motor_substeps=1, stepping=stepping, compiled=False,
        )  # fmt: skip
        best = min(best, result.wall_time / 2000.0)
    return best
