"""Words that the shell completes."""

import pytest

from asrsim.cli import complete
from support.paths import ROOT
from support.plot_example import made_up_log

SCENARIO = ROOT / "examples" / "scenarios" / "step_2dof.yaml"


@pytest.fixture
def line(monkeypatch):
    return lambda *words: monkeypatch.setenv("COMP_WORDS", " ".join(map(str, words)))


def test_variants_and_keys_of_the_named_scenario_are_completed(line):
    line("asrsim", "run", SCENARIO, "--variant", "s")
    assert complete.variants("s") == ["soft", "stiff"]
    assert "joint_1.motor_1_inertia" in complete.robot_keys("joint_1.motor")
    assert all(key.startswith("link_2.") for key in complete.robot_keys("link_2."))


def test_joints_and_quantities_of_the_named_log_are_completed(line, tmp_path):
    line("asrsim", "plot", made_up_log(tmp_path / "log.mcap", joints=2, count=20), "--joint")
    assert complete.joints("joint") == ["joint_1", "joint_2"]
    assert "link_position" in complete.quantities("link_p")


@pytest.mark.parametrize(
    "words", [(), ("asrsim", "run", "nowhere.yaml"), ("asrsim", "run", __file__), ("asrsim", "run", '"open')]
)
def test_a_file_that_cannot_be_read_gives_no_words(line, words):
    line(*words)
    assert [complete.variants(""), complete.robot_keys(""), complete.joints(""), complete.quantities("")] == [[], [], [], []]
