"""Titles of the columns of a figure."""

from asrsim.plots.figures import TITLE, joint_title
from asrsim.samples import JointInfo


def test_a_long_title_of_an_actuator_stays_within_its_column():
    long = "springs with a separate motor on the housing that preloads " * 4
    name, *lines = joint_title(JointInfo(name="elbow", actuator=long, mode=None)).splitlines()
    assert name == "elbow"
    assert len(lines) == 2
    assert all(len(line) <= TITLE for line in lines)
    assert lines[0] in long
    assert lines[1].endswith("…")
