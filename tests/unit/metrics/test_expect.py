"""Claims of a scenario: comparison, tolerance, verdict, and errors at the claim's line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import asrsim
from asrsim.errors import ScenarioError
from asrsim.metrics.expect import compares, subject_of
from asrsim.samples import TIP, TIP_GOAL, JointInfo, Samples
from asrsim.scenario import make_scenario
from asrsim.scenario.data import Expectation
from asrsim.summary.claims import claim_results
from support.examined import check_claims

TIME = np.linspace(0, 2, 2001)
POSES = np.column_stack([0.05 * TIME, np.zeros_like(TIME), np.full_like(TIME, 0.1), np.tile([0, 0, 0, 1.0], (len(TIME), 1))])
FORCE = np.column_stack([np.where(TIME > 1, 3.0, np.nan), np.where(TIME > 1, 4.0, np.nan), np.where(TIME > 1, 0.0, np.nan)])
SAMPLES = Samples(
    time=TIME,
    joints=("elbow",),
    values={"link_position": (0.8 * (1 - np.exp(-TIME / 0.1)))[:, None]},
    bodies={"box": POSES},
    contacts={"box/hand": FORCE},
)


JOINTS = (JointInfo(name="elbow", actuator="sea", mode=3, motors=1, quantities=("link_position", "motor_1_position")),)


def claim(**changes):
    base = {"quantity": "link_position", "measure": "steady_state", "comparison": "==", "value": 0.8, "tolerance": 1e-3,
            "joint": "elbow", "line": 7}  # fmt: skip
    return Expectation(**{**base, **changes})


def evaluate(claims):
    check_claims(claims, JOINTS, file=None)
    return claim_results(claims, JOINTS, lambda *_: SAMPLES)


@pytest.mark.parametrize(
    ("measured", "comparison", "value", "tolerance", "holds"),
    [
        (1.0, "==", 1.0, 0.0, True), (1.1, "==", 1.0, 0.1, True), (1.2, "==", 1.0, 0.1, False), (1.0, "<", 1.0, 0.0, False),
        (1.0, "<=", 1.0, 0.0, True), (1.05, "<", 1.0, 0.1, False),
        (0.95, ">", 1.0, 0.1, False), (0.0, "<", -99.0, 1e9, False), (1.0, ">=", 1.0, 0.0, True),
        (float("nan"), "<", 1.0, 9.0, False), (float("nan"), ">=", 1.0, 9.0, False),
    ],
)  # fmt: skip
def test_comparisons(measured, comparison, value, tolerance, holds):
    assert compares(measured, comparison, value, tolerance) is holds


def test_claims_hold_and_fail_in_words():
    good, bad, undefined = evaluate(
        [claim(), claim(value=0.9), claim(measure="frequency", comparison=">", value=1.0, tolerance=0.0)],
    )
    assert (good.holds, bad.holds, undefined.holds) == (True, False, False)
    assert good.text == "elbow: steady_state of link_position is 0.8 rad, expected == 0.8 +- 0.001 rad: holds"
    assert bad.text.endswith("does not hold")
    assert "cannot be measured" in undefined.text
    for wrong, word in (
        ({"measure": "rmse"}, "second series"),
        ({"joint": None, "body": "ball", "quantity": "x"}, "not recorded"),
    ):
        with pytest.raises(ScenarioError, match=word):
            evaluate([claim(**wrong)])


@pytest.mark.parametrize(
    ("quantity", "measure", "value", "unit"),
    [
        ("position", "displacement", 0.1, "m"),
        ("x", "final", 0.1, "m"),
        ("contact_force", "maximum", 5.0, "N"),
        ("contact_force", "minimum", 0.0, "N"),
        ("contact_force.x", "final", 3.0, "N"),
        ("contact_force/hand.y", "final", 4.0, "N"),
        ("contact_force.z", "final", 0.0, "N"),
    ],
)
def test_bodies_and_contacts(quantity, measure, value, unit):
    (result,) = evaluate([claim(joint=None, body="box", quantity=quantity, measure=measure, value=value, tolerance=1e-9)])
    assert (result.holds, result.unit) == (True, unit)


def test_a_claim_compares_with_another_quantity_of_its_joint():
    lag = np.sin(TIME), np.sin(TIME) - 0.25
    samples = replace(SAMPLES, values={"link_position": lag[0][:, None], "motor_1_position": lag[1][:, None]})
    same = claim(measure="bias", reference="motor_1_position", value=0.25, tolerance=1e-9)
    turned = replace(same, quantity="motor_1_position", reference="link_position", value=-0.25)
    check_claims([same, turned], JOINTS, file=None)
    assert all(result.holds for result in claim_results([same, turned], JOINTS, lambda *_: samples))
    with pytest.raises(ScenarioError, match=r"expect.reference: is not recorded .*stiffness"):
        check_claims([replace(same, reference="stiffness")], JOINTS, file=None)
    with pytest.raises(ScenarioError, match="no such quantity"):
        replace(same, reference="elbow")


def test_a_claim_without_a_reference_is_about_the_desired_position():
    values = {"link_position": SAMPLES.values["link_position"], "reference_1": SAMPLES.values["link_position"] + 0.1}
    joints = (replace(JOINTS[0], quantities=tuple(values)),)
    (result,) = claim_results(
        [claim(measure="bias", value=-0.1, tolerance=1e-9)], joints, lambda *_: replace(SAMPLES, values=values)
    )
    assert result.holds, result.text


def test_the_error_of_the_tip_is_its_distance_from_the_goal():
    bodies = {TIP: POSES, TIP_GOAL: POSES + np.array([0.03, -0.04, 0.0, 0.0, 0.0, 0.0, 0.0])}
    far = claim(joint=None, body=TIP, quantity="error", measure="maximum", value=0.05, tolerance=1e-9)
    (result,) = claim_results([far], JOINTS, lambda *_: replace(SAMPLES, bodies=bodies))
    assert (result.holds, result.unit) == (True, "m"), result.text


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_claim_is_about_its_engine_only(engine, tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='arm'><link name='base'/></robot>")
    same = {"joint": "*", "quantity": "link_position", "measure": "final", "value": 0}
    claims = [{**same, "engine": "bullet", "tolerance": 0.1}, {**same, "engine": "mujoco", "tolerance": 0.2}]
    scenario = make_scenario(tmp_path / "arm.urdf", duration=1.0, engine=engine, expect=claims)
    assert [one.tolerance for one in scenario.expect] == [0.1 if engine == "bullet" else 0.2]
    with pytest.raises(ScenarioError, match="bulet"):
        make_scenario(tmp_path / "arm.urdf", duration=1.0, engine=engine, expect=[{**claims[0], "engine": "bulet"}])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"measure": "overshot"}, "Did you mean 'overshoot'"),
        ({"quantity": "stiffness"}, "not recorded for joint 'elbow'"),
        ({"joint": None, "body": "box", "quantity": "colour"}, "no quantity 'colour'"),
        ({"joint": None, "body": "box", "quantity": "contact_force.w"}, "no quantity 'contact_force.w'"),
        ({"options": {"bnd": 1}}, "not an option"),
        ({"joint": None, "body": "box", "quantity": "x", "measure": "displacement"}, "poses"),
        ({"joint": None, "body": "box", "quantity": "position", "measure": "maximum"}, "scalar series"),
        ({"comparison": "<", "value": -99.0, "tolerance": 1e9}, "valid with '==' only"),
        *(({"measure": "settling", "options": {"band": band}}, "number") for band in ("wide", [1, 2], float("inf"))),
        *(({"measure": "at", "options": {"when": when}}, "number") for when in ("soon", True)),
        *(({"options": {"start": start}}, "number") for start in ("0.1 s", [1], float("nan"))),
        ({"options": {"start": 2.0, "end": 1.0}}, "before the end"),
        ({"measure": "overshoot", "options": {"initial": {}}}, "number"),
        *(
            ({"measure": "rmse", "against": Path("lab.csv"), "options": {key: value}}, f"options.{key}")
            for key, value in (("map", {"a": 1}), ("lag", "soon"), ("rate", -1.0))
        ),
    ],
)
def test_claims_that_cannot_be_evaluated_are_errors_before_the_run(changes, words):
    with pytest.raises(ScenarioError, match=words) as error:
        check_claims([claim(**changes)], JOINTS, file=None)
    assert error.value.problems[0].line == 7


@pytest.mark.parametrize("mapping", ["a=elbow.link_position", ["a=elbow.link_position", "b=ignore"]])
def test_a_claim_takes_one_mapping_or_a_list(mapping, tmp_path):
    (tmp_path / "lab.csv").write_text("time [s],a,b\n0,0,0\n0.01,0.1,1\n0.02,0.3,2\n0.03,0.2,1\n")
    check_claims([claim(measure="rmse", against=tmp_path / "lab.csv", options={"map": mapping})], JOINTS, file=None)
    with pytest.raises(ScenarioError, match=r"3: is not COLUMN=JOINT\.QUANTITY"):
        check_claims([claim(measure="rmse", against=tmp_path / "lab.csv", options={"map": 3})], JOINTS, file=None)


@pytest.mark.parametrize(
    "changes",
    [
        {"joint": "wrist"},
        {"quantity": "link_torque"},
        {"measure": "final"},
        {"reference": "motor_1_position"},
        {"against": Path("lab.csv")},
        {"options": {"end": 1.0}},
    ],
)
def test_claims_share_a_number_only_if_they_measure_the_same(changes):
    same, other = claim(measure="rmse", comparison="<", value=9.0, tolerance=0.0), claim(**{"measure": "rmse"} | changes)
    assert subject_of(claim(measure="rmse")) == subject_of(same) != subject_of(other)


def test_claims_that_differ_in_an_option_are_measured_apart():
    early, late = evaluate([claim(measure="maximum", options={"end": end}) for end in (0.1, 1.0)])
    assert early.measured == pytest.approx(0.8 * (1 - np.exp(-1)), rel=1e-6)
    assert late.measured == pytest.approx(0.8 * (1 - np.exp(-10)), rel=1e-6)


@pytest.mark.parametrize("lag", ["auto", "off"])
def test_a_recording_that_shares_no_time_with_the_run_is_an_error_at_its_claim_with_the_claim_s_remedy(tiny, lag):
    """Options of `asrsim plot` are no remedy for a claim."""
    rows = "".join(f"{5000 + 0.1 * i},{0.1 * (i % 3)}\n" for i in range(30))
    (tiny.folder / "lab.csv").write_text(f"time [s],elbow.link_position [rad]\n{rows}")
    asked = f"{{joint: elbow, quantity: link_position, measure: rmse, value: 1, against: lab.csv, options: {{lag: {lag}}}}}"
    claimed = f"expect: [{asked}]"
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}\n{claimed}\n")
    line = len(tiny.scenario.read_text().splitlines())
    with pytest.raises(ScenarioError, match=r"lab\.csv: no overlap in time.*`options: {lag: start}`") as caught:
        asrsim.run(tiny.scenario, overrides={"duration": 0.2})
    assert (caught.value.problems[0].file, caught.value.problems[0].line) == (tiny.scenario, line)
    assert "--align" not in str(caught.value)
