"""Pictures of runs: what is drawn, with which units and colours, into which files."""

import re
from dataclasses import replace

import numpy as np
import pytest

from asrsim import make_scenario, run
from asrsim.errors import InputError
from asrsim.log import LogWriter
from asrsim.plots import draw_run, read_curves
from asrsim.plots.curves import CurveSource, distinct_labels
from asrsim.plots.decimate import Curve
from asrsim.plots.figures import new_figure, run_pages
from asrsim.plots.job import PlotJob, plot
from asrsim.plots.layout import PanelGrid
from asrsim.plots.output import styled
from asrsim.plots.panels import PANELS, draw_panel
from asrsim.plots.view import label_values, show_values
from support.log_example import INFO, example_samples
from support.overlaps import outside, overlapping
from support.paths import EXAMPLES
from support.plot_example import made_up_log, simulated_log


def lines(axes):
    return {line.get_gid(): line for line in axes.get_lines()}


@pytest.mark.parametrize("heights", [(1.0, 1.0), (2.1, 0.7)])
def test_panels_have_their_size_in_inches(heights):
    grid = PanelGrid(columns=1, heights=heights, gap_y=0.3)
    figure, axes = grid.figure([])
    upper, lower = (ax.get_position() for ax in axes[:, 0])
    inches = figure.get_figheight() * np.array([upper.height, lower.height, upper.y0 - lower.y1])
    assert inches == pytest.approx((*heights, 0.3))
    assert figure.get_figwidth() * upper.width == pytest.approx(grid.width)


def test_an_external_torque_that_is_never_there_is_not_drawn(tmp_path):
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["torque"], [read_curves(made_up_log(tmp_path / "log.mcap"))], "joint_1")
    assert list(lines(axes)) == ["joint_1.link_torque.0"]


def test_a_prismatic_joint_has_metres_and_an_adjuster_too(tmp_path):
    with LogWriter(tmp_path / "log.mcap", INFO) as log:
        log.write(example_samples(200))
    run = read_curves(tmp_path / "log.mcap")
    labels = {}
    for key, joint in (("position", "slide"), ("torque", "slide"), ("adjuster", "lever")):
        axes = new_figure(4, 3).subplots()
        draw_panel(axes, PANELS[key], [run], joint)
        labels[key] = axes.get_ylabel()
    assert labels["position"] == "position (m)"
    assert labels["torque"].startswith("link force")
    assert "(m)" in labels["adjuster"]


def test_a_resting_value_is_not_blown_up(tmp_path):
    values = {"stiffness": 10.0 + 1e-13 * np.sin(np.arange(1001.0))}
    run = read_curves(made_up_log(tmp_path / "log.mcap", values=values))
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["stiffness"], [run], "joint_1")
    low, high = axes.get_ylim()
    assert low < 9.5
    assert high > 10.5


def test_a_spike_of_one_sample_is_drawn(tmp_path):
    torque = np.zeros(60_000)
    torque[31_234] = 5.0
    run = read_curves(made_up_log(tmp_path / "log.mcap", count=60_000, values={"link_torque": torque}))
    curve = run.get("joint_1", "link_torque")
    assert curve is not None
    assert curve.values.max() == 5.0
    assert curve.time[curve.values.argmax()] == pytest.approx(31.234)
    assert len(curve.time) <= 6100
    assert run.samples == 60_000


@pytest.mark.parametrize(("limit", "is_near"), [(1.29, True), (1.31, False), (-0.29, True), (-0.31, False), (0.5, True)])
def test_an_axis_reaches_to_the_limits_near_its_curves(limit, is_near):
    axes, time = new_figure(2.0, 2.0).subplots(), np.linspace(0.0, 1.0, 50)
    bound = Curve(time=time, values=np.full(50, limit))
    show_values(axes, [Curve(time=time, values=time)], limits=[bound], brief=False)
    low, high = axes.get_ylim()
    assert (low < limit < high) == is_near
    assert low < 0.0 < 1.0 < high


@pytest.mark.parametrize(("low", "high"), [(100.0, 100.0002), (-1e-5, 8e-5), (-0.35, 0.25), (1e6, 5e6)])
def test_every_tick_has_its_own_label(low, high):
    figure, axes = PanelGrid(columns=1, heights=[1.6]).figure([])
    axes[0, 0].set_ylim(low, high)
    figure.canvas.draw()
    labels = [label.get_text().replace("\u2212", "-") for label in axes[0, 0].get_yticklabels()]
    np.testing.assert_allclose([float(label) for label in labels], axes[0, 0].get_yticks(), rtol=1e-9, atol=1e-15)
    assert len({*labels}) == len(labels)


@pytest.mark.parametrize(
    ("largest", "unit", "label", "tick"),
    [
        (7.5e-5, "m", "way (mm)", 0.05),
        (2e-6, "m", "way (µm)", 2.0),
        (1.2e-3, "rad", "way (mrad)", 1.0),
        (0.2, "m", "way (m)", 0.2),
        (1e-4, "%", "way (%)", 1e-4),
    ],
)
def test_small_values_have_a_smaller_unit(largest, unit, label, tick):
    axes = new_figure(4, 3).subplots()
    curve = Curve(time=np.linspace(0, 1, 20), values=np.linspace(0.0, largest, 20))
    show_values(axes, [curve], brief=False)
    label_values(axes, "way", unit)
    axes.figure.canvas.draw()
    texts = {float(text.get_text().replace("\N{MINUS SIGN}", "-")) for text in axes.get_yticklabels()}
    assert axes.get_ylabel() == label
    assert min(abs(one - tick) for one in texts) < 1e-6 * tick


@pytest.mark.parametrize(("joints", "pages"), [(3, 1), (5, 2)])
def test_many_joints_take_several_pages_and_an_overview(tmp_path, joints, pages):
    run = read_curves(made_up_log(tmp_path / "log.mcap", joints=joints, count=50))
    names = [page.name for page in run_pages([run])]
    assert len([name for name in names if name.startswith("joints")]) == pages
    assert ("overview" in names) == (joints >= 5)


@pytest.mark.parametrize("joints", [1, 3])
def test_no_text_of_a_page_covers_another_or_leaves_the_page(tmp_path, joints):
    logs = [made_up_log(tmp_path / name / "log.mcap", joints=joints, count=50, variant=name) for name in ("soft", "stiff")]
    with styled():
        for page in run_pages([read_curves(log) for log in logs]):
            assert overlapping(page.figure) == outside(page.figure) == []


@pytest.mark.parametrize(
    ("files", "labels"),
    [
        (["r1/soft/log", "r2/soft/log"], ["r1", "r2"]),
        (["a/log", "a/other"], ["log", "other"]),
        (["x/one/log", "x/two/deep/log"], ["one", "two/deep"]),
        (["x/log", "x/y/log"], ["soft 1", "soft 2"]),
    ],
)
def test_runs_of_one_variant_are_named_by_their_paths(tmp_path, files, labels):
    runs = [read_curves(made_up_log(tmp_path / f"{file}.mcap", joints=1, variant="soft")) for file in files]
    assert [run.label for run in distinct_labels(runs)] == labels


def test_vector_formats_are_repeatable_and_leave_the_users_settings(tmp_path):
    import matplotlib

    before, log = matplotlib.rcParams["font.size"], made_up_log(tmp_path / "log.mcap", count=100)
    files, again = (draw_run(log, tmp_path / name, formats=["svg", "pdf", "svg"]) for name in "ab")
    assert [path.suffix for path in files] == [".svg", ".pdf"]
    text = files[0].read_text(encoding="utf-8")
    assert 'id="joint_1.link_position.0"' in text
    assert "deflection (rad)" in text
    assert files[1].read_bytes().startswith(b"%PDF")
    assert [path.read_bytes() for path in files] == [path.read_bytes() for path in again]
    assert matplotlib.rcParams["font.size"] == before


def test_chosen_quantities_get_a_row_each(tmp_path):
    log = made_up_log(tmp_path / "log.mcap", joints=2, count=100)
    quantities = ("position_error", "link_velocity")
    files = plot(PlotJob(logs=(log,), folder=tmp_path, quantities=quantities, joints=("joint_2",), formats=("svg",))).files
    text = files[0].read_text(encoding="utf-8")
    assert set(re.findall(r'id="(joint_\d\.\w+)\.0"', text)) == {"joint_2.position_error", "joint_2.link_velocity"}


def test_odd_names_and_numbers_can_be_drawn(tmp_path):
    from dataclasses import replace

    joints = (replace(INFO.joints[0], name="a $x$ {b"), *INFO.joints[1:])
    info = replace(INFO, joints=joints, variant="$soft$", robot="two $arms$")
    with LogWriter(tmp_path / "log.mcap", info) as log:
        log.write(example_samples(300, info=info, bodies=("box",), contacts=("box/robot",)))
    names = [path.name for path in draw_run(tmp_path / "log.mcap", tmp_path)]
    assert "objects.png" in names


def test_an_object_with_the_name_of_a_joint_is_drawn_apart(tmp_path):
    with LogWriter(tmp_path / "log.mcap", INFO) as log:
        log.write(example_samples(50, bodies=("shoulder",)))
    pages = run_pages([read_curves(tmp_path / "log.mcap")])
    lines = [line.get_gid() for page in pages for axes in page.figure.axes for line in axes.get_lines() if line.get_gid()]
    assert [lines.count(name) for name in ("shoulder.link_position.0", "shoulder (body).dx.0")] == [1, 1]


def test_objects_and_tip_are_drawn_from_where_they_started(tmp_path):
    run = read_curves(simulated_log("box_push_5dof", tmp_path / "log.mcap", variant="stiff", duration=0.05))
    assert {body.name for body in run.bodies} == {"box", "tip"}
    values = {key: curve.values for key, curve in run.curves.items()}
    assert values["box", "dx"][0] == values["box", "dy"][0] == 0.0
    apart = [values["tip", f"d{axis}"] - values["tip", f"reference_{axis}"] for axis in "xyz"]
    assert values["tip", "error"].max() == pytest.approx(np.linalg.norm(apart, axis=0).max(), rel=0.05)


def test_a_truncated_log_is_drawn_as_far_as_it_goes(tmp_path):
    whole = made_up_log(tmp_path / "log.mcap", count=30_000).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    run = read_curves(cut)
    assert run.status == "truncated"
    assert 1000 < run.samples < 30_000
    assert draw_run(cut, tmp_path / "cut")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"quantities": ("stifness",)}, "Did you mean 'stiffness'"),
        ({"joints": ("joint_9",)}, "joint_1"),
        ({"formats": ("bmp",)}, "png, pdf, svg"),
        ({"start": 7.0}, "in that time"),
    ],
)
def test_bad_requests_say_what_there_is(tmp_path, options, words):
    log = made_up_log(tmp_path / "log.mcap", count=50)
    with pytest.raises(InputError, match=words):
        plot(PlotJob(logs=(log,), folder=tmp_path, **options))


@pytest.fixture(scope="module")
def half_driven(tmp_path_factory):
    """Log of an arm with an SEA in the shoulder and no motor in the elbow."""
    folder = tmp_path_factory.mktemp("half")
    arm = make_scenario(EXAMPLES / "urdf" / "plain_arm.urdf", duration=0.01, actuators={"shoulder": "sea"})
    return run(arm, out=folder).log


@pytest.mark.parametrize("quantity", ["motor_1_position", "deflection", "reference_position"])
def test_a_quantity_that_only_other_joints_have_is_an_error_that_names_them(half_driven, tmp_path, quantity):
    said = f"joint 'elbow' has no quantity '{quantity}'; shoulder has it"
    job = PlotJob(logs=(half_driven,), folder=tmp_path / "out", joints=("elbow",), quantities=("link_position", quantity))
    with pytest.raises(InputError, match=said):
        plot(job)
    assert not job.folder.exists()
    assert plot(replace(job, joints=("shoulder", "elbow"))).files


def test_a_derived_quantity_that_no_joint_has_is_an_error(tmp_path):
    """An arm without motors has no springs."""
    log = run(make_scenario(EXAMPLES / "urdf" / "plain_arm.urdf", duration=0.01), out=tmp_path).log
    with pytest.raises(InputError, match=r"joints 'shoulder', 'elbow' have no quantity 'deflection'$"):
        plot(PlotJob(logs=(log,), folder=tmp_path, quantities=("deflection",)))


def test_a_part_of_a_run_is_drawn_alone(tmp_path):
    log = made_up_log(tmp_path / "log.mcap")
    run = read_curves(log, start=0.2, end=0.5)
    time = run.get("joint_1", "link_position").time
    assert (time[0], time[-1]) == pytest.approx((0.2, 0.5))
    for end in (0.5, 99.0):
        source = CurveSource(log, end=end)
        assert source.span(0.0) == pytest.approx((0.0, min(end, source.reader.duration)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("lasting", "flattens"), [(0.002, False), (0.004, True)])
def test_a_peak_shorter_than_a_quarter_percent_is_cut_off(sign, lasting, flattens):
    """The peak lasts for 2 or 4 ms of a second, and has half of the samples."""
    time = np.concatenate([np.linspace(0.0, lasting, 5000, endpoint=False), np.linspace(lasting, 1.0, 5000)])
    axes = new_figure(4, 4).subplots()
    show_values(axes, [Curve(time=time, values=sign * np.where(time < lasting, 50.0, np.sin(9.0 * time)))], brief=True)
    assert (np.abs(axes.get_ylim()).max() > 50.0) == flattens
    assert len(axes.texts) == (not flattens)
