"""The picture of docs/performance.md."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from machine import machine
from scaling import over_joints, over_stiffness

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "performance.png"
BARE, PLAIN, FAST, MUJOCO = "#7f7f7f", "#1f5aa6", "#c4521c", "#2a8f5b"


def draw(folder: Path) -> Path:
    """Measure and draw; returns where the picture is."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    joints, stiffness = over_joints(folder), over_stiffness(folder)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
    for axes, points in ((left, joints), (right, stiffness)):
        x = list(points)
        for label, colour, marker, values in (
            ("PyBullet, plain Python", PLAIN, "o", [point.plain for point in points.values()]),
            ("PyBullet, compiled", FAST, "s", [point.fast for point in points.values()]),
            ("MuJoCo, compiled", MUJOCO, "D", [point.mujoco for point in points.values()]),
            ("PyBullet alone, nothing recorded", BARE, "^", [point.bare for point in points.values()]),
        ):
            axes.loglog(x, [1e6 * value for value in values], color=colour, marker=marker, markersize=4.5, label=label)
        axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        _plain_numbers(axes.yaxis)
    left.set_xlabel("joints (qbMove, mode 6, one substep)")
    left.set_ylabel("CPU time of a step of 1 ms (µs)")
    left.set_xticks(list(joints), [str(n) for n in joints])
    left.minorticks_off()
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    left.set_title("Cost over joints, everything recorded", loc="left", fontsize=11)
    right.set_xlabel("stiffness of the springs (N m/rad; 2 SEAs, mode 6)")
    right.set_title("Cost over stiffness, automatic substeps", loc="left", fontsize=11)
    top = max(point.plain for point in stiffness.values()) * 1e6
    right.set_ylim(top=top * 2.2)
    for k, point in stiffness.items():
        right.annotate(
            str(point.substeps), (k, 1e6 * point.plain), textcoords="offset points", xytext=(0, 7),
            ha="center", fontsize=8, color="#333333",
        )  # fmt: skip
    right.text(
        0.02, 0.97, "numbers: substeps in a step of 1 ms", transform=right.transAxes, fontsize=8,
        va="top", color="#333333",
    )  # fmt: skip
    about = machine()
    libraries = ", ".join(f"{name} {about[name]}" for name in ("Python", "PyBullet", "MuJoCo"))
    figure.supxlabel(f"{about['CPU']}, {libraries}", fontsize=8, color="#666666")
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=130)
    pyplot.close(figure)
    return PICTURE


def _plain_numbers(axis: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator

    axis.set_major_locator(LogLocator(base=10, subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
