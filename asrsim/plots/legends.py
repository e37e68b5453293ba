"""Legends: quantities at the right of the axes, variants by colour at the bottom of the figure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

from asrsim.plots import style
from asrsim.plots.curves import REFERENCE
from asrsim.quantities import each_motor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def legend(
    axes: Axes,
    quantities: Sequence[str],
    *,
    words: dict[str, str] | None = None,
    extra: Sequence[Any] = (),
    several: bool = False,
    among: Sequence[str] = (),
) -> None:
    """Draw a legend of quantities at the right of the axes, outside the data.

    several: whether the figure has several runs, so that colours mark runs and line styles mark quantities. among: all
    quantities that the panel may contain.
    """
    from matplotlib.lines import Line2D

    plain = [name for name in quantities if not name.startswith("reference") and name != LIMIT]
    styles = style.styles_of_equal_colours(among or quantities)
    handles: dict[str, Any] = {}
    for name in quantities:
        own = several and name in plain
        text = (words or {}).get(name) or _WORDS.get(name) or _named(name)
        handles[text] = Line2D(
            [],
            [],
            linewidth=2.6 if name.startswith("reference") else 0.9 if name == LIMIT else 1.6,
            label=text,
            color=style.BLACK if own else style.colour(name),
            linestyle=LIMIT_LINE if name == LIMIT else style.line_style(plain.index(name)) if own else styles[name],
        )
    if handles or extra:
        length = 3.0 if several else 2.2
        axes.legend(handles=[*handles.values(), *extra], loc="upper left", bbox_to_anchor=(1.02, 1.0), handlelength=length)


def _named(quantity: str) -> str:
    """Name of a quantity, and its symbol if a stage declares one."""
    name, symbol = fill(style.plain(style.name(quantity)), LETTERS - 1), style.symbol(quantity)
    # Of `$\tau_{w1}$`, three letters are drawn.
    drawn = len(re.sub(r"[${}_^]", "", re.sub(r"\\[A-Za-z]+", "x", symbol)))
    apart = " " if len(name.rpartition("\n")[2]) + 1 + drawn < LETTERS else "\n"
    return f"{name}{apart}{symbol}" if symbol else name


LETTERS = 17
"""Number of usual letters of a line that fits at the right of the axes. Names have one letter less, since m and w are wide."""
LIMIT = "limit"
"""Name of the limits in a legend."""
LIMIT_LINE = (0, (4, 1.5, 1, 1.5))
"""Dash pattern of limit lines, in points."""


def variant_columns(labels: Sequence[str], width: float) -> int:
    """Number of columns in the legend of variants, for a figure of this width (inch)."""
    longest = max((len(label) for label in labels), default=1)
    return max(1, min(len(labels), int(width / (0.085 * longest + 0.7))))


def variants(figure: Figure, labels: Sequence[str]) -> None:
    """Draw a legend of variants and their colours below the panels if there are several variants. The entries of the legend are
    in rows."""
    from matplotlib.lines import Line2D

    if len(labels) < 2:
        return
    handles = [
        Line2D([], [], color=style.variant_colour(number), linewidth=2.4, label=style.plain(label))
        for number, label in enumerate(labels)
    ]
    columns = variant_columns(labels, figure.get_figwidth())
    by_columns = [handle for first in range(columns) for handle in handles[first::columns]]
    figure.legend(handles=by_columns, loc="lower center", ncols=columns, handlelength=2.6, borderaxespad=0.4)


_DIGITS = "₁₂₃₄₅₆₇₈"
# Use plain letters, since the parser of mathtext would take a sixth of the drawing time.
_WORDS = {
    REFERENCE: "reference",
    **{name: name.replace("_", " ") for name in each_motor("reference_{}")},
    "link_position": "link q",
    "equilibrium_position": "equilibrium",
    **{name: f"motor θ{digit}" for name, digit in zip(each_motor("motor_{}_position"), _DIGITS, strict=True)},
    "deflection": "deflection ϕ",
    "stiffness": "stiffness k",
    "energy_residual": "residual ΔE",
    "numerical_error": "estimate",
    "link_torque": "actuator τ",
    "external_torque": "external τ",
    "damping_torque": "damping τ",
    **{name: f"motor τ{digit}" for name, digit in zip(each_motor("motor_{}_torque"), _DIGITS, strict=True)},
    **{name: f"spring τ{digit}" for name, digit in zip(each_motor("elastic_torque_{}"), _DIGITS, strict=True)},
    "motor_work": "motor work",
    "spring_energy": "springs",
    "friction_loss": "friction",
    "link_work": "link work",
    "damping_loss": "damping",
    **dict.fromkeys(("reference_x", "reference_y", "reference_z"), "goal"),
    LIMIT: "limits",
}
