"""Numbers of a page and of pictures against those of the logs that they were made of: series, limits, tables."""

import numpy as np
import pytest

import asrsim
from asrsim.plots import read_curves, style
from asrsim.plots.figures import run_pages
from asrsim.recordings.names import find_joint
from asrsim.report.plots import joint_sections, page_quantities
from asrsim.report.series import BUDGET, LEAST, MOST, read_runs, unpack
from support.paths import EXAMPLES
from support.plot_example import made_up_log


def test_every_series_of_a_page_is_that_of_its_run(tmp_path):
    time = np.arange(1001) * 0.001
    rows = {
        name: {"link_torque": scale * np.sin(9 * time), "stiffness": 10.0 + scale * time}
        for name, scale in (("soft", 1.0), ("stiff", 3.0))
    }
    logs = [made_up_log(tmp_path / name / "log.mcap", variant=name, joints=2, values=rows[name]) for name in rows]
    grid, runs = read_runs(logs, quantities=page_quantities())
    assert (grid.thinned, grid.start, grid.step, grid.count) == (False, 0.0, 0.001, 1001)
    np.testing.assert_allclose(grid.time, time, atol=1e-12)
    assert [run.label for run in runs] == ["soft", "stiff"]
    half = (np.array([0.2, 0.4, 0.6]), np.array([1.0, 3.0, 2.0]))
    sections = joint_sections(runs, {("joint_2", "link_position", 1): half}, grid.time)
    assert [section["name"] for section in sections] == ["joint_1", "joint_2"]
    names = {style.name(quantity): quantity for quantity in page_quantities()}
    seen = set()
    for section in sections:
        for plot in section["plots"]:
            dashes = {}
            for line in plot["series"]:
                values = unpack(line, grid.count)
                if line["label"].endswith(", recorded"):
                    assert (section["name"], line["label"], line["run"]) == ("joint_2", "link position, recorded", 1)
                    wanted = np.interp(time, *half, left=np.nan, right=np.nan)
                    assert line["colour"] == style.darker(style.variant_colour(1))
                else:
                    quantity, number = names[line["label"]], line["run"] or 0
                    wanted = runs[number].curves[section["name"], quantity].values
                    seen.add((section["name"], quantity, line["run"]))
                    shared = quantity.startswith("reference")
                    assert (line["run"] is None) == shared
                    assert line["colour"] == (style.colour(quantity) if shared else style.variant_colour(number))
                    assert line["unit"] == style.unit(quantity, runs[0].joints[0])
                    if not shared:
                        dashes.setdefault(quantity, line["dash"])
                        assert line["dash"] == dashes[quantity]
                np.testing.assert_allclose(values, wanted, atol=np.nanmax(np.abs(wanted)) / 30000)
            assert len({tuple(dash) for dash in dashes.values()}) == len(dashes)
    assert {
        (joint, name, n)
        for joint in ("joint_1", "joint_2")
        for name in ("link_position", "link_torque", "stiffness")
        for n in (0, 1)
    } <= seen


def test_runs_of_different_steps_share_a_grid_with_all_extremes(tmp_path):
    fine = made_up_log(tmp_path / "fine" / "log.mcap", variant="fine", count=4001, step=0.001)
    coarse = made_up_log(tmp_path / "coarse" / "log.mcap", variant="coarse", count=101, step=0.02)
    grid, runs = read_runs([fine, coarse], quantities=["link_position", "nothing"])
    bins = int(np.clip(BUDGET / (2 * 2 * 2 * 4 / 3), LEAST, MOST))
    assert (grid.thinned, grid.count) == (True, 2 * bins)
    width = 4.0 / bins
    assert (grid.start, grid.step) == pytest.approx((0.25 * width, 0.5 * width))
    assert grid.as_dict()["margin"] == 0.5 * grid.step
    for log, run, end in ((fine, runs[0], 4.0), (coarse, runs[1], 2.0)):
        whole = read_curves(log).curves["joint_1", "link_position"]
        series = run.curves["joint_1", "link_position"].values
        assert (np.nanmin(series), np.nanmax(series)) == (whole.values.min(), whole.values.max())
        there = np.isfinite(series)
        # Every sample stands within half an interval of its time.
        np.testing.assert_allclose(series[there], 0.4 * np.sin(2 * np.pi * (grid.time[there] - 0.05)), atol=2.6 * width)
        assert grid.time[there].max() == pytest.approx(end, abs=width)


@pytest.mark.parametrize(
    ("name", "joint", "rest"),
    [
        ("elbow_1_pos", "elbow_1", " _pos"),
        ("elbow_12_pos", None, "elbow_12_pos"),
        ("myelbow_1", None, "myelbow_1"),
        ("Elbow1 [rad]", "elbow_1", "  [rad]"),
        ("q_deg", None, "q_deg"),
        ("left_elbow_1", "left_elbow_1", " "),
    ],
)
def test_the_longest_joint_name_in_a_column_is_found(name, joint, rest):
    """A name of one letter may stand for a quantity as well."""
    assert find_joint(name, ["q", "elbow_1", "left_elbow_1"]) == (joint, rest)


def test_pages_and_pictures_show_what_stages_log(tmp_path):
    """Losses of stages stand beside the other energies, temperatures in a plot of their own."""
    stages = {"spring_damping": 0.02, "hysteresis_torque": 0.02, "thermal_resistance": 8.0, "winding_heat": 3.0}
    changes = {"duration": 0.2, **{f"parameters.*.{name}": value for name, value in stages.items()}}
    asrsim.run(EXAMPLES / "scenarios/step_2dof.yaml", variant="soft", overrides=changes, out=tmp_path / "run")
    log = tmp_path / "run/log.mcap"
    grid, runs = read_runs([log], quantities=page_quantities())
    plots = {plot["title"]: plot for plot in joint_sections(runs, {}, grid.time)[0]["plots"]}
    assert [one["label"] for one in plots["heating"]["series"]] == ["motor 1 temperature", "motor 2 temperature"]
    assert plots["heating"]["unit"] == "°C"
    assert {"damper loss", "hysteresis loss"} <= {one["label"] for one in plots["energy"]["series"]}
    for plot in plots.values():
        assert len({one["colour"] for one in plot["series"]}) == len(plot["series"])
    pages = {page.name: page.figure for page in run_pages([read_curves(log)])}
    labels = {name: [axes.get_ylabel() for axes in figure.axes] for name, figure in pages.items()}
    assert "heating (°C)" in labels["joints"]
