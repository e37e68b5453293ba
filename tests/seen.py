"""What users see, as lines of text: pictures read from their figures, pages without markup, numbers to three digits."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from PIL import Image

from asrsim import __version__

NUMBER = re.compile(r"(?<![\w.])-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w])")
CHANGING = (
    (re.compile(r"\S+ s \(\S+ x real time\)|\d\S* x real time|\d+ evaluations, \S+ s"), "SPEED"),
    (re.compile(r"\"(wall_time|simulating_time|speed|seconds|busy|python|numpy|mujoco\S*|pybullet|numba|scipy)\": .*"), r"\1"),
    (re.compile(r"(?<=simulated[ ,]) ?(in )?[\d.]+ s"), "SPEED"),
    (re.compile(r"(?:\.\./)+\S*?(?=examples/)"), "PROJECT/"),
    (re.compile(re.escape(__version__)), "VERSION"),
    (re.compile(r"^( {4,6}\d+  [\d. ]+) \d+\.\d\d$", re.M), r"\1"),
    (re.compile(r"\b(mujoco|pybullet|numpy|numba|scipy) \d[\d.]*"), r"\1"),
    (re.compile(r"[ \t]+$", re.M), ""),
    (re.compile(r"-?\d[\d.]*e-(?:1[5-9]|2[0-4])(?!\d)"), "0"),
    (re.compile(r"\"recording\": \"[0-9a-f]{64}"), '"recording": "DIGEST'),
    (re.compile(r"(?:\.\./){3,}(?:[\w.-]+/)*(?=examples/)"), "PROJECT/"),
)
"""What differs from run to run, or from release to release."""
TILES = 12
"""Of a picture, each way."""


def steady(text: str, folder: Path) -> list[str]:
    """Lines of a text without what differs from run to run."""
    text = text.replace(str(folder), "FOLDER")
    for pattern, word in CHANGING:
        text = pattern.sub(word, text)
    return text.replace(str(Path(__file__).parents[1]), "PROJECT").splitlines()


def figure_lines(figure: Figure) -> list[str]:
    """Everything of a figure that somebody drew, with its colours and numbers; where layout put it is left out."""
    lines = [f"figure {_numbers(figure.get_size_inches())}", *(f"  text {text.get_text()!r}" for text in figure.texts)]
    if figure._suptitle is not None:
        lines.append(f"  title {figure._suptitle.get_text()!r}")
    lines += [f"  {_legend(legend)}" for legend in figure.legends]
    for axes in figure.axes:
        lines.append(
            f"  axes {axes.get_title()!r} x {axes.get_xlabel()!r} {axes.get_xscale()} {_numbers(axes.get_xlim())}"
            f" y {axes.get_ylabel()!r} {axes.get_yscale()} {_numbers(axes.get_ylim())}"
        )
        edge, word = axes.spines["bottom"], (axes.get_xticklabels() or [axes.xaxis.label])[0]
        style = (
            f"{edge.get_linewidth():g} {to_hex(edge.get_edgecolor())} words {word.get_fontsize():g} {to_hex(word.get_color())}"
        )
        lines.append(
            f"    edge {style} label {axes.yaxis.label.get_fontsize():g} title {axes.title.get_fontsize():g}"
            f" ticks x {_ticks(axes.xaxis)} y {_ticks(axes.yaxis)}"
        )
        if axes.get_legend() is not None:
            lines.append(f"    {_legend(axes.get_legend())}")
        lines += [f"    {line}" for artist in axes.get_children() if (line := _artist(artist))]
    return lines


def _ticks(axis: Any) -> str:
    """First and last of the words at an axis, and its lines of a grid."""
    words = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
    grid = axis.get_gridlines()[:1]
    drawn = [f"grid {line.get_linewidth():g} {to_hex(line.get_color())}" for line in grid if line.get_visible()]
    return " ".join([str([len(words), *words[:1], *words[-1:]]), f"and {len(axis.get_minorticklocs())}", *drawn])


def _legend(legend: Any) -> str:
    lines = []
    for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True):
        look = _stroke(handle) if isinstance(handle, Line2D) else type(handle).__name__
        lines.append(f"{text.get_text()!r} {look}")
    return f"legend {legend._ncols} {legend._loc} {legend.handlelength:g} {lines}"


def _stroke(line: Line2D) -> str:
    style = f"{to_hex(line.get_color(), keep_alpha=True)} {line.get_linewidth():g} {line.get_linestyle()}"
    # Dashes of one's own have the name of the usual ones.
    dashes = f" {_numbers(line._unscaled_dash_pattern[1])}" if line.is_dashed() else ""
    mark = f" {line.get_markersize():g}" if line.get_marker() not in ("", "None", None) else ""
    return f"{style}{dashes} {line.get_marker()}{mark}"


def _artist(artist: Any) -> str:
    if not artist.get_visible():
        return ""
    kind, gid = type(artist).__name__, artist.get_gid() or ""
    if isinstance(artist, Line2D):
        x, y = np.asarray(artist.get_xdata(), float), np.asarray(artist.get_ydata(), float)
        return f"line {gid} {_stroke(artist)} z {artist.get_zorder():g} x {_extent(x)} y {_extent(y)}"
    if kind in ("Text", "Annotation"):
        look = f"{to_hex(artist.get_color())} {artist.get_fontsize():g} {artist.get_ha()} {artist.get_va()}"
        # A title is where layout puts it.
        place = "" if artist is artist.axes.title else _numbers(artist.get_position())
        return f"text {artist.get_text()!r} {look} {place}" if artist.get_text() else ""
    if isinstance(artist, Rectangle) and artist.get_width() * artist.get_height():
        box = (*artist.get_xy(), artist.get_width(), artist.get_height())
        return f"box {gid} {to_hex(artist.get_facecolor(), keep_alpha=True)} {_numbers(box)}"
    if isinstance(artist, PathCollection | PolyCollection):
        points = np.concatenate([path.vertices for path in artist.get_paths()] or [np.empty((0, 2))])
        if isinstance(artist, PathCollection):
            points = np.asarray(artist.get_offsets(), float)
        colours = sorted({to_hex(colour, keep_alpha=True) for colour in artist.get_facecolor()})[:3]
        return f"area {gid} {colours} z {artist.get_zorder():g} x {_extent(points[:, 0])} y {_extent(points[:, 1])}"
    if isinstance(artist, LineCollection):
        points = np.concatenate([np.empty((0, 2)), *artist.get_segments()])
        return f"strokes {_numbers(artist.get_linewidths())} x {_extent(points[:, 0])} y {_extent(points[:, 1])}"
    if kind in ("AxesImage", "QuadMesh"):
        return f"image {_extent(np.asarray(artist.get_array(), float).ravel())}"
    return ""


def _extent(values: Any) -> str:
    """How many, first, last, least, largest, mean."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return f"{len(values)} of none"
    return _numbers((len(values), finite[0], finite[-1], finite.min(), finite.max(), finite.mean()))


def _numbers(values: Any) -> str:
    return " ".join(f"{0.0 if abs(value) < 1e-9 else value:.4g}" for value in values)


def picture_lines(path: Path) -> list[str]:
    """Size of a picture and the mean colours of its tiles."""
    lines = []
    with Image.open(path) as image:
        lines.append(f"picture {image.size} {getattr(image, 'n_frames', 1)} frames")
        small = image.convert("RGB").resize((TILES, TILES), Image.Resampling.BOX)
        lines += [" ".join(f"{red} {green} {blue} |" for red, green, blue in row) for row in np.asarray(small).tolist()]
    return lines


class _Words(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._silent = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._silent = tag in ("script", "style")
        self.lines += [f"<{tag} {name}={value}>" for name, value in attrs if name in ("title", "alt", "href") and value]

    def handle_endtag(self, tag: str) -> None:
        self._silent = False

    def handle_data(self, data: str) -> None:
        if not self._silent and data.strip():
            self.lines += [" ".join(line.split()) for line in data.split("\n") if line.strip()]


def page_lines(page: str) -> list[str]:
    """The words of a page; where a name may be broken is no matter."""
    words = _Words()
    words.feed(page.replace("<wbr>", ""))
    return words.lines


def differences(seen: list[str], recorded: list[str]) -> list[str]:
    """Where lines differ in words, or in a number by more than a thousandth."""
    found = [f"{len(seen)} lines, recorded are {len(recorded)}"] if len(seen) != len(recorded) else []
    for number, (one, other) in enumerate(zip(seen, recorded, strict=False), start=1):
        same = NUMBER.sub("#", one) == NUMBER.sub("#", other)
        pairs = zip(map(float, NUMBER.findall(one)), map(float, NUMBER.findall(other)), strict=False)
        slack = 3.0 if one.endswith("|") else 1e-9
        if not same or any(abs(a - b) > 1e-3 * max(abs(a), abs(b)) + slack for a, b in pairs):
            found.append(f"line {number}: {one}\n   recorded: {other}")
    return found
