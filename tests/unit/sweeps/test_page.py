"""The page of a study in a real browser: it fits, says nothing on the console, and a line leads to its run."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import asrsim
from asrsim.errors import InputError
from asrsim.plots.output import styled
from asrsim.sweeps import make_study
from asrsim.sweeps.page import write_page
from asrsim.sweeps.pictures import _heat, draw_sweep, figures
from support.browser import CHROMIUM, Browser
from support.overlaps import overlapping
from support.paths import ROOT

pytestmark = pytest.mark.once

pytest.importorskip("pyarrow")
SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"
CLICK = """(() => {
  const canvas = document.getElementById("lines"), box = canvas.getBoundingClientRect();
  for (let part = 0.1; part < 0.9; part += 0.01) for (const across of [0.25, 0.31, 0.36, 0.44]) {
    const at = {clientX: box.left + across * box.width, clientY: box.top + part * box.height, bubbles: true};
    for (const kind of ["mousedown", "mouseup", "click"]) canvas.dispatchEvent(new MouseEvent(kind, at));
    for (const kind of ["pointerdown", "pointerup"]) canvas.dispatchEvent(new PointerEvent(kind, at));
    if (document.getElementById("chosen").innerText) break;
  }
  return document.getElementById("chosen").innerText;
})()"""


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    study = make_study(
        SCENARIO, {"link_2.mass": "0.3:0.6:3"}, variants=["soft", "stiff"], signals=["joint_1.link_position"],
        overrides=["duration=0.2", "engine=mujoco", "compiled=false"],
    )  # fmt: skip
    return asrsim.sweep(study, out=tmp_path_factory.mktemp("study") / "s", workers=1)


def test_the_axis_of_a_sweep_is_the_key_with_most_values_and_shows_all_of_them(tmp_path):
    study = make_study(
        SCENARIO, {"link_1.mass": "0.3:0.6:2", "link_2.mass": "0.3:0.6:3"}, variants=["soft"],
        overrides=["duration=0.05", "engine=mujoco", "compiled=false"],
    )  # fmt: skip
    table = asrsim.sweep(study, out=tmp_path / "s", workers=1)
    with styled():
        axes = figures(table, ["joint_1.peak_deflection"])["results"].axes[0]
        assert "link_2.mass" in axes.get_xlabel()
        assert axes.get_xlim() == pytest.approx((0.3 - 0.03 * 0.3, 0.6 + 0.03 * 0.3))
        for line in axes.lines:
            assert axes.get_ylim()[0] <= np.min(line.get_ydata()) <= np.max(line.get_ydata()) <= axes.get_ylim()[1]


@pytest.mark.parametrize(("middle", "width"), [(-1.62e-3, 2.1e-4), (-12345.6, 0.05)])
def test_numbers_of_any_size_stand_side_by_side(table, monkeypatch, middle, width):
    names, read = ["joint_1.steady_state", "joint_2.steady_state"], type(table).__getitem__
    narrow = middle + width * np.linspace(-0.5, 0.5, len(table))
    monkeypatch.setattr(type(table), "__getitem__", lambda self, name: narrow if name in names else read(self, name))
    with styled():
        for figure in figures(table, names).values():
            assert overlapping(figure) == []


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_the_page_fits_and_a_line_leads_to_its_run(table, tmp_path):
    page = write_page(table)
    with Browser(tmp_path) as browser:
        for width in (1200, 390):
            browser.open(page, width=width)
            assert browser.evaluate("document.documentElement.scrollWidth") <= width
            chosen = browser.evaluate(CLICK)
            assert "Run " in chosen
            assert f"asrsim sweep {table.folder} --run " in chosen
            assert browser.complaints == []


def test_a_listed_key_gets_no_distribution_but_curves_and_signal_bands(table):
    assert [path.name for path in draw_sweep(table, results=["joint_2.steady_state"])] == ["results.png", "signals.png"]
    with pytest.raises(InputError, match="no result of this study"):
        draw_sweep(table, results=["joint_2.overshot"])
    with pytest.raises(InputError, match="no run has a value"):
        draw_sweep(table, results=["joint_2.settling"])
    (legend,) = figures(table, [])["signals"].legends
    assert [text.get_text() for text in legend.get_texts()] == [f"{name}: median, 50 and 90 %" for name in ("soft", "stiff")]


class Rows(dict[str, np.ndarray]):
    """Columns of a study."""

    def unit(self, name: str) -> str:
        return "rad"


@pytest.mark.parametrize(("times", "label"), [(1, "overshoot (rad)"), (2, "mean of overshoot (rad)")])
def test_a_colour_of_several_runs_is_their_mean_and_called_so(times, label):
    mass, gain = np.meshgrid([0.3, 0.4, 0.5], [1.0, 2.0])
    rows = Rows(mass=np.tile(mass.ravel(), times), gain=np.tile(gain.ravel(), times), overshoot=np.arange(6.0 * times))
    shown = Figure().add_subplot()
    _heat(rows, "overshoot", "mass", "gain", shown)
    assert shown.figure.axes[1].get_ylabel() == label
    np.testing.assert_allclose(np.ravel(shown.collections[0].get_array()), np.arange(6.0) + 3.0 * (times - 1))
