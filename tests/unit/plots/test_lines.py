"""What stands in a picture: every line against the numbers that it was made of, of its own run, joint and object."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.metrics.frequency import FrequencyResponse
from asrsim.plots import Curve, read_curves, style
from asrsim.plots.bode import bode_figure, pair_in_words
from asrsim.plots.figures import run_pages
from asrsim.plots.limits import panel_limits
from asrsim.plots.responses import Response
from asrsim.samples import JointInfo
from support.plot_example import made_up_log, simulated_log

TIME = np.linspace(0.0, 1.0, 21)


def curves(slopes):
    return {key: Curve(time=TIME, values=slope * TIME) for key, slope in slopes.items()}


def test_every_line_is_the_curve_of_its_name(tmp_path):
    scales = {"soft": 1.0, "stiff": 0.7}
    time = np.arange(1001) * 0.001
    values = {
        name: {"stiffness": 10.0 + scale * time, "link_torque": scale * np.sin(9 * time), "external_torque": scale * time}
        for name, scale in scales.items()
    }
    runs = [
        read_curves(made_up_log(tmp_path / name / "log.mcap", variant=name, joints=2, values=values[name])) for name in scales
    ]
    seen = set()
    for page in run_pages(runs):
        for axes in page.figure.axes:
            for line in axes.get_lines():
                joint, quantity, number = (line.get_gid() or "..").split(".")[:3]
                if not joint or quantity not in style.KNOWN:
                    continue
                curve = runs[int(number)].get(joint, quantity)
                assert curve is not None
                np.testing.assert_array_equal(line.get_xdata(), curve.time)
                np.testing.assert_array_equal(line.get_ydata(), curve.values)
                shared = quantity.startswith("reference") and number == "0"
                assert shared or line.get_color() == style.variant_colour(int(number))
                seen.add((joint, quantity, number))
        assert [axes.get_xlabel() for axes in page.figure.axes].count("time (s)") == 2
    wanted = {"link_position", "link_torque", "stiffness", "external_torque", "motor_1_position", "motor_2_position"}
    assert {(joint, name, str(n)) for joint in ("joint_1", "joint_2") for name in wanted for n in (0, 1)} <= seen


@pytest.mark.parametrize(("scenario", "drawn"), [("step_1dof_sea", False), ("step_2dof", True)])
def test_an_equilibrium_that_is_the_motors_position_is_not_drawn(tmp_path, scenario, drawn):
    (page, *_) = run_pages([read_curves(simulated_log(scenario, tmp_path / "log.mcap", variant="soft"))])
    lines = [line.get_gid().split(".")[1] for axes in page.figure.axes for line in axes.get_lines() if line.get_gid()]
    assert ("equilibrium_position" in lines, "motor_1_position" in lines) == (drawn, True)


def test_objects_are_drawn_run_by_run_and_a_goal_once(tmp_path):
    run = read_curves(made_up_log(tmp_path / "log.mcap"))
    moved = {"dx": 1.0, "dy": 2.0, "dz": 3.0}
    goal = {"reference_x": 1.1, "reference_y": 2.1, "reference_z": 3.1}
    bodies = tuple(JointInfo(name=name, actuator="", mode=None) for name in ("box", "tip"))
    runs = []
    for label, scale in (("soft", 1.0), ("stiff", 5.0)):
        own = {key: scale * slope for key, slope in moved.items()}
        found = {("box", key): one for key, one in curves({**own, "force": 7.0 * scale}).items()}
        found |= {("tip", key): one for key, one in curves({**own, "error": scale, **goal}).items()}
        runs.append(replace(run, label=label, bodies=bodies, curves={**run.curves, **found}))
    for drawn in (runs[:1], runs):
        pages = [page.figure for page in run_pages(drawn, brief=True) if page.name.startswith("objects")]
        lines = {line.get_gid(): line for page in pages for axes in page.axes for line in axes.get_lines() if line.get_gid()}
        assert len(lines) == len(drawn) * (4 + 4) + 3  # box, tip, and the goal of the first run
        for gid, line in lines.items():
            body, key, number = gid.split(".")
            np.testing.assert_array_equal(line.get_ydata(), drawn[int(number)].get(body, key).values)
            own = style.variant_colour(int(number)) if len(drawn) > 1 else style.colour(key)
            assert line.get_color() == (style.colour(key) if key.startswith("reference") else own)
        labels = {axes.get_ylabel() for page in pages for axes in page.axes if axes.get_ylabel()}
        assert labels == {"displacement (m)", "contact force (N)", "distance to the goal\n(m)"}


def response(coherence, *, experiment=False, scale=1.0):
    count = len(coherence)
    gain = scale * np.array([1.0, 10.0, 0.1, 0.5][:count])
    found = FrequencyResponse(
        frequency=np.array([1.0, 2.0, 4.0, 8.0][:count]), gain=gain, phase=np.array([0.0, -90.0, -120.0, -170.0][:count]),
        coherence=np.array(coherence), gain_low=gain / 2, gain_high=gain * 2, phase_margin=np.full(count, 20.0),
        band=(1.0, 8.0), resonance=(2.0, 10.0), bandwidth=None,
        moves=True,
    )  # fmt: skip
    joint = JointInfo(name="elbow", actuator="sea", mode=5, motors=1, quantities=("link_position",))
    return Response(joint=joint, label="soft", variant=0, source="lab.csv", experiment=experiment, unit="rad/(N m)",
                    output="link_position", response=found)  # fmt: skip


def test_a_gain_of_10_at_a_resonance_is_20_decibels():
    rows = {row.measure: (row.value, row.unit) for row in response([0.95, 0.5, 0.6]).rows()}
    assert np.isnan(rows.pop("bandwidth")[0])
    assert rows == {"resonance": (2.0, "Hz"), "resonance_gain": (20.0, "dB re rad/(N m)"), "median_coherence": (0.6, "")}


def test_a_bode_plot_reaches_to_the_end_of_the_band_and_is_dotted_where_the_coherence_is_low():
    """Gains of 1, 10, 0.1 and 0.5 are 0, 20, -20 and -6.02 dB; a coherence below a half is not to be trusted."""
    figure = bode_figure([response([0.95, 0.5, 0.6, 0.49])], title="title")
    gain, phase, coherence = figure.axes[:3]
    assert [axes.get_ylabel() for axes in (gain, phase, coherence)] == ["gain\n(dB re rad/(N m))", "phase (°)", "coherence"]
    for axes, wanted in ((gain, [0.0, 20.0, -20.0, 20 * np.log10(0.5)]), (phase, [0.0, -90.0, -120.0, -170.0])):
        trusted, faint = axes.get_lines()[:2]
        np.testing.assert_allclose(trusted.get_ydata(), [*wanted[:3], np.nan], atol=1e-12)
        np.testing.assert_allclose(faint.get_ydata(), wanted, atol=1e-12)
        assert faint.get_linestyle() != trusted.get_linestyle()
        assert axes.get_ylim()[0] < min(wanted) < max(wanted) < axes.get_ylim()[1]
    np.testing.assert_array_equal(coherence.get_lines()[0].get_ydata(), [0.95, 0.5, 0.6, 0.49])
    (peak,) = (line for line in gain.get_lines() if line.get_marker() == "o")
    assert (float(peak.get_xdata()[0]), float(peak.get_ydata()[0])) == pytest.approx((2.0, 20.0))
    for axes, limits in ((gain, (-20 - 20 * np.log10(2), 20 + 20 * np.log10(2))), (phase, (-140.0, 20.0))):
        (band,) = axes.collections
        assert (band.get_datalim(axes.transData).y0, band.get_datalim(axes.transData).y1) == pytest.approx(limits)
    assert any("95%" in text.get_text() for text in phase.texts)
    # Nothing is shaded where no coherence is enough.
    assert not bode_figure([response([0.1, 0.2, 0.1, 0.49])]).axes[1].texts


def test_the_legend_of_a_bode_plot_names_each_response():
    rest = replace(response([0.9, 0.9, 0.9, 0.9], experiment=True), label="lab")
    rest = replace(rest, response=replace(rest.response, moves=False))
    figure = bode_figure([response([0.95, 0.5, 0.6, 0.49]), rest], title="title")
    legend = [text.get_text().replace("\n", " ") for text in figure.axes[0].get_legend().get_texts()]
    assert legend == ["simulation soft", "experiment lab (does not move)", "coherence below 0.5", "resonance"]
    assert len(figure.axes[2].get_lines()) == 1
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "frequency (Hz)"]
    assert figure.axes[0].get_title("left").startswith("elbow\nSeries elastic actuator, mode 5")


def test_an_overview_shows_every_joint_of_every_run(tmp_path):
    runs = [read_curves(made_up_log(tmp_path / f"{name}.mcap", joints=5, count=50, variant=name)) for name in ("soft", "stiff")]
    (page, *_) = run_pages(runs)
    shown = [axes for axes in page.figure.axes if axes.get_visible()]
    names = [f"joint_{number}" for number in range(1, 6)]
    assert [axes.get_title("left") for axes in shown] == names
    for axes, joint in zip(shown, names, strict=True):
        lines = {line.get_gid() for line in axes.get_lines()}
        assert lines == {f"{joint}.{one}" for one in ("reference_position.0", "link_position.0", "link_position.1")}
    assert [bool(axes.get_ylabel()) for axes in shown] == [True, False, False, True, False]
    assert [axes.get_xlabel() for axes in shown] == ["", "", *["time (s)"] * 3]
    legends = {text.get_text() for legend in page.figure.legends for text in legend.get_texts()}
    assert {"soft", "stiff"} <= legends


def test_the_title_of_a_bode_plot_leads_from_the_input_to_the_output():
    assert pair_in_words("equilibrium_position", None) == "from equilibrium position to link position"


URDF = (
    '<robot name="made_up">'
    '<joint name="joint_1" type="revolute"><limit lower="-0.3" upper="0.5" effort="4" velocity="1"/></joint>'
    '<joint name="joint_2" type="continuous"><limit lower="-1" upper="1" effort="0" velocity="1"/></joint></robot>'
)


def test_limits_are_those_of_the_robot_and_the_actuator(tmp_path):
    time = np.arange(1001) * 0.001
    apart = {"motor_1_position": 0.3 + 0.1 * time, "motor_2_position": -0.1 - 0.1 * time}
    run = read_curves(made_up_log(tmp_path / "log.mcap", joints=2, values=apart))
    given = {"motor_1_max_torque": 2.0, "motor_2_max_torque": 3.0, "max_deflection": 0.7}
    info = replace(run.info, urdf=URDF, resolved={**run.info.resolved, "parameters": {"joint_1": given}})
    run = replace(run, info=info)
    found = lambda joint, panel: [curve.values.tolist() for curve in panel_limits(run, joint, panel)]  # noqa: E731
    assert found("joint_1", "position") == found("joint_1", "quantity:link_position") == [[-0.3] * 2, [0.5] * 2]
    assert found("joint_1", "torque") == found("joint_1", "link_torque") == [[-4.0] * 2, [4.0] * 2]
    assert found("joint_1", "motor_torque") == [[-2.0] * 2, [2.0] * 2, [-3.0] * 2, [3.0] * 2]
    assert found("joint_1", "quantity:motor_2_torque") == [[-3.0] * 2, [3.0] * 2]
    assert found("joint_1", "velocity") == []
    assert [found("joint_2", panel) for panel in ("position", "torque", "motor_torque", "deflection")] == [[]] * 4
    upper, lower = panel_limits(run, "joint_1", "deflection")
    np.testing.assert_allclose(upper.values, 0.7 - 0.5 * (0.4 + 0.2 * upper.time), atol=1e-9)
    np.testing.assert_allclose(lower.values, -upper.values)
    # Without the motors, as in a plot of the deflection alone, the part that the preset takes is unknown.
    alone = replace(run, curves={key: curve for key, curve in run.curves.items() if "motor" not in key[1]})
    assert panel_limits(alone, "joint_1", "quantity:deflection") == []
    assert [curve.time.tolist() for curve in panel_limits(run, "joint_1", "position")] == [[0.0, 1.0]] * 2
