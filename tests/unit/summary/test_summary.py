"""The summary of a run: its numbers against the samples, its limits, its JSON."""

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import asrsim
from asrsim.metrics.summary import JointSummary
from asrsim.quantities import LIMITS, shown
from asrsim.runs.rerun import rerun
from asrsim.samples import JointInfo, Samples
from asrsim.scenario import load_scenario
from asrsim.simulation.run import simulate
from asrsim.summary import Collector, collect
from asrsim.summary.collect import Seen, step_start
from asrsim.summary.make import make_summary
from asrsim.summary.table import difference_columns, limit_columns, limit_note, measure_columns
from support.paths import EXAMPLES, ROOT


def test_numbers_are_those_of_the_samples(tiny):
    result = asrsim.run(tiny.scenario, overrides=["duration=3"])
    q, time = result["elbow"].link_position, result.time
    measures = result.summary.joint("elbow").measures
    last = time >= 2.7 - 1e-9
    assert measures.steady_state == pytest.approx(q[last].mean(), abs=1e-5)
    assert measures.steady_state_error == pytest.approx(0.5 - q[last].mean(), abs=1e-5)
    # Spring and gravity balance: k (0.5 - q) = m g l sin q.
    assert 10.0 * measures.steady_state_error == pytest.approx(0.5 * 9.81 * 0.1 * math.sin(measures.steady_state), abs=2e-3)
    assert measures.overshoot == pytest.approx(q.max() / measures.steady_state - 1.0, abs=1e-3)
    assert measures.peak_deflection == np.abs(0.5 * (time >= 0.1) - q).max()
    outside = np.flatnonzero(np.abs(q - measures.steady_state) > 0.02 * measures.steady_state)
    assert measures.settling == pytest.approx(time[outside[-1]] - 0.1, abs=0.002)
    cells = [texts[0] for _, texts, _ in measure_columns([result.summary.joints[0].as_dict()])]
    assert cells.pop(3) == shown(measures.steady_state_error, "rad")
    rest = (measures.steady_state, 100.0 * measures.overshoot, measures.settling)
    assert [float(text) for text in cells[2:5]] == pytest.approx(rest, rel=5e-3)


def test_a_summary_names_how_the_run_was_computed(tiny):
    keys = {"stepping": "euler", "engine": "mujoco", "duration": 0.1, "step": 2e-3, "substeps": 3, "seed": 5}
    summary = asrsim.run(
        tiny.scenario, overrides=["compiled=false", *(f"{name}={value}" for name, value in keys.items())]
    ).summary
    assert {name: getattr(summary, name) for name in keys} == keys
    assert summary.simulated_time == pytest.approx(0.1)
    assert (summary.samples, summary.total_substeps, summary.loop) == (51, 151, "plain")


def test_the_error_is_measured_from_the_desired_position(tiny):
    result = asrsim.run(tiny.scenario, overrides=["duration=3", "desired={elbow: {step: {at: 0.2, to: 0.45}}}"])
    measures = result.summary.joint("elbow").measures
    assert measures.steady_state == pytest.approx(0.477, abs=0.01)
    assert measures.steady_state_error == pytest.approx(0.45 - measures.steady_state, abs=1e-9)


@pytest.mark.parametrize("signal", ["{sinusoid: {amplitude: 0.3, frequency: 2}}", "{waypoints: [[0, 0], [0.5, 0.4], [1, 0]]}"])
def test_a_motion_that_is_no_step_has_no_overshoot(tiny, signal):
    result = asrsim.run(tiny.scenario, overrides=[f"references={{elbow: {{equilibrium_position: {signal}}}}}"])
    measures = result.summary.joint("elbow").measures
    assert math.isnan(measures.overshoot)
    assert math.isnan(measures.settling)


def test_a_link_that_still_swings_has_no_measures_of_rest(tiny, asrsim_command):
    """The run ends at the first extremum of the swing, where the link stands still for a moment."""
    claims = [
        f"  - {{joint: elbow, quantity: link_position, measure: {name}, value: 0.5, tolerance: 0.1}}\n"
        for name in ("steady_state", "overshoot", "settling", "steady_state_error")
    ]
    tiny.scenario.write_text(tiny.scenario.read_text().replace("1.5", "0.182") + "expect:\n" + "".join(claims))
    assert abs(asrsim.run(tiny.scenario)["elbow"].link_velocity[-1]) < 0.05
    outcome = asrsim_command("run", tiny.scenario, "--no-plot")
    assert outcome.code == 1
    assert "not at rest at the end, so measures that need rest are missing: elbow (0." in outcome.out
    assert outcome.err.count("cannot be measured, since it is not at rest at the end (0.") == 4
    (joint,) = json.loads((tiny.folder / "out/step/default/summary.json").read_text())["joints"]
    assert [joint[name] for name in ("steady_state", "steady_state_error", "overshoot", "settling")] == [None] * 4
    assert joint["motion_left"] > 0.01


def test_the_error_in_a_task_is_measured_from_the_path():
    """The planned references are off the path by the springs' and motors' sag; the arm itself ends on the path."""
    poses = [{"time": 0.0, "position": [0.3, -0.1, 0.1565]}, {"time": 1.0, "position": [0.3, -0.08, 0.1565]}]
    task = {"link": "link_5", "point": [0.094, 0.0, 0.0], "poses": poses, "preset": 0.4}
    task |= {"gravity_compensation": True, "motor_droop": True}
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof5_arm.urdf", duration=2.0, task=task, initial={"joint_1": -1.0698, "joint_4": 1.2803}
    )
    result = asrsim.run(scenario)
    joint = result.summary.joint("joint_2").measures
    sag = abs(float(result.samples.joint("joint_2")["reference_1"][-1]))
    assert abs(joint.steady_state_error) == pytest.approx(abs(joint.steady_state), abs=1e-4)
    assert abs(joint.steady_state_error) < min(0.5 * sag, 0.01)


def test_an_equilibrium_start_has_no_step(tiny):
    """The link hangs below its reference from the start and a push shakes it: there is no step to overshoot."""
    start = ["initial=equilibrium", "references={elbow: {equilibrium_position: 0.5}}", "duration=3"]
    push = "external_torques={elbow: {pulse_train: {high: 0.05, start: 0.1, period: 10, width: 0.1}}}"
    measures = asrsim.run(tiny.scenario, overrides=[*start, push]).summary.joint("elbow").measures
    assert math.isnan(measures.overshoot)
    assert math.isnan(measures.settling)
    step = "references={elbow: {equilibrium_position: {step: {at: 0.2, to: 0.4}}}}"
    stepped = asrsim.run(tiny.scenario, overrides=[start[0], step])
    assert stepped.summary.joint("elbow").measures.overshoot > 0.0


def test_limits_are_counted_in_substeps(tiny):
    tiny.robot.write_text(tiny.robot.read_text().replace('effort="50" velocity="100"', 'effort="2" velocity="1"'))
    result = asrsim.run(tiny.scenario, overrides=["substeps=1"])
    joint = result.summary.joint("elbow")
    torque, velocity = result["elbow"].link_torque, result["elbow"].link_velocity
    assert joint.effort == np.count_nonzero(np.abs(torque) >= 2.0) > 0
    assert joint.velocity == np.count_nonzero(np.abs(velocity) > 1.0) > 0
    assert joint.saturation == 0
    headings = [heading for heading, _, _ in limit_columns([joint.as_dict()], [result.summary.total_substeps])]
    assert "effort\nlimit" in headings
    assert "motor\nlimit" not in headings
    assert limit_note(result.summary) == f"limits: share of {result.summary.total_substeps} substeps at or beyond the limit"


def test_the_page_explains_each_column_of_the_limits(tiny):
    page = (ROOT / "docs" / "running.md").read_text(encoding="utf-8")
    assert not [heading for heading in LIMITS.values() if f"| {heading} | " not in page]
    assert limit_note(asrsim.run(tiny.scenario).summary).startswith("no limit of effort, velocity, motors, ")


def test_a_run_stopped_at_once_simulated_nothing(tiny):
    summary = asrsim.run(tiny.scenario, stop=lambda: True).summary
    assert (summary.status, summary.samples) == ("interrupted", 0)
    assert limit_note(summary) == "nothing was simulated"


def test_two_saturated_motors_are_one_saturated_joint():
    scenario = ROOT / "examples/scenarios/step_2dof.yaml"
    weak = [f"parameters.*.motor_{i}_max_torque=0.05" for i in (1, 2)]
    result = asrsim.run(scenario, variant="soft", overrides=["duration=0.2", *weak])
    for name in ("joint_1", "joint_2"):
        series = result[name]
        held = [np.abs(series[f"motor_{i}_torque"]) >= 0.05 for i in (1, 2)]
        assert np.count_nonzero(held[0] & held[1]) > 0
        assert 0.9 < result.summary.joint(name).saturation / result.summary.total_substeps <= 1.0


def test_small_errors_have_a_small_unit_in_the_table():
    missing = dict.fromkeys(("steady_state", "overshoot", "settling", "peak_deflection"))
    found = ((-7.23e-5, False), (0.108, False), (1.79e-3, True), (1e-13, False))
    joints = [
        {"name": "a", "actuator": "sea", "mode": 5, "prismatic": prismatic, "steady_state_error": error, **missing}
        for error, prismatic in found
    ]
    cells = {heading: texts for heading, texts, _ in measure_columns(joints)}
    assert cells["error"] == ("-0.0723 mrad", "0.108 rad", "1.79 mm", "0 rad")


def test_a_difference_that_is_not_known_is_no_zero():
    joints = [{"torque_max": 0.5}, {"position_max": 2e-3, "torque_max": 0.0}]
    cells = {heading: texts for heading, texts, _ in difference_columns(["a", "b"], joints, [False, True])}
    assert (cells["position\nmax"], cells["torque\nmax"]) == (["-", "2 mm"], ["0.5 N m", "0 N"])


def test_undefined_numbers_are_null_in_json(tiny):
    result = asrsim.run(tiny.scenario, overrides=["modes=0", "references={elbow: {link_torque: 0}}", "duration=0.1"])
    joint = result.summary.as_dict()["joints"][0]
    assert joint["steady_state_error"] is None
    assert joint["overshoot"] is None
    json.dumps(result.summary.as_dict(), allow_nan=False)
    cells = {heading: texts for heading, texts, _ in measure_columns([joint])}
    assert cells["error"] == ("-",)


def test_a_long_run_is_thinned_but_its_peak_is_kept(tiny, monkeypatch):
    result = asrsim.run(tiny.scenario)
    samples, joints = result.samples, result.run.info.joints
    n = len(samples.time)

    def measured():
        collector = Collector(joints, samples=n)
        for start in range(0, n, 97):
            collector.write(_rows(samples, slice(start, start + 97)))
        return collector.seen().measures[0]

    whole = measured()
    monkeypatch.setattr(collect, "KEPT", 400)
    thin = measured()
    assert thin.peak_deflection == whole.peak_deflection
    assert thin != whole
    assert thin.steady_state == pytest.approx(whole.steady_state, abs=1e-3)
    assert thin.settling == pytest.approx(whole.settling, abs=0.01)


@pytest.mark.parametrize("kept", [40, 150, 10**6])
def test_a_summary_does_not_depend_on_the_chunks(kept, monkeypatch):
    monkeypatch.setattr(collect, "KEPT", kept)
    info = JointInfo(name="elbow", actuator="sea", mode=5, motors=1, quantities=("link_position",))
    time = np.arange(1001) * 1e-3
    noise = np.random.default_rng(3).normal(size=(3, 1001, 1))
    columns = {"link_position": noise[0], "motor_1_position": noise[1], "reference_1": 1.0 + 0.0 * noise[2]}
    wanted = ((("link_position", "elbow"),), True)
    found = []
    for ends in ([1001], [1, 2, 5, 300, 301, 850, 1001], [*list(range(7, 1001, 7)), 1001]):
        collector = Collector([info], samples=1001, needs=wanted)
        for a, b in zip([0, *ends], ends, strict=False):
            tip = np.full((b - a, 7), 0.1) + time[a:b, None]
            collector.write(
                Samples(
                    time=time[a:b],
                    joints=("elbow",),
                    values={name: table[a:b] for name, table in columns.items()},
                    bodies={"tip": tip, "tip_goal": np.zeros((b - a, 7))},
                )
            )
        found.append(collector.seen())
        np.testing.assert_array_equal(
            collector.read(("link_position",), ("elbow",)).values["link_position"], columns["link_position"]
        )
    assert found[0] == found[1] == found[2]
    away = np.sqrt(3.0) * (0.1 + time)
    assert found[0].tip == pytest.approx(
        {"largest": away.max(), "rms": np.sqrt(np.mean(away**2)), "last": away[-100:].mean()}, rel=1e-9
    )
    if kept > 1001:
        assert found[0].travels == (np.ptp(noise[0]),)


def test_arrays_in_another_order_keep_their_joints(tiny):
    """A manager's joint order changes the description; the numbers must follow."""
    tiny.robot.write_text(TWO_JOINTS)
    (tiny.folder / "manager.yaml").write_text("joints_name: [second, first]\n")
    tiny.scenario.write_text(
        "robot: pendulum.urdf\nduration: 0.5\nmanager: manager.yaml\ngravity: [0, 0, 0]\n"
        "references:\n  first: {equilibrium_position: 0}\n  second: {equilibrium_position: {step: {at: 0, to: 0.3}}}\n"
    )
    result = asrsim.run(tiny.scenario)
    assert result.joints == ("second", "first")
    for name in result.joints:
        assert result.summary.joint(name).measures.peak_deflection == np.abs(result[name].deflection).max()
    assert result.summary.joint("second").effort > 0
    assert result.summary.joint("first").effort == 0


def _rows(samples, rows):
    return replace(samples, time=samples.time[rows], values={name: values[rows] for name, values in samples.values.items()})


def _joint(name, parent, effort):
    return f"""<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{name}_link"/><axis xyz="0 1 0"/>
<limit effort="{effort}" velocity="100"/></joint>
<link name="{name}_link"><inertial><mass value="0.5"/><inertia ixx="1e-2" ixy="0" ixz="0" iyy="1e-2" iyz="0" izz="1e-2"/>
</inertial></link>
<gazebo><plugin name="{name}_drive" filename="libsea_plugin.so"><joint>{name}</joint><operation_mode>3</operation_mode>
<pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau><spring_k>10</spring_k></plugin></gazebo>
"""


TWO_JOINTS = f"<robot name='two'><link name='world'/>{_joint('first', 'world', 100)}{_joint('second', 'first_link', 1)}</robot>"


def test_claims_and_summary_see_every_step_whatever_is_logged(tiny, tmp_path):
    """A blow of 10 ms between two samples of a log of 10 Hz: its peak is claimed, seen and summarised, and not logged."""
    blow = "external_torques={elbow: {pulse_train: {high: 30, period: 10, width: 0.01, start: 0.42}}}"
    claims = [
        "{joint: elbow, quantity: link_velocity, measure: maximum, comparison: '>', value: 1.0}",
        "{joint: elbow, quantity: external_torque, measure: maximum, value: 30}",
    ]
    changes = ["duration=1", blow, f"expect=[{', '.join(claims)}]"]
    whole = asrsim.run(tiny.scenario, overrides=changes)
    thin = asrsim.run(tiny.scenario, overrides=[*changes, "log_rate=10"], out=tmp_path / "thin")
    kept = asrsim.run(tiny.scenario, overrides=[*changes, "log_rate=10"])
    assert whole.summary.samples == 1001
    assert thin.summary.samples == kept.summary.samples == len(kept.time) == len(thin.time) == 11
    assert kept["elbow"].external_torque.max() == 0.0
    for result in (thin, kept):
        assert [claim.measured for claim in result.summary.claims] == [claim.measured for claim in whole.summary.claims]
        assert result.ok
        assert result.summary.joint("elbow").measures == whole.summary.joint("elbow").measures
    assert json.loads((tmp_path / "thin/summary.json").read_text())["samples"] == 11


def test_claims_about_objects_and_tips_see_every_step(tmp_path):
    scenario = ROOT / "examples/scenarios/box_push_5dof.yaml"
    path = "task.poses=[{time: 0.3, position: [0.30, -0.05, 0.1565]}]"
    drop = "world.objects.box.position=[0.30, 0.1625, 0.14]"
    claims = "expect=[{body: box, quantity: contact_force/ground, measure: maximum, comparison: '>', value: 0}, "
    claims += "{body: tip, quantity: error, measure: maximum, comparison: '>', value: 0}]"
    changes = ["duration=0.4", path, drop, claims]
    whole = asrsim.run(scenario, variant="soft", overrides=changes)
    thin = asrsim.run(scenario, variant="soft", overrides=[*changes, "log_rate=20"], out=tmp_path / "thin")
    assert [claim.measured for claim in thin.summary.claims] == [claim.measured for claim in whole.summary.claims]
    assert thin.summary.tip == whole.summary.tip
    assert rerun(thin.log).identical
    for name, poses in whole.bodies.items():
        assert np.array_equal(thin.bodies[name], poses[::50]), name
    for name, forces in whole.contacts.items():
        assert np.array_equal(thin.contacts[name], forces[::50]), name


def test_a_run_is_ok_without_contradiction(tiny):
    """Neither its end, nor a claim, nor another engine."""
    claimed = "expect=[{joint: elbow, quantity: link_position, measure: final, value: 0, tolerance: 9}]"
    summary = asrsim.run(tiny.scenario, overrides=["duration=0.1", claimed]).summary
    (claim,) = summary.claims
    assert summary.ok
    assert not replace(summary, status="interrupted").ok
    assert not replace(summary, claims=(replace(claim, holds=True), replace(claim, holds=False))).ok
    assert not replace(summary, cross_check={"finding": "the engines differ"}).ok
    assert replace(summary, cross_check={"finding": "", "note": "bodies touch"}).ok
    assert summary.speed == pytest.approx(summary.simulated_time / summary.wall_time)


REST = {"rest": 1.0, "error": 0.4, "stops": (-1.0, 1.0), "stop": 9, "prismatic": False, "friction": 0.0, "travel": 0.5}
STANDS = {"rest": 0.0, "error": 0.4, "stops": (-1.0, 1.0), "stop": 0, "prismatic": False, "friction": 0.3, "travel": 0.0}
SHORT = {"rest": 0.0504, "error": 0.001, "stops": (0.0, 0.05), "prismatic": True}
JUDGED = [
    (REST, {}, "comes to rest on its joint stop at 1 rad, 0.4 rad from its reference"),
    (REST, {"error": math.nan}, "comes to rest on its joint stop at 1 rad$"),
    (REST, {"rest": 0.985}, None),
    (REST, {"stop": 0}, None),
    (REST, {"error": 0.009}, None),
    # Of a travel of 0.05 m the share counts: 0.5 mm.
    (REST, SHORT, "stop at 0.05 m, 0.001 m from"),
    (STANDS, {}, "never moves, 0.4 rad from its reference: its friction of 0.3 N m holds it"),
    (STANDS, {"friction": 0.0}, None),
    (STANDS, {"balanced": True}, None),
]
"""How a joint ends: what is otherwise, and what is said of it."""


@pytest.mark.parametrize(("usual", "otherwise", "said"), JUDGED)
def test_joints_that_end_stuck_or_on_stops_get_warnings(tiny, usual, otherwise, said):
    now = SimpleNamespace(**{"balanced": False, **usual, **otherwise})
    run = simulate(load_scenario(tiny.scenario)[0], duration=0.001)
    joints = [
        replace(one, lower=now.stops[0], upper=now.stops[1], friction=now.friction) if one.name == "elbow" else one
        for one in run.robot.joints
    ]
    run = replace(
        run,
        robot=replace(run.robot, joints=tuple(joints)),
        counts=replace(run.counts, stop=np.array([now.stop])),
        scenario=replace(run.scenario, initial_equilibrium=now.balanced),
        warnings=(),
        info=replace(run.info, joints=(replace(run.info.joints[0], prismatic=now.prismatic),)),
    )
    nothing = dict.fromkeys(("overshoot", "settling", "frequency", "peak_deflection"), math.nan)
    measures = JointSummary(steady_state=now.rest, steady_state_error=now.error, **nothing)
    told = make_summary(run, Seen(measures=(measures,), tip={}, travels=(now.travel,)), samples=1).warnings
    assert [one.key for one in told] == ([] if said is None else ["elbow"])
    assert said is None or re.search(said, told[0].message)


@pytest.mark.parametrize(
    ("reference", "start"),
    [
        ([0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1], 7),
        ([0, 0, 0, 1, 2, 3, 4, 4, 4, 4, 4, 4], 3),
        ([4, 4, 4, 1, 1, 0, 0, 0, 0, 0, 0, 0], 3),
        ([1] * 12, 0),
        ([0] * 12, None),
        ([0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0], None),
        ([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11], None),
    ],
    ids=["step", "ramp", "down", "elsewhere", "at rest", "back", "moving to the end"],
)
def test_a_motion_starts_with_the_first_sample_that_differs(reference, start):
    assert step_start(np.array(reference, dtype=float), 0.0) == start
