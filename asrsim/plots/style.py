"""Style of all pictures: colours, line styles, sizes.

Colours are from Okabe and Ito (Color Universal Design, 2008), which colour-blind readers can distinguish. In pictures of
one run a colour marks the part: vermilion marks the link and blue marks the equilibrium, as in the paper's figures. In pictures
of several runs a colour marks the run, and a line style marks the quantity.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from asrsim.plots.curves import KNOWN
from asrsim.quantities import DERIVED, MOST_MOTORS, QUANTITIES, linear_unit
from asrsim.samples import JointInfo

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BLACK, GREY, LIGHT = "#1a1a1a", "#707070", "#b8b8b8"
ORANGE, SKY, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#a39700"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#b3599a"
EXPERIMENT = BLACK

_OF_MOTORS = (
    (GREEN, "#b5dfd2", "#7fceb9", "#00573f"),
    (PURPLE, "#e3c6dc", "#dcb0d2", "#6b2f5b"),
    (ORANGE, "#f5d9a6", "#f0c266", "#8a5f00"),
    (SKY, "#cfe8f7", "#a3d5f2", "#1f6a9a"),
)
MOTORS = {i: _OF_MOTORS[(i - 1) % len(_OF_MOTORS)] for i in range(1, MOST_MOTORS + 1)}
"""Colours for the motion, the reference, the spring's torque and the friction of each motor."""
COLOURS: dict[str, str] = {
    "link_position": VERMILION,
    "link_velocity": VERMILION,
    "link_torque": VERMILION,
    "equilibrium_position": BLUE,
    "deflection": ORANGE,
    "stiffness": BLUE,
    "position_error": PURPLE,
    "reference_position": LIGHT,
    **dict.fromkeys(("reference_x", "reference_y", "reference_z"), LIGHT),
    **{f"motor_{i}_{what}": own for i, (own, *_) in MOTORS.items() for what in ("position", "velocity", "torque")},
    **{f"reference_{i}": pale for i, (_, pale, *_) in MOTORS.items()},
    **{f"elastic_torque_{i}": light for i, (*_, light, _) in MOTORS.items()},
    **{f"friction_torque_{i}": dark for i, (*_, dark) in MOTORS.items()},
    "external_torque": SKY,
    "damping_torque": YELLOW,
    "motor_work": GREEN,
    "spring_energy": ORANGE,
    "friction_loss": PURPLE,
    "link_work": VERMILION,
    "damping_loss": YELLOW,
    "damper_loss": BLUE,
    "hysteresis_loss": SKY,
    "energy_residual": BLACK,
    "numerical_error": PURPLE,
    "dx": VERMILION,
    "dy": GREEN,
    "dz": BLUE,
    "force": BLACK,
    "limit": "#c2185b",
}
LINE_STYLES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.8)),
    (0, (6, 1.6, 1.2, 1.6)),
    (0, (1.2, 1.4)),
    (0, (8, 2, 1.2, 2, 1.2, 2)),
    (0, (2.5, 1.2)),
)
"""Line styles, one per quantity, where colours mark runs."""
VARIANTS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE, SKY, BLACK, YELLOW)
"""Colours, one per run; further runs repeat the colours from the first."""

COLUMN_WIDTH, ROW_HEIGHT, LEGEND_WIDTH = 3.7, 1.55, 1.5
"""COLUMN_WIDTH: width of a column; ROW_HEIGHT: height of a row; LEGEND_WIDTH: width of the legends; all in inches."""
DPI = 150
"""Resolution of a picture, dots per inch."""
WIDTH, WIDE = 1.25, 2.6
"""WIDTH: width of a line, pt; WIDE: width of a reference or recording under other lines, pt."""

RC: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "mathtext.fontset": "dejavusans",
    "axes.labelsize": 8.5,
    "axes.titlesize": 9,
    # Fix the position of titles, so that Matplotlib need not measure all labels.
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
    # Do not use mathtext here, since its parser would run for every label.
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
    # Fix the salt of the random names in SVG files, so that equal logs give equal files.
    "svg.hashsalt": "asrsim",
}
"""Matplotlib settings while asrsim makes and writes figures; the user's settings are restored afterwards."""


def colour(quantity: str) -> str:
    """Colour of a quantity in every picture; a quantity for which no colour is declared has the colour of its motor."""
    motor = next((i for i in MOTORS if f"_{i}_" in quantity), None)
    return COLOURS.get(quantity, BLACK if motor is None else MOTORS[motor][0])


def styles_of_equal_colours(quantities: Sequence[str]) -> dict[str, Any]:
    """Line style of each quantity of a panel. Quantities with the same colour have different styles. References have wide
    lines."""
    found = dict.fromkeys(quantities, LINE_STYLES[0])
    colours: list[str] = []
    for quantity in quantities:
        if not quantity.startswith("reference"):
            found[quantity] = line_style(colours.count(colour(quantity)))
            colours.append(colour(quantity))
    return found


def line_style(index: int) -> Any:
    """Line style number `index`, from 0."""
    return LINE_STYLES[index % len(LINE_STYLES)]


def variant_colour(index: int) -> str:
    """Colour of run number `index`, from 0."""
    return VARIANTS[index % len(VARIANTS)]


def darker(colour_text: str) -> str:
    """Darker shade of a run's colour, for the run's recording."""
    return "#" + "".join(f"{round(0.55 * int(colour_text[i : i + 2], 16)):02x}" for i in (1, 3, 5))


def symbol(quantity: str) -> str:
    """Symbol of a stage's quantity for legends, if it is valid mathtext; else "". Names of other quantities contain their
    symbols."""
    from matplotlib.mathtext import MathTextParser

    from asrsim.actuators.stages import STAGES

    own = (one.label for stage in STAGES.loaded() for one in stage.quantities if one.name == quantity)
    label = next(own, "")
    try:
        MathTextParser("path").parse(label)
    except ValueError:
        return ""
    return label


def name(quantity: str) -> str:
    """Name of a quantity in words; for a quantity of a body, the words that follow the title of its panel."""
    return _BODY_NAMES.get(quantity) or quantity.replace("_", " ")


_BODY_NAMES = {
    **{f"d{axis}": f"along {axis}" for axis in "xyz"},
    **{f"reference_{axis}": f"goal along {axis}" for axis in "xyz"},
    "force": "without ground",
    "error": "distance",
}


def unit(quantity: str, joint: JointInfo | None = None) -> str:
    """Unit of a joint's quantity for pictures, as in `asrsim.joint_units.unit_at`."""
    from asrsim.joint_units import unit_at

    if joint is not None and (quantity in QUANTITIES or quantity in DERIVED):
        return unit_at(quantity, joint)
    known = KNOWN.get(quantity)
    text = known.unit if known else ""
    return linear_unit(text) if joint is not None and joint.prismatic else text


def has_adjuster(joint: JointInfo) -> bool:
    """Whether the joint's second reference belongs to an adjuster instead of a motor."""
    from asrsim.actuators import ACTUATORS

    return joint.actuator in ACTUATORS and ACTUATORS.get(joint.actuator).adjuster


def plain(text: str) -> str:
    """Name from a file with dollar signs escaped, which Matplotlib would read as mathematics."""
    return text.replace("$", r"\$")


def in_words(key: str) -> str:
    """Key or result in words: `stiffness preset of joint_1` for `references.joint_1.stiffness_preset`."""
    owner, _, last = key.rpartition(".")
    owner = owner.removeprefix("references.").removeprefix("parameters.")
    return last.replace("_", " ") + (f" of {owner}" if owner else "")


def empty(axes: Axes) -> None:
    """Write into axes without curves that nothing was recorded."""
    axes.set_ylabel("")
    axes.set_yticks([])
    axes.grid(False)
    axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color=GREY)


def axis_label(words: str, unit_text: str) -> str:
    """Axis label `words (unit)`; a long label, or words that end with a line break, take two lines."""
    space = "" if words.endswith("\n") else "\n" if len(words) > 13 else " "
    return f"{words}{space}({unit_text})" if unit_text else words.rstrip()
