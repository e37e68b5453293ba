"""Pictures of runs: what is drawn, with which units and colours, into which files."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from asrsim.errors import InputError, LogError, OutputError
from asrsim.log import LogWriter
from asrsim.plots import draw_run, read_curves, style
from asrsim.plots.curves import CurveSource, distinct_labels
from asrsim.plots.figures import new_figure, objects_figure, run_pages
from asrsim.plots.job import PlotJob, plot
from asrsim.plots.limits import panel_limits
from asrsim.plots.panels import PANELS, draw_panel
from asrsim.plots.ticks import Plain
from support.log_example import INFO, example_samples
from support.plot_example import made_up_log, simulated_log


def lines(axes) -> dict[str, object]:
    return {line.get_gid(): line for line in axes.get_lines()}


def test_positions_show_link_motors_equilibrium_and_reference(tmp_path: Path):
    run = read_curves(made_up_log(tmp_path / "log.mcap"))
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["position"], [run], "joint_1")
    drawn = lines(axes)
    assert set(drawn) == {
        f"joint_1.{name}.0"
        for name in ("link_position", "motor_1_position", "motor_2_position", "equilibrium_position", "reference_position")
    }
    time, values = drawn["joint_1.link_position.0"].get_data()
    np.testing.assert_allclose(values, 0.4 * np.sin(2 * np.pi * (time - 0.05)), atol=1e-12)
    _, reference = drawn["joint_1.reference_position.0"].get_data()
    np.testing.assert_allclose(reference, 0.5 * np.sin(2 * np.pi * time), atol=1e-12)
    assert axes.get_ylabel() == "position (rad)"


@pytest.mark.parametrize(
    ("key", "label"),
    [("deflection", "deflection (rad)"), ("stiffness", "stiffness (N·m/rad)"), ("torque", "link torque (N·m)")],
)
def test_axes_carry_their_units(tmp_path: Path, key: str, label: str):
    run = read_curves(made_up_log(tmp_path / "log.mcap"))
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS[key], [run], "joint_1")
    assert axes.get_ylabel() == label


def test_an_external_torque_that_is_never_there_is_not_drawn(tmp_path: Path):
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["torque"], [read_curves(made_up_log(tmp_path / "log.mcap"))], "joint_1")
    assert list(lines(axes)) == ["joint_1.link_torque.0"]


def test_variants_differ_in_colour_and_share_their_reference(tmp_path: Path):
    runs = [read_curves(made_up_log(tmp_path / name / "log.mcap", variant=name)) for name in ("soft", "stiff")]
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["position"], runs, "joint_1")
    drawn = lines(axes)
    soft, stiff = drawn["joint_1.link_position.0"], drawn["joint_1.link_position.1"]
    assert (soft.get_color(), stiff.get_color()) == (style.VERMILION, style.BLUE)
    assert not soft.is_dashed()
    assert not stiff.is_dashed()
    assert "joint_1.reference_position.1" not in drawn


def test_colours_tell_the_quantities_of_a_panel_apart():
    for panel in PANELS.values():
        colours = [style.colour(name) for name in panel.quantities if not name.startswith("reference")]
        assert len(set(colours)) == len(colours), panel.key


def test_a_prismatic_joint_has_metres_and_an_adjuster_too(tmp_path: Path):
    with LogWriter(tmp_path / "log.mcap", INFO) as log:
        log.write(example_samples(200))
    run = read_curves(tmp_path / "log.mcap")
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["position"], [run], "slide")
    assert axes.get_ylabel() == "position (m)"
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["torque"], [run], "slide")
    assert axes.get_ylabel().startswith("link force")
    axes = new_figure(4, 3).subplots()
    assert draw_panel(axes, PANELS["adjuster"], [run], "lever") == ("reference_2", "motor_2_position")
    assert "(m)" in axes.get_ylabel()


def test_a_resting_value_is_not_blown_up(tmp_path: Path):
    values = {"stiffness": 10.0 + 1e-13 * np.sin(np.arange(1001.0))}
    run = read_curves(made_up_log(tmp_path / "log.mcap", values=values))
    axes = new_figure(4, 3).subplots()
    draw_panel(axes, PANELS["stiffness"], [run], "joint_1")
    low, high = axes.get_ylim()
    assert low < 9.5
    assert high > 10.5


def test_a_spike_of_one_sample_in_a_long_log_is_in_the_picture(tmp_path: Path):
    torque = np.zeros(60_000)
    torque[31_234] = 5.0
    run = read_curves(made_up_log(tmp_path / "log.mcap", count=60_000, values={"link_torque": torque}))
    curve = run.get("joint_1", "link_torque")
    assert curve is not None
    assert curve.values.max() == 5.0
    assert curve.time[curve.values.argmax()] == pytest.approx(31.234)
    assert len(curve.time) <= 6000
    assert run.samples == 60_000


@pytest.mark.parametrize(("joints", "pages"), [(1, 1), (3, 1), (4, 2), (14, 5)])
def test_many_joints_take_several_pages_and_an_overview(tmp_path: Path, joints: int, pages: int):
    run = read_curves(made_up_log(tmp_path / "log.mcap", joints=joints, count=50))
    names = [page.name for page in run_pages([run])]
    assert len([name for name in names if name.startswith("joints")]) == pages
    assert ("overview" in names) == (joints >= 5)


def test_an_overview_says_where_a_joint_has_another_unit_than_its_row_and_over_no_neighbour(tmp_path: Path):
    run = read_curves(made_up_log(tmp_path / "log.mcap", joints=7, count=50, sliders={2, 3, 4, 7}))
    overview = next(page for page in run_pages([run]) if page.name == "overview")
    shown = [(axes.get_ylabel(), axes.get_title(loc="left")) for axes in overview.figure.axes if axes.get_visible()]
    assert [label for label, _ in shown] == ["position (rad)", "", "", "position (m)", "", "", "position (m)"]
    titles = ["joint_1", "joint_2 (m)", "joint_3 (m)", "joint_4", "joint_5 (rad)", "joint_6 (rad)", "joint_7"]
    assert [title for _, title in shown] == titles


@pytest.mark.parametrize(("size", "labels"), [(1e-6, ["-1e-06", "0", "1e-06"]), (0.1, ["-0.1", "0.0", "0.1"])])
def test_powers_of_ten_stand_at_the_numbers_and_not_over_the_title(tmp_path: Path, size: float, labels: list[str]):
    values = {"link_torque": size * np.sin(np.linspace(0, 9, 200))}
    run = read_curves(made_up_log(tmp_path / "log.mcap", count=200, values=values))
    page = next(iter(run_pages([run], quantities=["link_torque"])))
    axes = page.figure.axes[0]
    axes.set_yticks([-size, 0.0, size])
    page.figure.canvas.draw()
    assert [label.get_text().replace("\N{MINUS SIGN}", "-") for label in axes.get_yticklabels()] == labels
    assert axes.yaxis.get_offset_text().get_text() == ""


@pytest.mark.parametrize(
    ("files", "labels"),
    [
        (["r1/soft/log", "r2/soft/log"], ["r1", "r2"]),
        (["a/log", "a/other"], ["log", "other"]),
        (["x/one/log", "x/two/deep/log"], ["one", "two/deep"]),
        (["x/log", "x/y/log"], ["soft 1", "soft 2"]),
    ],
)
def test_runs_of_one_variant_are_called_by_what_differs_in_their_paths(tmp_path: Path, files: list[str], labels: list[str]):
    runs = [read_curves(made_up_log(tmp_path / f"{file}.mcap", joints=1, variant="soft")) for file in files]
    assert [run.label for run in distinct_labels(runs)] == labels


def test_legends_lie_outside_of_the_data_and_nothing_overlaps(tmp_path: Path):
    runs = distinct_labels([read_curves(made_up_log(tmp_path / v / "log.mcap", joints=2, variant=v)) for v in ("a", "b")])
    page = next(iter(run_pages(runs)))
    page.figure.canvas.draw()
    renderer = page.figure.canvas.get_renderer()
    boxes = [axes.get_window_extent(renderer) for axes in page.figure.axes]
    texts = [axes.get_legend().get_window_extent(renderer) for axes in page.figure.axes if axes.get_legend() is not None]
    texts += [legend.get_window_extent(renderer) for legend in page.figure.legends]
    assert texts
    for text in texts:
        assert not any(text.overlaps(box) for box in boxes)
        assert page.figure.bbox.containsx(text.x1)
    titles = [axes.title.get_window_extent(renderer) if axes.get_title() else axes._left_title.get_window_extent(renderer)
              for axes in page.figure.axes[:2]]  # fmt: skip
    assert not titles[0].overlaps(titles[1])


@pytest.mark.parametrize(("low", "high"), [(5e-4, 5.01e-4), (-3e-7, 2e-7), (2e5, 2.0001e5), (0.0, 3.0), (0.0, 1e-4)])
def test_ticks_of_any_size_differ(low: float, high: float):
    axes = Figure().add_subplot()
    FigureCanvasAgg(axes.figure)
    axes.plot([0.0, 1.0], [low, high])
    axes.yaxis.set_major_formatter(Plain())
    axes.figure.canvas.draw()
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert len(labels) == len(set(labels)) > 3
    # One way of writing on one axis: 8e-05 beside 0.0001 are two.
    assert len({label.partition("e")[2] for label in labels if label != "0"}) == 1


def test_draw_run_writes_pngs_that_hold_colour(tmp_path: Path):
    from matplotlib.image import imread

    files = draw_run(made_up_log(tmp_path / "log.mcap"), tmp_path / "new" / "folder")
    assert [path.name for path in files] == ["joints.png"]
    image = imread(files[0])[:, :, :3]
    link = np.array([0xD5, 0x5E, 0x00]) / 255
    assert (np.abs(image - link).max(axis=2) < 0.02).sum() > 200


def test_vector_formats_and_the_users_settings(tmp_path: Path):
    import matplotlib

    before = matplotlib.rcParams["font.size"]
    files = draw_run(made_up_log(tmp_path / "log.mcap"), tmp_path, formats=["svg", "pdf", "svg"])
    assert [path.suffix for path in files] == [".svg", ".pdf"]
    text = files[0].read_text(encoding="utf-8")
    assert 'id="joint_1.link_position.0"' in text
    assert "deflection (rad)" in text
    assert files[1].read_bytes().startswith(b"%PDF")
    assert matplotlib.rcParams["font.size"] == before


def test_the_same_log_gives_the_same_file(tmp_path: Path):
    log = made_up_log(tmp_path / "log.mcap", count=100)
    first, second = (draw_run(log, tmp_path / name, formats=["svg"])[0].read_bytes() for name in "ab")
    assert first == second


def test_chosen_quantities_get_a_row_each(tmp_path: Path):
    log = made_up_log(tmp_path / "log.mcap", joints=2, count=100)
    quantities = ("position_error", "link_velocity")
    files = plot(PlotJob(logs=(log,), folder=tmp_path, quantities=quantities, joints=("joint_2",), formats=("svg",))).files
    text = files[0].read_text(encoding="utf-8")
    assert set(re.findall(r'id="(joint_\d\.\w+)\.0"', text)) == {"joint_2.position_error", "joint_2.link_velocity"}


def test_odd_names_and_numbers_can_be_drawn(tmp_path: Path):
    from dataclasses import replace

    joints = (replace(INFO.joints[0], name="a $x$ {b"), *INFO.joints[1:])
    info = replace(INFO, joints=joints, variant="$soft$", robot="two $arms$")
    with LogWriter(tmp_path / "log.mcap", info) as log:
        log.write(example_samples(300, info=info, bodies=("box",), contacts=("box/robot",)))
    names = [path.name for path in draw_run(tmp_path / "log.mcap", tmp_path)]
    assert "objects.png" in names


def test_objects_are_drawn_from_where_they_started(tmp_path: Path):
    run = read_curves(simulated_log("box_push_5dof", tmp_path / "log.mcap", variant="stiff", duration=0.05))
    box = run.bodies["box"]
    assert set(box) == {"dx", "dy", "dz", "force"}
    assert box["dx"].values[0] == box["dy"].values[0] == 0.0
    # The tip is no object that something pushes: it is drawn with its goal, and how far it is from it.
    assert set(run.bodies) == {"box", "tip"}
    tip = run.bodies["tip"]
    assert set(tip) == {"dx", "dy", "dz", "goal_x", "goal_y", "goal_z", "error"}
    apart = [tip[f"d{axis}"].values - tip[f"goal_{axis}"].values for axis in "xyz"]
    assert tip["error"].values.max() == pytest.approx(np.linalg.norm(apart, axis=0).max(), rel=0.05)
    figure = objects_figure([run])
    assert [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()].count("distance to the goal (m)") == 1


def test_a_truncated_log_is_drawn_as_far_as_it_goes(tmp_path: Path):
    whole = made_up_log(tmp_path / "log.mcap", count=30_000).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    run = read_curves(cut)
    assert run.status == "truncated"
    assert 1000 < run.samples < 30_000
    assert draw_run(cut, tmp_path / "cut")


def test_bad_requests_say_what_there_is(tmp_path: Path):
    log = made_up_log(tmp_path / "log.mcap", count=50)
    with pytest.raises(LogError, match="Did you mean 'stiffness'"):
        plot(PlotJob(logs=(log,), folder=tmp_path, quantities=("stifness",)))
    with pytest.raises(LogError, match="joint_1"):
        plot(PlotJob(logs=(log,), folder=tmp_path, joints=("joint_9",)))
    with pytest.raises(InputError, match="png, pdf, svg"):
        draw_run(log, tmp_path, formats=["bmp"])
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot make the folder"):
        draw_run(log, tmp_path / "file")


def shown(name: str, values: np.ndarray, tmp_path: Path, panel: str = "torque"):
    axes = new_figure(6, 3).subplots()
    log = made_up_log(tmp_path / "log.mcap", values={name: values}, count=len(values))
    draw_panel(axes, PANELS[panel], [read_curves(log)], "joint_1")
    return axes


def test_one_sample_does_not_flatten_a_panel_but_is_told(tmp_path: Path):
    torque = np.sin(np.arange(2000) * 0.01)
    torque[1234] = 128.0
    axes = shown("link_torque", torque, tmp_path)
    assert axes.get_ylim()[1] < 3.0
    assert [text.get_text() for text in axes.texts] == ["▲ 128"]
    # A step's transient is the story, however long the run.
    torque = np.zeros(20_000)
    torque[1000:1300] = np.sin(np.arange(300) * 0.1)
    axes = shown("link_torque", torque, tmp_path)
    assert axes.get_ylim()[1] > 0.99
    assert not axes.texts


@pytest.mark.parametrize("kind", ["noise", "fast", "alternating"])
def test_a_thousand_samples_are_a_line_whatever_they_do(tmp_path: Path, kind: str):
    count = np.arange(999)
    values = {
        "noise": np.random.default_rng(1).normal(size=999),
        "fast": np.sin(2 * np.pi * 0.47 * count),
        "alternating": (-1.0) ** count,
    }[kind]
    axes = shown("link_torque", values, tmp_path)
    assert not axes.collections
    assert np.isfinite(lines(axes)["joint_1.link_torque.0"].get_ydata()).all()


def test_an_encoder_that_flickers_at_rest_between_steps_stays_a_line(tmp_path: Path):
    time = np.arange(651) * 0.01
    count = 2 * np.pi / 4096
    rng = np.random.default_rng(3)
    values = np.where(time > 3.5, 0.6, 0.0) + count * np.round(rng.random(651))
    assert not shown("link_torque", values, tmp_path).collections


def test_an_envelope_ends_where_a_step_begins(tmp_path: Path):
    """A step beside a fast stretch is a line of its own: no wedge leads from the one to the other."""
    time = np.arange(651) * 0.01
    fast = np.where(time < 3.4, 0.05 * (-1.0) ** np.arange(651), 0.0)
    axes = shown("link_torque", fast + np.where(time >= 3.45, 1.0, 0.0), tmp_path)
    for envelope in axes.collections:
        assert np.abs(envelope.get_paths()[0].vertices[:, 1]).max() < 0.06


def test_limits_are_drawn_where_the_motion_comes_near_them(tmp_path: Path):
    log = simulated_log("step_2dof", tmp_path / "log.mcap", variant="stiff", duration=0.3)
    run = read_curves(log)
    axes = new_figure(6, 3).subplots()
    assert "limit" in draw_panel(axes, PANELS["motor_torque"], [run], "joint_1")
    found = {float(line.get_ydata()[0]) for gid, line in lines(axes).items() if "limit" in gid}
    limit = run.info.resolved["parameters"]["joint_1"]["motor_1_max_torque"]
    assert found
    assert found <= {-limit, limit}
    most = run.info.resolved["parameters"]["joint_1"]["max_deflection"]
    edge, _ = panel_limits(run, "joint_1", "deflection")
    one, two = (np.interp(0.25, *(lambda c: (c.time, c.values))(run.get("joint_1", f"motor_{n}_position"))) for n in (1, 2))
    assert np.interp(0.25, edge.time, edge.values) == pytest.approx(most - abs(one - two) / 2, abs=1e-3)


def test_a_part_of_a_run_is_drawn_alone(tmp_path: Path):
    log = made_up_log(tmp_path / "log.mcap")
    run = read_curves(log, start=0.2, end=0.5)
    time = run.get("joint_1", "link_position").time
    assert (time[0], time[-1]) == pytest.approx((0.2, 0.5))
    for end in (0.5, 99.0):
        source = CurveSource(log, end=end)
        assert source.span(0.0) == pytest.approx((0.0, min(end, source.reader.duration)))
    with pytest.raises(LogError, match="in that time"):
        read_curves(log, start=7.0)


def test_stiffness_and_adjuster_have_letters_of_their_own():
    from asrsim.plots.legends import _WORDS, _entry

    assert _entry("stiffness") == "stiffness k"
    assert "\u03c3" not in "".join(_WORDS.values())


def test_a_run_of_many_joints_draws_overview_and_first_page(tmp_path: Path):
    run = read_curves(made_up_log(tmp_path / "log.mcap", joints=9, count=50))
    assert [page.name for page in run_pages([run], brief=True)] == ["overview", "joints_1"]


def test_a_run_of_four_joints_has_no_overview_and_draws_all_of_them(tmp_path: Path):
    run = read_curves(made_up_log(tmp_path / "log.mcap", joints=4, count=50))
    assert [page.name for page in run_pages([run], brief=True)] == ["joints_1", "joints_2"]


def test_all_pages_are_drawn_unless_few_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    log, asked = made_up_log(tmp_path / "log.mcap", joints=1, count=50), []
    monkeypatch.setattr("asrsim.plots.run.run_pages", lambda runs, **how: asked.append(how["brief"]) or [])
    for draw in (
        lambda: draw_run(log, tmp_path),
        lambda: draw_run(log, tmp_path, brief=True),
    ):
        assert draw() == []
    assert asked == [False, True]


def test_claims_about_objects_are_judged_from_the_log(tmp_path: Path):
    from asrsim.log import open_log
    from asrsim.plots.claims import logged_claims

    info = open_log(simulated_log("box_push_5dof", tmp_path / "log.mcap", variant="stiff", duration=0.02)).info
    assert {claim.body for claim in logged_claims(info, tmp_path)} == {"box"}


def test_line_styles_can_be_told_apart_in_a_legend():
    """Dashes and gaps are some points long, and no two styles alike: a handle of a legend, 28 points, shows each whole."""
    dashes = [pattern[1] for pattern in style.LINE_STYLES if pattern != "-"]
    assert len(set(dashes)) == len(dashes) == len(style.LINE_STYLES) - 1
    for pattern in dashes:
        assert all(1.0 <= length <= 8.0 for length in pattern)
        assert sum(pattern) <= 28.0


def test_a_new_figure_is_drawn_into_memory_and_unknown_to_pyplot() -> None:
    figure = new_figure(2.0, 1.0)
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())
    assert pixels.shape[1] == 2 * pixels.shape[0] == round(2.0 * figure.dpi)
    assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("samples", "flattens"), [(4, False), (8, True)])
def test_what_lasts_a_quarter_of_a_percent_of_the_time_is_in_view_above_as_below(
    tmp_path: Path, sign: float, samples: int, flattens: bool
) -> None:
    torque = np.sin(np.arange(2000) * 0.01)
    torque[700 : 700 + samples] = sign * 50.0
    axes = shown("link_torque", torque, tmp_path)
    assert (np.abs(axes.get_ylim()).max() > 50.0) == flattens
    assert len(axes.texts) == (not flattens)
