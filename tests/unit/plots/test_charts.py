"""Figures of charts."""

import numpy as np
import pytest

from asrsim.plots.chart import Chart, Line, Shade
from asrsim.plots.charts import chart_figure
from asrsim.plots.decimate import Envelope
from asrsim.plots.legends import variants
from asrsim.plots.output import styled
from asrsim.quantities import prefixed, shown

TIME = np.linspace(0.0, 1.0, 20)


def chart(words: str, values=TIME, label: str = "", **more) -> Chart:
    return Chart(words=words, unit="rad", lines=[Line(label=label, x=TIME, y=values, colour="black")], **more)


def test_a_column_without_values_is_left_out_and_an_empty_chart_says_so():
    nothing = np.full(20, np.nan)
    rows = [
        [chart("position"), chart("stiffness", nothing), chart("torque", nothing)],
        [chart("position"), chart("stiffness", nothing), chart("torque")],
    ]
    with styled():
        figure = chart_figure(rows)
    assert [axes.get_ylabel() for axes in figure.axes] == ["position (rad)", "", "position (rad)", "torque (rad)"]
    assert [text.get_text() for text in figure.axes[1].texts] == ["not recorded"]


def test_places_behind_the_last_chart_of_a_row_are_empty():
    with styled():
        figure = chart_figure([[chart("position"), chart("stiffness"), chart("torque")], [chart("position")]])
    assert [axes.axison for axes in figure.axes] == [True, True, True, True, False, False]


@pytest.mark.parametrize(("highest", "second"), [(3e2, 2.0), (3e4, 10.0)])
def test_labels_of_a_long_logarithmic_axis_are_powers_of_ten(highest, second):
    with styled():
        (axes,) = chart_figure([[chart("stiffness", np.geomspace(1.0, highest, 20), logarithmic="y")]]).axes
        ticks = [tick for tick in axes.get_yticks() if 1.0 <= tick <= highest]
    assert ticks[:2] == pytest.approx([1.0, second])
    assert ticks[-1] > 0.3 * highest


def test_a_chart_is_drawn_as_it_is_stated():
    y = np.array([0.5, 2.0, 1.0, np.nan])
    x = np.array([0.1, 0.2, 0.4, 0.8])
    lines = [
        Line(label="one", x=x, y=y, colour="#112233", width=2.0, dash=1, opacity=0.5),
        Line(label="two", x=x, y=2 * y, colour="#445566", kind="points"),
        Line(label="", x=x, y=3 * y, colour="#445566", kind="both"),
    ]
    band = Shade(label="band", x=x, low=0 * x, high=x, colour="#778899", where=np.array([True, True, False, False]))
    stated = Chart(
        words="error", unit="rad", head="elbow", across="load", across_unit="N", lines=lines, bands=[band], note="RMS 2",
        span=(-1.0, 7.0), mark=0.3, logarithmic="x",
    )  # fmt: skip
    with styled():
        figure = chart_figure([[stated]], title="a title")
        (axes,) = figure.axes
        *drawn, mark = axes.get_lines()
        assert [line.get_label() for line in drawn[:2]] == ["one", "two"]
        for line, wanted in zip(drawn, lines, strict=True):
            np.testing.assert_array_equal(line.get_xydata(), np.column_stack([wanted.x, wanted.y]))
            assert (line.get_color(), line.get_alpha(), line.get_linewidth()) == (wanted.colour, wanted.opacity, wanted.width)
            assert (line.get_marker() == "o", line.get_linestyle() == "None") == (
                wanted.kind != "line",
                wanted.kind == "points",
            )
        assert mark.get_xdata() == [0.3, 0.3]
        (shade,) = axes.collections
        assert shade.get_datalim(axes.transData).x1 == 0.2
        texts = [axes.get_title("left"), axes.get_xlabel(), axes.get_ylabel(), *(text.get_text() for text in axes.texts)]
        assert texts == ["elbow", "load (N)", "error (rad)", "RMS 2"]
        assert (axes.get_ylim(), axes.get_xscale(), axes.get_yscale()) == ((-1.0, 7.0), "log", "linear")
        assert [text.get_text() for text in axes.get_legend().get_texts()] == ["one", "two", "band"]
        assert any(text.get_text() == "a title" for text in figure.texts)
        plain = chart_figure([[chart("position"), chart("motion", reach=(-1.0, 2.0))]])
    assert [axes.get_xlim() for axes in plain.axes] == [(0.0, 1.0), (-1.0, 2.0)]


def test_a_legend_lies_outside_the_axes_and_inside_the_picture():
    long = "a recording with a very long name of its own"
    with styled():
        figure = chart_figure(
            [[chart("position", label=long, bands=[Shade(label="held out", x=TIME, low=TIME, high=TIME, colour="r")])]]
        )
        figure.draw_without_rendering()
        (axes,) = figure.axes
        legend = axes.get_legend().get_window_extent()
    assert legend.x0 > axes.get_window_extent().x1
    assert legend.x1 < figure.bbox.x1


@pytest.mark.parametrize("last", [1, 2, 3, 7, 40])
def test_an_axis_of_iterations_has_whole_numbers(last):
    iterations = np.arange(last + 1.0)
    line = Line(label="error", x=iterations, y=iterations + 1.0, colour="black", kind="both")
    with styled():
        figure = chart_figure([[Chart(words="error", across="iteration", across_unit="", lines=[line])]])
        figure.draw_without_rendering()
        low, high = figure.axes[0].get_xlim()
        ticks = [tick for tick in figure.axes[0].get_xticks() if low <= tick <= high]
    assert 2 <= len(ticks) <= 7
    assert all(tick == round(tick) for tick in ticks)


def test_a_note_hides_no_curve():
    with styled():
        figure = chart_figure([[chart("difference", note="RMS 0.04 mrad")]])
        figure.draw_without_rendering()
        (axes,) = figure.axes
        (note,) = axes.texts
        assert note.get_window_extent().y0 >= axes.get_window_extent().y1


def test_a_legend_is_not_repeated_below_the_same_legend():
    rows = [[chart("a", label="one"), chart("b", label="two")]] * 2 + [[chart("a", label="one"), chart("b", label="three")]]
    with styled():
        figure = chart_figure(rows)
    texts = [[text.get_text() for text in axes.get_legend().get_texts()] for axes in figure.axes if axes.get_legend()]
    assert texts == [["one", "two"], ["one", "three"]]


def test_the_legend_of_variants_reads_by_rows():
    names = [f"a long name of variant {number}" for number in range(5)]
    with styled():
        figure = chart_figure([[chart("position")]])
        variants(figure, names)
        figure.draw_without_rendering()
        boxes = {text.get_text(): text.get_window_extent() for text in figure.legends[0].get_texts()}
    read = sorted(boxes, key=lambda name: (-round(boxes[name].y0), boxes[name].x0))
    assert read == names
    assert len({round(box.y0) for box in boxes.values()}) > 1


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(7.5e-5, "m", "0.075 mm"), (7.5e-6, "m", "7.5 µm"), (0.8, "rad", "0.8 rad"), (-2e-3, "N m", "-2 mN m"), (0.0, "m", "0 m"),
     (7.5e-5, "kg", "7.5e-05 kg"), (3e-3, "", "0.003")],
)  # fmt: skip
def test_small_numbers_take_a_smaller_unit(value, unit, text):
    assert shown(value, unit) == text


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((0.3, -5.841e-5), (1e3, "mrad")),
        ((12.0, 1e-5), (1.0, "rad")),
        ((0.5, 0.2), (1.0, "rad")),
        ((0.0, 2e-6), (1e6, "µrad")),
        ((float("nan"), 0.0), (1.0, "rad")),
    ],
)
def test_numbers_of_a_row_share_a_unit_in_which_none_is_tiny(values, expected):
    assert prefixed(values, "rad") == expected


def test_a_series_without_values_has_no_extremes():
    envelope = Envelope(start=0.0, end=1.0, bins=4)
    envelope.add(TIME, np.column_stack([TIME, np.full(20, np.nan)]))
    assert np.isnan(envelope.pairs(1)).all()
    assert np.nanmax(envelope.pairs(0)) == 1.0
