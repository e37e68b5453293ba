"""Two readers of one robot file: what yourdfpy makes of it must be what asrsim makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from asrsim.robot import load_robot
from asrsim.robot.second_reader import second_reading
from support.paths import ROOT

EXAMPLES = sorted((ROOT / "examples" / "urdf").glob("*.urdf"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_both_read_the_examples_alike(path: Path) -> None:
    assert second_reading(load_robot(path)) == ()


def test_differences_are_named() -> None:
    robot = load_robot(next(path for path in EXAMPLES if path.stem == "dof2_vertical"))
    heavier = replace(robot, links=tuple(replace(link, mass=(link.mass or 0.0) + 1e-6) for link in robot.links))
    assert {problem.key for problem in second_reading(heavier)} == {link.name for link in robot.links}
    joint = robot.moving_joints[-1]
    moved = replace(joint, origin=(joint.origin[0] + 1e-6, *joint.origin[1:]))
    turned = replace(joint, rpy=(joint.rpy[0], joint.rpy[1] + 1e-6, joint.rpy[2]))
    for changed in (moved, turned):
        other = replace(robot, joints=tuple(changed if one is joint else one for one in robot.joints))
        assert joint.child in {problem.key for problem in second_reading(other)}


def test_a_text_that_it_cannot_read_is_said(tmp_path: Path) -> None:
    robot = replace(load_robot(EXAMPLES[0]), text="<robot")
    (problem,) = second_reading(robot)
    assert "yourdfpy cannot read" in problem.message
    assert problem.code == "second-reader"


def test_check_compares_when_asked(asrsim_command) -> None:
    assert asrsim_command("check", EXAMPLES[0], "--second-reader", "--quiet").code == 0
