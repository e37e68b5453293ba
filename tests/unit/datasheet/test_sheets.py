"""Numbers of data sheets against closed forms (SEA) and integrations of our own (qbMove); files of `asrsim datasheet`."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import asrsim
from asrsim.actuators import ACTUATORS
from asrsim.datasheet import make_sheet, measured_curve, sources_of, write_sheets
from asrsim.datasheet.page import common_charts
from asrsim.datasheet.picture import save_comparison, save_sheet
from asrsim.datasheet.published import PUBLISHED
from asrsim.datasheet.statics import Statics
from asrsim.datasheet.trials import BAND
from asrsim.errors import InputError, RecordingError
from asrsim.plots.chart import Line
from asrsim.robot.tags import tag_parameters
from support.overlaps import outside, overlapping
from support.paths import ROOT

SEA = """<?xml version="1.0"?>
<robot name="r"><link name="w"/><joint name="j" type="revolute"><parent link="w"/><child link="l"/><axis xyz="0 1 0"/>
<limit effort="5" velocity="9" lower="-1" upper="1"/></joint>
<link name="l"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<gazebo><plugin name="p" filename="libsea_plugin.so"><joint>j</joint><operation_mode>6</operation_mode>
<spring_k>20</spring_k><max_def>0.4</max_def><mot_tauMax>7</mot_tauMax><mot_D>0.5</mot_D><mot_tauFric>0.1</mot_tauFric>
<mot_maxVel>inf</mot_maxVel><mot_minPos>-1.5</mot_minPos><mot_maxPos>2</mot_maxPos><hyst_tau>0.05</hyst_tau>
<thermal_resistance>4</thermal_resistance><winding_heat>1.5</winding_heat>
</plugin></gazebo></robot>"""


@pytest.fixture(scope="module")
def sea(tmp_path_factory):
    path = tmp_path_factory.mktemp("sea") / "r.urdf"
    path.write_text(SEA)
    (source,) = sources_of([str(path)])
    return make_sheet(source, inertia=0.05)


@pytest.fixture(scope="module")
def qbmove():
    (source,) = sources_of(["qbmove"])
    return make_sheet(source)


def value(sheet, key):
    assert sheet.entry(key).known, sheet.entry(key)
    return sheet.entry(key).value


def test_what_a_sheet_does_not_state_names_the_tags_that_would(qbmove, sea):
    """Each tag once, all of the actuator or of a joint in a URDF."""
    for sheet, actuator in ((qbmove, "qbmove"), (sea, "sea")):
        tags = {*tag_parameters(ACTUATORS.get(actuator)), "inertial", "limit", "dynamics"}
        for entry in sheet.entries:
            named = re.findall(r"<(\w+)>", entry.how)
            assert {*named} <= tags, entry.how
            assert len(named) == len({*named}), entry.how
    assert qbmove.entry("rotation").how == "not stated: <mot_1_minPos> and <mot_1_maxPos>, or the joint's limits"


@pytest.mark.parametrize(("key", "expected"), [
    ("peak_torque", 5.0),                      # the joint's effort limit, below the motor's 7 and the spring's 20 x 0.4
    ("nominal_torque", math.sqrt((80.0 - 25.0) / (4.0 * 1.5))),  # 55 K above the surroundings
    ("top_speed", (7.0 - 0.1) / 0.5), ("stiffness_min", 20.0), ("stiffness_max", 20.0), ("stiffness_loaded", 20.0),
    ("power", max((6.9 - 0.5 * w) * w for w in np.linspace((6.9 - 5.0) / 0.5, 13.8, 100_001))),
    ("deflection_soft", 5.0 / 20.0), ("energy", 0.5 * 5.0**2 / 20.0), ("rotation", 2.0), ("hysteresis", 0.1),
    ("nominal_power", (math.sqrt(55.0 / 6.0) - 0.1) ** 2 / (4 * 0.5)),  # w (tau - 0.1 - 0.5 w) for ever
    ("nominal_speed", (math.sqrt(55.0 / 6.0) - 0.1) / (2 * 0.5)),
])  # fmt: skip
def test_numbers_of_an_sea_are_its_closed_forms(sea, key, expected):
    assert value(sea, key) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("seed", range(20))
def test_numbers_of_random_seas_are_their_closed_forms(seed):
    """Spring, motor with a winding, and joint, each of which may be the limit."""
    draw = np.random.default_rng(seed)
    k, limit, most, effort, constant, ohms, volts, drag, friction, heat = np.exp(
        draw.uniform(np.log([2, 0.05, 1, 1, 1, 0.1, 10, 0.01, 0.01, 0.1]), np.log([500, 1, 80, 80, 8, 2, 60, 1, 0.3, 9]))
    )
    motor = {
        "max_torque": most,
        "torque_constant": constant,
        "resistance": ohms,
        "max_voltage": volts,
        "damping": drag,
        "friction_torque": friction,
        "max_velocity": math.inf,
    }
    values = {"spring_stiffness": k, "max_deflection": limit, "thermal_resistance": heat, "winding_heat": 1.0}
    (source,) = sources_of(["sea"])
    values |= {f"motor_1_{name}": one for name, one in motor.items()}
    statics = Statics(drive=replace(source.drive, values={**source.drive.values, **values}), effort=effort)
    torque = min(k * limit, most, effort, constant / ohms * volts)
    assert statics.peak_torque == pytest.approx(torque, rel=1e-6)
    assert statics.reach(0.0) == pytest.approx(torque / k, rel=1e-6)
    assert statics.peak_energy == pytest.approx(torque**2 / (2 * k), rel=1e-6)
    assert statics.lasting.peak_torque == pytest.approx(min(torque, math.sqrt(55.0 / heat)), rel=1e-6)
    # Where the voltage, or the torque, ends at damping and friction.
    top = min((constant * volts / ohms - friction) / (drag + constant**2 / ohms), (most - friction) / drag)
    assert statics.top_speed == pytest.approx(top, rel=1e-6)
    speed = np.linspace(0.0, top, 200_001)
    drive = np.minimum(most, constant * (volts - constant * speed) / ohms) - drag * speed - friction
    assert statics.best_power()[0] == pytest.approx(float(np.max(np.minimum(drive, torque) * speed)), rel=1e-4)


def test_either_motor_of_equal_springs_limits_preset_and_deflection():
    """The springs pull the two motors in opposite directions."""
    (source,) = sources_of(["qbmove"])
    first, second = (
        Statics(drive=replace(source.drive, values={**source.drive.values, f"motor_{i}_max_torque": 0.5})) for i in (1, 2)
    )
    whole = Statics(drive=source.drive).highest_preset
    assert first.highest_preset == pytest.approx(second.highest_preset)
    assert second.highest_preset < 0.9 * whole


def test_the_bandwidth_of_an_sea_is_that_of_its_transfer_function(sea):
    k, kp, kd, inertia, motor, drag = 20.0, 125.0, 4.5, 0.05, 0.0233, 0.5
    damping = 2 * 0.2 * math.sqrt(20.0 * 0.05)

    def gain(frequency):
        s = 2j * math.pi * frequency
        link = inertia * s**2 + damping * s + k
        return abs(kp * k / ((motor * s**2 + (drag + kd) * s + kp + k) * link - k * k)) - gain.rest / math.sqrt(2)

    gain.rest = 0.0
    gain.rest = gain(1e-6)
    peak = math.sqrt(k / inertia) / (2 * math.pi)
    assert value(sea, "bandwidth_soft") == pytest.approx(brentq(gain, peak, 20 * peak), rel=0.01)


def test_what_the_file_does_not_state_is_empty_with_its_tag(sea, qbmove):
    for sheet, key, tag in (
        (sea, "voltage", "<mot_voltMax>"),
        (qbmove, "rotation", "<mot_1_minPos>"),
        (qbmove, "hysteresis", "<hyst_tau>"),
    ):
        assert not sheet.entry(key).known
        assert tag in sheet.entry(key).how
    # JSON has no infinite numbers.
    assert replace(sea.entry("voltage"), value=math.inf).as_dict()["value"] is None
    assert "does not apply" in sea.entry("change_free").how
    with pytest.raises(KeyError):
        sea.entry("colour")


def test_a_number_says_whether_it_is_a_closed_form_simulated_or_stated(sea, qbmove):
    numbers = qbmove.as_dict()["numbers"]
    assert [numbers[key]["found"] for key in ("peak_torque", "change_free", "voltage")] == ["closed form", "simulation", None]
    assert sea.as_dict()["numbers"]["change_free"]["found"] is None


A, K, LIMIT, MOTOR, DRAG, KP, KD, FRICTION, BRISTLES = 8.9992, 0.0019, 0.8, 0.0233, 0.2698, 125.0, 4.5, 0.02, 1000.0


def test_static_numbers_of_qbmove_are_those_of_its_law(qbmove):
    assert value(qbmove, "stiffness_min") == pytest.approx(2 * A * K, rel=1e-9)
    assert value(qbmove, "stiffness_max") == pytest.approx(2 * A * K * math.cosh(A * 0.6), rel=1e-9)
    assert value(qbmove, "peak_torque") == pytest.approx(2 * K * math.sinh(A * LIMIT), rel=1e-9)
    assert value(qbmove, "energy") == pytest.approx(2 * K / A * (math.cosh(A * LIMIT) - 1), rel=1e-9)
    assert value(qbmove, "deflection_stiff") == pytest.approx(LIMIT - 0.6, abs=1e-9)


def test_the_time_to_change_stiffness_is_that_of_an_integration_of_our_own(qbmove):
    def slope(_, y):  # one motor; the other mirrors it, and the link stays in the middle
        theta, speed, anchor = y
        torque = min(max(KP * (0.6 - theta) - KD * speed, -6.0), 6.0)
        bristle = BRISTLES * (theta - anchor)
        slip = speed if bristle * speed > 0 and abs(bristle) >= FRICTION else 0.0
        pull = torque - DRAG * speed - K * math.sinh(A * theta) - min(max(bristle, -FRICTION), FRICTION)
        return [speed, pull / MOTOR if abs(speed) < 6.0 or pull * speed < 0 else 0.0, slip]

    found = solve_ivp(slope, (0, 1.8), np.zeros(3), max_step=2e-4, rtol=1e-7, atol=1e-10)
    stiffness = 2 * A * K * np.cosh(A * np.clip(found.y[0], -LIMIT, LIMIT))
    last = float(np.mean(stiffness[found.t > 1.7]))
    off = np.flatnonzero(np.abs(stiffness - last) > BAND * (last - 2 * A * K))[-1]
    assert value(qbmove, "change_free") == pytest.approx(found.t[off], rel=0.01)


def test_the_bandwidth_of_qbmove_is_that_of_an_integration_of_our_own(qbmove, tmp_path):
    frequency = value(qbmove, "bandwidth_soft")
    load = qbmove.entry("bandwidth_soft").how
    inertia, damping = float(load.split("load of ")[1].split()[0]), float(load.split("and ")[1].split()[0])
    omega, small = 2 * math.pi * frequency, 1e-4

    def slope(t, y):
        q, v, theta, speed = y
        spring = K * math.sinh(A * (theta - q))
        motor = KP * (small * math.sin(omega * t) - theta) - (KD + DRAG) * speed - spring
        return [v, (2 * spring - damping * v) / inertia, speed, motor / MOTOR]

    found = solve_ivp(slope, (0, 14 / frequency), np.zeros(4), rtol=1e-9, atol=1e-13, max_step=0.03 / frequency)
    settled = found.y[0, found.t > 10 / frequency]
    assert np.ptp(settled) / 2 / small == pytest.approx(1 / math.sqrt(2), rel=0.01)


def test_the_claims_of_the_scenario_beside_the_sheet_are_its_simulated_numbers(qbmove, tmp_path):
    for name, text in qbmove.files.items():
        (tmp_path / name).write_text(text)
    for key in ("free", "loaded"):
        (claim,) = asrsim.run(tmp_path / "qbmove.yaml", variant=f"stiffness_{key}").summary.claims
        assert claim.holds
        assert value(qbmove, f"change_{key}") == pytest.approx(claim.measured, rel=1e-9)


def test_the_largest_energy_of_awas_ii_is_where_the_motor_holds_the_spring_at_its_limit():
    """There, k sin(d) cos(d) is 6 N m, so that k sin(d)^2 / 2 is 3 tan(d) J, at d = 0.3 rad."""
    (source,) = sources_of(["awas_ii"])
    assert Statics(drive=source.drive).peak_energy == pytest.approx(3.0 * math.tan(0.3), rel=1e-4)


def test_a_sheet_with_the_published_constants_of_walk_mans_motor_has_its_published_torque():
    """Malzahn, Roozing (2016): 24 V, 40 A, 0.0453 N m/A, 0.0885 ohm, gear 100: 181 N m; the voltage ends at 5.3 rad/s."""
    (source,) = sources_of(["sea"])
    constants = {"torque_constant": 0.0453, "resistance": 0.0885, "gear_ratio": 100.0, "max_voltage": 24.0, "max_current": 40.0}
    motor = {"max_torque": 1e3, "damping": 0.0, "friction_torque": 0.0, "max_velocity": math.inf, **constants}
    values = {**source.drive.values, "spring_stiffness": 1e4, **{f"motor_1_{name}": one for name, one in motor.items()}}
    statics = Statics(drive=replace(source.drive, values=values))
    assert statics.peak_torque == pytest.approx(181.2, rel=1e-9)
    assert statics.top_speed == pytest.approx(24.0 / 4.53, rel=1e-9)


def test_the_loaded_change_of_stiffness_is_under_the_nominal_torque_where_every_setting_holds_it():
    (source,) = sources_of([str(ROOT / "examples/plugins/my_vsa.py")])
    warm = replace(
        source,
        stated=(stated := {"thermal_resistance": 20.0, "winding_heat": 1.0}),
        drive=replace(source.drive, values={**source.drive.values, **stated}),
    )
    sheet = make_sheet(warm)
    lasting = math.sqrt((80.0 - 25.0) / (20.0 * 1.0))  # of each motor, held at rest by both together
    assert value(sheet, "nominal_torque") == pytest.approx(2 * lasting, rel=1e-4)
    assert f"under {2 * lasting:.3g} N m (the nominal torque)" in sheet.entry("change_loaded").how


def test_presets_beyond_the_springs_or_without_effect_are_refused():
    for target, presets, text in (
        ("qbmove", (0.0, 2.0), "below 0.8 rad"),
        ("awas_ii", (0.01, 0.06), "below 0.05 m"),
        ("sea", (0.0, 0.1), "does not change the stiffness"),
    ):
        (source,) = sources_of([target])
        with pytest.raises(InputError, match=text):
            make_sheet(source, presets=presets)


def test_the_usual_presets_stay_within_the_limits_that_a_robot_states():
    """A lever of AwAS-II shorter than its usual adjuster position, and cams of half the usual deflection."""
    for name, values in (("awas_ii", {"lever_length": 0.03}), ("quadratic_cam", {"max_deflection": 0.4})):
        (source,) = sources_of([name])
        statics = Statics(drive=replace(source.drive, values={**source.drive.values, **values}))
        low, high = statics.presets
        assert 0.0 < low < high < next(iter(values.values()))
        assert statics.reach(high) > 0.0


def test_the_slower_of_two_motors_limits_the_speed():
    (source,) = sources_of(["qbmove"])
    values = {"motor_1_max_velocity": 3.0, "motor_2_max_velocity": 2.0}
    for given in (values, dict(zip(values, reversed(values.values()), strict=True))):
        assert Statics(drive=replace(source.drive, values={**source.drive.values, **given})).top_speed == 2.0


def test_a_sliding_joint_has_newtons_and_metres(tmp_path, qbmove):
    (tmp_path / "r.urdf").write_text(SEA.replace("revolute", "prismatic"))
    (source,) = sources_of([str(tmp_path / "r.urdf")])
    sheet = make_sheet(source)
    units = [sheet.entry(key).unit for key in ("peak_torque", "top_speed", "stiffness_min", "deflection_soft")]
    assert units == ["N", "m/s", "N/m", "m"]
    assert 'type="prismatic"' in sheet.files["r_j.urdf"]
    with pytest.raises(InputError, match="their units differ"):
        write_sheets([sheet, qbmove], tmp_path, compare=True)


def test_the_command_writes_pages_numbers_and_files_that_run(tmp_path, asrsim_command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = asrsim_command("datasheet", "sea", ROOT / "examples/plugins/my_vsa.py", "--compare", "--json")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert [sheet["name"] for sheet in data["sheets"]] == ["sea", "my_vsa"]
    names = {path.name for path in (tmp_path / "datasheet").iterdir()}
    assert names >= {f"{name}.{end}" for name in ("sea", "my_vsa") for end in ("html", "png", "json", "yaml", "urdf")}
    page = (tmp_path / "datasheet/comparison.html").read_text()
    assert "my_vsa" in page
    assert " src=" not in page  # nothing is fetched
    assert asrsim_command("run", "datasheet/sea.yaml", "--no-plot").code == 0
    assert asrsim_command("datasheet", "sea").code == 0  # our own files are replaced
    (tmp_path / "datasheet/sea.yaml").write_text("mine: 1\n")
    assert asrsim_command("datasheet", "sea").code != 0
    assert "does not change the stiffness" in asrsim_command("datasheet", "sea", "--presets", 0.05, 0.35).err


@pytest.mark.parametrize("compared", [False, True])
def test_every_text_of_a_picture_is_on_its_page_and_none_covers_another(compared, qbmove, monkeypatch, tmp_path):
    """The table stands above the charts."""
    drawn = []
    monkeypatch.setattr("asrsim.datasheet.picture.save_figure", lambda figure, *_: drawn.append(figure))
    if compared:
        sheets = [qbmove, make_sheet(sources_of(["awas_ii"])[0])]
        save_comparison(tmp_path / "a.png", sheets, common_charts(sheets))
    else:
        save_sheet(tmp_path / "a.png", qbmove)
    (figure,) = drawn
    assert overlapping(figure) == []
    assert outside(figure) == []
    highest = max(axes.get_window_extent().y1 for axes in figure.axes)
    for entry in qbmove.entries:
        (text,) = [text for text in figure.texts if text.get_text() in (entry.words, f"{entry.words} ({entry.unit})")]
        assert text.get_window_extent().y0 > highest


def measured(sheet):
    """Measured deflection (n,) and torque (n,) on a sheet."""
    (line,) = [line for line in sheet.rows[0][0].lines if line.kind == "points"]
    assert isinstance(line, Line)
    return line.x, line.y


def test_measured_points_stand_beside_the_law_with_what_is_doubtful(tmp_path):
    deflection = np.linspace(-0.3, 0.3, 50)
    table = np.column_stack([np.arange(50) * 0.01, deflection, 11.0 * deflection])
    marked = table.copy()
    marked[7, 2] = -9999
    np.savetxt(tmp_path / "bench.csv", marked, delimiter=",", header="time,deflection [rad],torque [Nm]", comments="")
    (source,) = sources_of(["sea"])
    sheet = make_sheet(source, measured=[measured_curve(source, tmp_path / "bench.csv")])
    angle, torque = (np.delete(values, 7) for values in measured(sheet))
    np.testing.assert_allclose(torque, 11.0 * angle)
    (doubt,) = sheet.as_dict()["doubts"]
    assert "is -9999 in 1 sample" in doubt
    assert doubt.partition(":")[0] == "bench.csv"
    np.savetxt(tmp_path / "timeless.csv", table[:, 1:], delimiter=",", header="deflection [rad],torque [Nm]", comments="")
    curve = measured_curve(source, tmp_path / "timeless.csv", rate=1.0)
    np.testing.assert_allclose(curve.torque, 11.0 * curve.deflection)


@pytest.mark.slow
def test_identify_of_a_bench_writes_the_sheet_with_the_recorded_and_the_fitted_curve(tmp_path, asrsim_command, monkeypatch):
    """A spring of 31 N m/rad whose link is locked: the sheet has the fitted stiffness, and the points that were recorded."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(0.0, 2.0, 0.01)
    angle = 0.2 * np.sin(3.0 * time)
    torque = 31.0 * angle + 0.02 * np.random.default_rng(0).normal(size=len(time))
    np.savetxt("a.csv", np.column_stack([time, angle, torque]), delimiter=",", header="time [s],angle,load", comments="")
    (tmp_path / "r.urdf").write_text(re.sub("<gazebo>.*</gazebo>", "", SEA, flags=re.DOTALL))
    maps = ["--map", "angle=j.motor_1_position [rad]", "--map", "load=j.elastic_torque_1 [N m]"]
    done = asrsim_command("init", "r.urdf", "--actuator", "sea", "--experiment", "a.csv", *maps, "--out", "lab.yaml")
    assert done.code == 0, done.err
    done = asrsim_command("identify", "lab.fit.yaml", "--sheet", "--no-plot", "--json")
    assert done.code == 0, done.err
    (folder,) = tmp_path.rglob("datasheet")
    numbers = json.loads((folder / "r_j.json").read_text())["numbers"]
    assert numbers["stiffness_max"]["value"] == pytest.approx(31.0, rel=0.01)
    assert "measured: a.csv" in (folder / "r_j.html").read_text()


def test_a_recording_without_a_torque_curve_is_refused_with_the_missing_column(tmp_path):
    np.savetxt(
        tmp_path / "a.csv", 0.01 * np.ones((9, 2)).cumsum(axis=0), delimiter=",", header="time,link_position", comments=""
    )
    (source,) = sources_of(["sea"])
    with pytest.raises(RecordingError, match="motor_1_position, link_torque"):
        measured_curve(source, tmp_path / "a.csv")


def test_the_sheet_of_a_scenario_has_its_parameters_and_the_resolution_of_its_encoder(tmp_path):
    """A scenario mounts an SEA of 17 N m/rad behind an encoder of 4096 counts a turn."""
    (tmp_path / "r.urdf").write_text(re.sub("<gazebo>.*</gazebo>", "", SEA, flags=re.DOTALL))
    text = "robot: r.urdf\nduration: 1\nactuators: {j: {type: sea, mode: 6, parameters: {spring_stiffness: 17}}}\n"
    (tmp_path / "lab.yaml").write_text(f"{text}imperfections: {{sensors: {{'*': {{quantum: {math.tau / 4096!r}}}}}}}\n")
    (source,) = sources_of([str(tmp_path / "lab.yaml")])
    sheet = make_sheet(source)
    assert value(sheet, "stiffness_max") == pytest.approx(17.0)
    assert value(sheet, "resolution") == pytest.approx(math.tau / 4096)
    assert "imperfections.sensors.j.quantum" in sheet.entry("resolution").how


def test_joints_without_a_robot_are_refused():
    with pytest.raises(InputError, match="requires a robot"):
        sources_of(["sea"], joints=["elbow"])


def test_a_plugin_without_an_actuator_is_refused():
    with pytest.raises(InputError, match="defines no actuator"):
        sources_of([str(ROOT / "examples/plugins/my_clutch.py")])


@pytest.mark.parametrize("target", ["qbmoove", "nothing.urdf"])
def test_an_unknown_target_is_refused_with_the_choices(target):
    with pytest.raises(InputError):
        sources_of([target])


def test_every_actuator_of_asrsim_has_a_sheet_and_a_word_on_its_sources():
    assert {name for name in ACTUATORS.names() if ACTUATORS.get(name).__module__.startswith("asrsim.")} == {*PUBLISHED}
