"""Examples: robots load without warnings; scenarios name their figure, and their claims hold."""

import re

import pytest

import asrsim
from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from asrsim.robot.meshes import usable_shapes
from asrsim.scenario import load_scenario
from support.examined import check_against_robot
from support.paths import EXAMPLES

ROBOTS = sorted((EXAMPLES / "urdf").glob("*.urdf"))
SCENARIOS = sorted((EXAMPLES / "scenarios").glob("*.yaml"))
SLOW = ("box_push_5dof", "sine_2dof")
FIGURES = {
    "step_1dof_sea": 8, "step_1dof_awas_ii": 8, "step_1dof_bavs": 8, "step_1dof_qbmove": 8, "chirp_1dof_qbmove": 11,
    "step_2dof": 12, "sine_2dof": 13, "box_push_5dof": 14, "ilc_2dof": 15,
}  # fmt: skip


def test_every_figure_has_its_scenario():
    assert {path.stem for path in SCENARIOS} >= set(FIGURES)


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_robots_load_without_warnings(path):
    robot = load_robot(path)
    plain = ["no-actuators"] if path.stem == "plain_arm" else []
    assert [warning.code for warning in warnings_of(robot)] == plain
    assert usable_shapes(robot, visuals=True)[1] == ()
    assert "and their sources" in path.read_text()


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_scenarios_name_their_figure_and_have_no_warnings(path):
    assert re.match(rf"# Figure {FIGURES[path.stem]} of Mengacci", path.read_text())
    for scenario in load_scenario(path):
        errors, warnings = check_against_robot(scenario, load_robot(scenario.robot))
        assert (errors, warnings) == ([], [])
        assert [claim for claim in scenario.expect if claim.variant in (None, scenario.variant)]


def cases():
    for path in SCENARIOS:
        for scenario in load_scenario(path):
            marks = [pytest.mark.slow] if path.stem in SLOW else []
            yield pytest.param(scenario, id=f"{path.stem}-{scenario.variant}", marks=marks)


@pytest.mark.parametrize("scenario", list(cases()))
def test_claims_hold(scenario):
    claims = asrsim.run(scenario).summary.claims
    assert claims
    assert [claim.text for claim in claims if not claim.holds] == []


def test_the_documentation_lists_every_example_and_variant():
    text = (EXAMPLES.parent / "docs" / "examples.md").read_text()
    for path in (*ROBOTS, *SCENARIOS):
        assert f"`{path.name}`" in text
    for path in SCENARIOS:
        (row,) = [line for line in text.splitlines() if line.startswith(f"| `{path.name}`")]
        assert row.split("|")[3].strip() == ", ".join(scenario.variant for scenario in load_scenario(path))
