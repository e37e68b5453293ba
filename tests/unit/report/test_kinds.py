"""Pages about a fit, a study, learning and a twin: what they say, and that a browser draws them."""

import json
import re

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.identification import identify
from asrsim.identification.folder import FIT
from asrsim.identification.write import fit_data, write_curves_of
from asrsim.outfile import write_json
from asrsim.plots.chart import Chart, Line, Shade
from asrsim.report import write_report
from asrsim.report.charts import plot_data
from asrsim.report.series import unpack
from asrsim.sweeps import make_study
from support.browser import CHROMIUM
from support.identify_files import CHIRP, SEA, record, write
from support.pages import Page
from support.paths import ROOT

SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    true = write(folder / "true", "lab", SEA, references=f"{{equilibrium_position: {CHIRP}}}")
    guess = write(folder / "guess", "lab", {**SEA, "damping": 0.03}, references=f"{{equilibrium_position: {CHIRP}}}")
    recording = record(true, folder / "a.csv")
    result = identify(guess, [recording], free=["joint_1.damping", "joint_1.spring_stiffness"])
    (folder / "result").mkdir()
    advice = ["asrsim design next.yaml", "move slower"]
    write_json(folder / "result" / FIT, {**fit_data(result), "next": advice, "causes": ["friction <b> would explain 3 %"]})
    write_curves_of(result, folder / "result")
    return folder / "result"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    pytest.importorskip("pyarrow")
    study = make_study(
        SCENARIO,
        {"link_2.mass": "uniform(0.3, 0.6)", "joint_1.damping": "uniform(0.0, 0.1)"},
        variants=["soft"],
        samples=8,
        overrides=["duration=0.2", "engine=mujoco", "compiled=false"],
    )
    folder = tmp_path_factory.mktemp("study") / "s"
    asrsim.sweep(study, out=folder, workers=1)
    return folder


@pytest.fixture
def twin(tmp_path):
    time = np.arange(10_000) * 1e-3
    torque = np.where((time > 4.0) & (time < 4.5), 3.0, 0.01)
    alarm = (torque > 1.0).astype(float)
    head = "time [s],arm.external_torque [N m],arm.stiffness [N m/rad],arm.residual [rad],arm.alarm"
    rows = np.column_stack([time, torque, np.full(10_000, np.nan), 0.1 * torque, alarm])
    with (tmp_path / "twin.csv").open("w") as stream:
        stream.write(f"# asrsim twin: external torques on the robot\n{head}\n")
        np.savetxt(stream, rows, delimiter=",")
    return tmp_path


@pytest.fixture
def learned(tmp_path):
    data = {
        "scenario": "lab.yaml",
        "variant": "soft",
        "outcome": "converged",
        "converged": True,
        "reason": "converged after 1 iteration",
        "iterations": 1,
        "best": 1,
        "law": "auto",
        "reach": "the joints can do it",
        "demands": [{"joint": "arm", "what": "motor torque", "needed": 2.5, "limit": 4.0, "unit": "N m"}],
        "trials": [
            {"iteration": n, "largest_error": {"arm": error}, "rms_error": {"arm": 0.5 * error}}
            for n, error in ((0, 0.1), (1, 0.01))
        ],
    }
    write_json(tmp_path / "ilc.json", data)
    for name, column in (("learned", "arm.equilibrium_position [rad]"), ("desired", "arm.link_position [rad]")):
        rows = "\n".join(f"{0.01 * i:g},{0.001 * i:g}" for i in range(100))
        (tmp_path / f"{name}.csv").write_text(f"# asrsim ilc: converged\ntime [s],{column}\n{rows}\n")
    return tmp_path


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)[1])


def titles(page):
    return [plot["title"] for group in data_of(page)["groups"] for plot in group["plots"]]


def test_a_fit_s_page_says_all_that_the_fit_found(fit):
    page = write_report(fit)
    text = Page(page).text
    for words in ("the model fits", "identified", "95 % interval", "friction <b> would explain 3 %", "asrsim design next.yaml",
                  "move slower", "Correlations", "Profiles", "asrsim sweep"):  # fmt: skip
        assert words in text, words
    drawn = titles(page)
    assert drawn[:3] == ["joint_1: link position", "difference", "spectrum"]
    assert drawn[3:] == ["damping of joint_1", "spring stiffness of joint_1"]


def test_a_study_s_page_has_results_influences_and_rows_to_open(study):
    page = write_report(study)
    text = Page(page).text
    for words in (
        "8 of 8 runs",
        "Influence of the keys",
        "mass of link_2 (kg)",
        "Best and worst rows",
        "asrsim sweep",
        "asrsim view",
    ):
        assert words in text, words
    run = re.search(r"--run (\d+)", page.read_text(encoding="utf-8"))[1]
    assert f"run_{int(run):06d}/log.mcap" in text
    assert "peak deflection of joint_1" in titles(page)


def test_a_twin_s_page_counts_alarms_and_keeps_the_peak(twin):
    page = write_report(twin)
    assert "3 4.001 1" in " ".join(Page(page).text.split())
    torque = data_of(page)["groups"][0]["plots"][0]
    values = unpack(torque["series"][0], torque["x"]["count"])
    assert (values.max(), values.min()) == (3.0, 0.01)
    assert titles(page) == ["external torque", "residual"]  # no stiffness is known


def test_a_learning_s_page_has_errors_and_motions(learned):
    page = write_report(learned)
    text = " ".join(Page(page).text.split())
    assert "converged after 1 iteration" in text
    assert "joint demand needed limit unit arm motor torque 2.5 4 N m" in text
    assert "iteration largest error of arm RMS error of arm 0 0.1 0.05 1 0.01 0.005" in text
    error, motion = data_of(page)["groups"][0]["plots"]
    assert unpack(error["series"][0], 2) == pytest.approx(np.log10([0.1, 0.01]))
    assert [line["label"] for line in motion["series"]] == ["desired position", "learned input"]


def test_a_learning_that_ended_before_its_first_trial_has_a_page(learned):
    data = json.loads((learned / "ilc.json").read_text())
    ended = {"trials": [], "outcome": "interrupted", "converged": False, "reason": "interrupted before the first iteration"}
    write_json(learned / "ilc.json", {**data, **ended})
    page = write_report(learned)
    assert "interrupted before the first iteration" in Page(page).text
    assert titles(page) == []


@pytest.mark.parametrize("name", ["fit.json", "study.json", "ilc.json", "twin.csv"])
@pytest.mark.parametrize("content", ["", "{", "[3]", '{"keys": 3}', "time [s],a\n1,2"])
def test_damaged_results_are_refused_by_name(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=re.escape(name)):
        write_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_scattered_points_at_one_place_are_all_drawn():
    x, y = np.array([2.0, 1.0, 1.0]), np.array([5.0, 6.0, 7.0])
    line = Line(label="a", x=x, y=y, colour="#000000", kind="points")
    other = Line(label="b", x=np.array([1.0]), y=np.array([9.0]), colour="#000000", kind="points")
    data = plot_data(Chart(words="w", lines=[line, other]))
    assert unpack(data["x"], data["x"]["count"]).tolist() == [1.0, 1.0, 1.0, 2.0]
    first = unpack(data["series"][0], 4)
    assert sorted(first[np.isfinite(first)]) == [5.0, 6.0, 7.0]
    assert np.nanmax(unpack(data["series"][1], 4)) == 9.0


def test_a_band_is_shaded_only_where_it_holds():
    x, edge = np.arange(4.0), np.ones(4)
    band = Shade(label="alarm", x=x, low=-edge, high=edge, colour="#d55e00", where=np.array([False, True, True, False]))
    (drawn,) = plot_data(Chart(words="w", lines=[Line(label="a", x=x, y=x, colour="#000000")], bands=[band]))["bands"]
    assert np.isfinite(unpack(drawn["high"], 4)).tolist() == [False, True, True, False]
    assert drawn["colour"] == "#d55e0033"


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 420])
def test_a_browser_draws_each_kind_without_complaint(browser, tmp_path, fit, study, twin, learned, width):
    for name, folder in (("fit", fit), ("study", study), ("twin", twin / "twin.csv"), ("ilc", learned / "ilc.json")):
        page = write_report(folder, tmp_path / f"{name}.html")
        browser.open(page, width=width)
        browser.evaluate("new Promise((done) => setTimeout(done, 500))")
        assert browser.complaints == [], name
        assert browser.evaluate("asrsimCharts.length") == len(titles(page)), name
        assert browser.evaluate("document.documentElement.scrollWidth") == width, name
