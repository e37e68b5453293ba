"""The look of all pictures, in one place: colours, line styles, sizes.

Colours are those of Okabe and Ito (Color Universal Design, 2008), which colour-blind readers tell apart. Of one run they go
by what a quantity belongs to: the link is vermilion and the equilibrium blue, as in the paper's figures. Of several runs they
go by the run, and quantities of one panel by line style.
"""

from __future__ import annotations

from typing import Any

from asrsim.plots.curves import KNOWN
from asrsim.quantities import linear_unit
from asrsim.samples import JointInfo

BLACK, GREY, LIGHT = "#1a1a1a", "#707070", "#b8b8b8"
ORANGE, SKY, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#a39700"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#b3599a"
EXPERIMENT = BLACK

COLOURS: dict[str, str] = {
    "link_position": VERMILION,
    "link_velocity": VERMILION,
    "link_torque": VERMILION,
    "equilibrium_position": BLUE,
    "deflection": ORANGE,
    "stiffness": BLUE,
    "position_error": PURPLE,
    "reference_position": LIGHT,
    "reference_1": "#b5dfd2",
    "reference_2": "#e3c6dc",
    "motor_1_position": GREEN,
    "motor_1_velocity": GREEN,
    "motor_1_torque": GREEN,
    "motor_2_position": PURPLE,
    "motor_2_velocity": PURPLE,
    "motor_2_torque": PURPLE,
    "elastic_torque_1": "#7fceb9",
    "elastic_torque_2": "#dcb0d2",
    "friction_torque_1": "#00573f",
    "friction_torque_2": "#6b2f5b",
    "external_torque": SKY,
    "damping_torque": YELLOW,
    "motor_work": GREEN,
    "spring_energy": ORANGE,
    "friction_loss": PURPLE,
    "link_work": VERMILION,
    "damping_loss": YELLOW,
    "energy_residual": BLACK,
    "numerical_error": PURPLE,
    "dx": VERMILION,
    "dy": GREEN,
    "dz": BLUE,
    "force": BLACK,
}
LINE_STYLES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.8)),
    (0, (6, 1.6, 1.2, 1.6)),
    (0, (1.2, 1.4)),
    (0, (8, 2, 1.2, 2, 1.2, 2)),
    (0, (2.5, 1.2)),
)
"""One a quantity where colours tell runs apart."""
VARIANTS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE, SKY, BLACK, YELLOW)
"""One a run; more runs begin again."""

COLUMN_WIDTH, ROW_HEIGHT, LEGEND_WIDTH = 3.7, 1.55, 1.5
"""inch."""
DPI = 150
"""Dots per inch of a picture."""
LIMIT = "#c2185b"
"""Limits of joints, torques and deflections."""
WIDTH = 1.25
"""pt, of lines."""

RC: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "mathtext.fontset": "dejavusans",
    "axes.labelsize": 8.5,
    "axes.titlesize": 9,
    # A place that is given need not be found by measuring all labels.
    "axes.titley": 1.0,
    "axes.prop_cycle": f"cycler('color', {list(VARIANTS)})",
    "axes.edgecolor": "#8a8a8a",
    "axes.linewidth": 0.7,
    "axes.labelcolor": BLACK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    # Mathematics would take a parser a label.
    "axes.formatter.use_mathtext": False,
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.08,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "xtick.color": "#5a5a5a",
    "ytick.color": "#5a5a5a",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.direction": "out",
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "legend.borderaxespad": 0.0,
    "legend.labelspacing": 0.35,
    "lines.linewidth": WIDTH,
    "lines.solid_capstyle": "round",
    "figure.dpi": DPI,
    "savefig.dpi": DPI,
    "figure.facecolor": "white",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "path.simplify_threshold": 0.1,
    # Pictures of the same log are the same file.
    "svg.hashsalt": "asrsim",
}
"""Settings of matplotlib while our figures are made and written; the user's own come back afterwards."""


def colour(quantity: str) -> str:
    """The colour of a quantity wherever it is drawn."""
    return COLOURS.get(quantity, BLACK)


def line_style(index: int) -> Any:
    """The n-th line style, from 0."""
    return LINE_STYLES[index % len(LINE_STYLES)]


def variant_colour(index: int) -> str:
    """The colour of the n-th of several runs, from 0."""
    return VARIANTS[index % len(VARIANTS)]


def darker(colour_text: str) -> str:
    """A colour for the recording that belongs to a run of that colour."""
    return "#" + "".join(f"{round(0.55 * int(colour_text[i : i + 2], 16)):02x}" for i in (1, 3, 5))


def symbol(quantity: str) -> str:
    """The short label of a quantity for legends, in mathtext."""
    known = KNOWN.get(quantity)
    return known.label if known else plain(quantity.replace("_", " "))


def name(quantity: str) -> str:
    """The quantity in words."""
    return quantity.replace("_", " ")


def unit(quantity: str, joint: JointInfo | None = None) -> str:
    """The unit of a joint's quantity as a picture writes it; a prismatic joint has m and N, AwAS-II's adjuster m."""
    from asrsim.actuators import ACTUATORS, MODES

    known = KNOWN.get(quantity)
    text = known.unit if known else ""
    if joint is not None:
        mode = MODES.get(joint.mode) if joint.mode is not None else None
        if quantity in ("reference_1", "reference_2") and mode is not None:
            index = int(quantity[-1]) - 1
            text = mode.units[index] if index < len(mode.units) else ""
        if has_adjuster(joint) and quantity in ("reference_2", "motor_2_position", "motor_2_velocity"):
            return ACTUATORS.get(joint.actuator).reference_2_unit + ("/s" if quantity == "motor_2_velocity" else "")
        if joint.prismatic:
            text = linear_unit(text)
    return text.replace("N m", "N·m")


def has_adjuster(joint: JointInfo) -> bool:
    """Whether the joint's second reference sets an adjuster instead of a motor."""
    from asrsim.actuators import ACTUATORS

    return joint.actuator in ACTUATORS and ACTUATORS.get(joint.actuator).adjuster


def plain(text: str) -> str:
    """A name from a file as it is: matplotlib would take text between dollars for mathematics."""
    return text.replace("$", r"\$")


def axis_label(words: str, unit_text: str) -> str:
    """`words (unit)`, for an axis; long ones take two lines."""
    return f"{words}{chr(10) if len(words) > 13 else ' '}({unit_text})" if unit_text else words
