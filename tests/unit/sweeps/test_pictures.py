"""Pictures of a study."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.plots.charts import chart_figure
from asrsim.plots.output import styled
from asrsim.sweeps import make_study
from asrsim.sweeps.pictures import draw_sweep, in_rows, study_charts
from asrsim.sweeps.sensitivity import influences
from support.overlaps import overlapping
from support.paths import ROOT

pytest.importorskip("pyarrow")
SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    study = make_study(
        SCENARIO,
        {"link_2.mass": "0.3:0.6:3"},
        variants=["soft", "stiff"],
        overrides=["duration=0.2", "engine=mujoco", "compiled=false"],
    )
    return asrsim.sweep(study, out=tmp_path_factory.mktemp("study") / "s", workers=1)


def test_results_are_drawn_over_the_key_with_most_values(tmp_path):
    study = make_study(
        SCENARIO,
        {"link_1.mass": "0.3:0.6:2", "link_2.mass": "0.3:0.6:3"},
        variants=["soft"],
        overrides=["duration=0.2", "engine=mujoco", "compiled=false"],
    )
    table = asrsim.sweep(study, out=tmp_path / "s", workers=1)
    charts = study_charts(table, ["joint_1.peak_deflection"])
    (results,), (sensitivity,) = charts["results"], charts["sensitivity"]
    assert results.across == "mass of link_2"
    assert results.reach == pytest.approx((0.3 - 0.03 * 0.3, 0.6 + 0.03 * 0.3))
    assert all(line.x.tolist() == pytest.approx([0.3, 0.45, 0.6]) for line in results.lines)
    found = influences(table, "joint_1.peak_deflection")
    low, high = (line.x for line in sensitivity.lines if line.label)
    assert low == pytest.approx([one.low for one in found])
    assert high == pytest.approx([one.high for one in found])
    assert len({*low, *high}) == 4


@pytest.mark.parametrize(("middle", "width"), [(-1.62e-3, 2.1e-4), (-12345.6, 0.05)])
def test_labels_of_numbers_of_any_size_do_not_overlap(table, monkeypatch, middle, width):
    names, read = ["joint_1.steady_state", "joint_2.steady_state"], type(table).__getitem__
    narrow = middle + width * np.linspace(-0.5, 0.5, len(table))
    monkeypatch.setattr(type(table), "__getitem__", lambda self, name: narrow if name in names else read(self, name))
    with styled():
        for charts in study_charts(table, names).values():
            assert overlapping(chart_figure(in_rows(charts), width=3.9, height=2.1)) == []


def test_rows_of_a_study_are_those_of_each_variant_in_turn(table):
    assert table["variant"].astype(str).tolist() == ["soft"] * 3 + ["stiff"] * 3
    stiffer = table["joint_1.peak_deflection"].reshape(2, 3)
    assert (stiffer[1] < stiffer[0]).all()


def test_named_results_are_drawn_and_unknown_ones_refused(table):
    assert [path.name for path in draw_sweep(table, results=["joint_2.peak_deflection"])] == ["results.png"]
    with pytest.raises(InputError, match="not a result of this study"):
        draw_sweep(table, results=["joint_2.overshot"])
    with pytest.raises(InputError, match="no run has a value"):
        draw_sweep(table, results=["joint_2.settling"])
