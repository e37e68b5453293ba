"""Keys of every kind can be varied: a row has the numbers of a run with that `--set`, or the reason of its failure."""

import re

import pytest

import asrsim
from asrsim.document.yaml_reader import parse_yaml
from asrsim.errors import AsrsimError
from asrsim.sweeps import make_study
from asrsim.sweeps.cases import make_payload
from asrsim.sweeps.rows import Runner
from support.paths import EXAMPLES

pytest.importorskip("pyarrow")

TWO_JOINTS = EXAMPLES / "scenarios" / "step_2dof.yaml"
ROBOT = EXAMPLES / "urdf" / "dof2_horizontal.urdf"
KEYS = {
    "robot": [str(ROBOT)],
    "actuators": [{"joint_1": {"type": "sea"}}, {"joint_1": "qbmove"}],
    "modes.joint_1": [3, 6],
    "initial": ["equilibrium", {"joint_1": 0.1}],
    "engine": ["mujoco", "bullet"],
    "stepping": ["leapfrog", "euler", "toolbox"],
    "references.joint_1.stiffness_preset": [0.2, 0.3, {"ramp": {"from": 0.2, "to": 0.3, "start": 0.0, "duration": 0.02}}],
    "references.joint_1.equilibrium_position.step.to": [0.3, 0.5],
    "reference_ranges.joint_1.equilibrium_position": [[-0.1, 0.1], [-1.0, 1.0]],
    "external_torques.joint_1": [0.05, {"sinusoid": {"amplitude": 0.1, "frequency": 20}}],
    "imperfections.commands.joint_1.delay": [0.0, 0.004],
    "link_damping.joint_1": [{"ratio": 0.3, "inertia": 0.02}, {"constant": 0.1}],
    "expect": [[], [{"joint": "joint_1", "quantity": "link_position", "measure": "maximum", "comparison": "<", "value": 1.0}]],
}


def rows_of(over, **settings):
    """(settings of the run, its row) of every point."""
    base = {"duration": "0.02", "engine": "mujoco", "compiled": "false"} | settings
    texts = [f"{name}={value}" for name, value in base.items() if name not in over]
    payload = make_payload(make_study(TWO_JOINTS, over, overrides=texts, variants=["soft"]))
    runner = Runner(payload)
    for run in range(len(payload.study)):
        variant, values = payload.study.point(run)
        case = payload.cases[variant]
        row = dict(zip(payload.kinds, runner(run), strict=True))
        plain = {name: parse_yaml(value).plain() for name, value in (text.split("=", 1) for text in texts)}
        yield {**plain, **case.plan.settings(values), **case.substeps}, row
    runner.close()


def assert_rows_are_runs(key, values, **settings):
    for given, row in rows_of({key: values}, **settings):
        result = asrsim.run(TWO_JOINTS, variant="soft", overrides=given)
        assert row["status"] == "complete", row["reason"]
        for joint in result.summary.joints:
            for name, number in joint.measures.as_dict().items():
                assert row[f"{joint.name}.{name}"] == number, (given, joint.name, name)


@pytest.mark.slow
@pytest.mark.parametrize("key", KEYS)
def test_a_varied_key_is_what_set_makes_of_it(key):
    if "bullet" in KEYS[key]:
        pytest.importorskip("pybullet")
    assert_rows_are_runs(key, KEYS[key])


def test_a_varied_rotor_is_the_armature_of_the_scenario():
    """Behind a spring, too, where the rotor of a robot's file does not count."""
    rows = [*rows_of({"joint_1.armature": [0.0, 0.05]})]
    assert [given["armature.joint_1"] for given, _ in rows] == [0.0, 0.05]
    assert_rows_are_runs("joint_1.armature", [0.0, 0.05])
    assert len({repr([row[name] for name in row if name.startswith("joint_1.")]) for _, row in rows}) == 2


def test_reference_ranges_do_not_clamp_varied_references():
    key = "references.joint_1.stiffness_preset"
    assert_rows_are_runs(key, [0.2, 0.5], **{"reference_ranges.joint_1.stiffness_preset": "[0.1, 0.3]"})


@pytest.mark.parametrize("initial", ["{}", "equilibrium"])
def test_a_pattern_sets_the_parameter_of_each_actuator_that_it_matches(initial):
    """Also if each run reads the scenario again (a start at equilibrium); a joint's own key replaces the pattern's."""
    over = {"joint_1.spring_a_1": [8.0], "joint_*.spring_a_1": [5.0, 7.0]}
    for (given, row), value in zip(rows_of(over, initial=initial), [5.0, 7.0], strict=True):
        named = {"parameters.joint_1.spring_a_1": 8.0, "parameters.joint_2.spring_a_1": value}
        assert named.items() <= given.items()
        result = asrsim.run(TWO_JOINTS, variant="soft", overrides={"initial": initial, **given})
        for joint in result.summary.joints:
            assert row[f"{joint.name}.steady_state"] == joint.measures.as_dict()["steady_state"]


@pytest.mark.parametrize("delay", [0.0, 0.002])
def test_a_pattern_sets_the_reference_of_each_joint_that_it_matches(delay):
    """Also if imperfections change the references; the key of a joint replaces that of the pattern."""
    name = "equilibrium_position"
    over = {f"references.joint_1.{name}": [0.3], f"references.joint_?.{name}": [0.1, 0.2]}
    for (given, row), value in zip(rows_of(over, **{"imperfections.commands.joint_1.delay": delay}), [0.1, 0.2], strict=True):
        alone = {f"references.joint_1.{name}": 0.3, f"references.joint_2.{name}": value}
        base = {"duration": 0.02, "engine": "mujoco", "compiled": False, "imperfections.commands.joint_1.delay": delay}
        result = asrsim.run(TWO_JOINTS, variant="soft", overrides={**base, **given, **alone})
        assert row["status"] == "complete", row["reason"]
        for joint in result.summary.joints:
            assert row[f"{joint.name}.steady_state"] == joint.measures.as_dict()["steady_state"]


def test_a_pattern_that_matches_no_joint_names_the_joints():
    with pytest.raises(AsrsimError, match=r"references.arm_\*.stiffness_preset.*matches no joint.*joint_1"):
        list(rows_of({"references.arm_*.stiffness_preset": [0.1]}))


BAD = {
    "parameters.joint_1.spring_a_1": (8.0, -1.0, "must be"),
    "parameters.*.motor_1_min_position & parameters.*.motor_1_max_position": (
        [-3.0, 3.0],
        [3.0, -3.0],
        "lower stop of motor 1",
    ),
    "parameters.joint_2.spring_a_1": (8.0, 9000.0, "is not finite|cannot be computed"),
    "link_2.mass": (0.3, -0.1, "at least 0"),
    "joint_1.damping": (0.1, -0.1, "at least 0"),
    "modes.joint_1": (6, 99, "whole number >= 0 and <= "),
}


@pytest.mark.parametrize("key", BAD)
def test_a_wrong_value_is_a_row_with_the_reason(key):
    good, bad, word = BAD[key]
    (_, first), (given, row), (_, last) = rows_of({key: [good, bad, good]})
    assert first["status"] == last["status"] == "complete"
    assert {**first, "run": 2, "seconds": 0} == {**last, "seconds": 0}
    assert row["status"] == "failed"
    assert row["joint_1.steady_state"] is None
    assert re.search(word, row["reason"]), row["reason"]
    if key.partition(".")[0] not in ("link_2", "joint_1"):
        with pytest.raises(AsrsimError) as caught:
            asrsim.run(TWO_JOINTS, variant="soft", overrides=given)
        # A study is about one scenario: its rows, the same on any machine, do not repeat the path.
        reason = "; ".join(line.strip() for line in str(caught.value).replace(f"{TWO_JOINTS}: ", "").splitlines())
        assert reason == row["reason"]
