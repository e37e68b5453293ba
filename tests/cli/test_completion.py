"""Words that the shell completes."""

import pytest

from asrsim.actuators import ACTUATORS
from asrsim.cli import complete
from asrsim.metrics import MEASURES
from asrsim.plots import FIGURES
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
    assert complete.joints("joint_2") == ["joint_2"]
    assert complete.quantities("link_") == ["link_position", "link_velocity", "link_torque"]


@pytest.mark.parametrize(
    ("words", "known"), [(complete.actuators, ACTUATORS), (complete.measures, MEASURES), (complete.figures, FIGURES)]
)
def test_names_that_begin_so_are_completed(words, known):
    assert words("") == [*known.names()]
    for name in known.names():
        assert words(name[:2]) == [other for other in known.names() if other.startswith(name[:2])]


@pytest.mark.parametrize(
    "words", [(), ("asrsim", "run", "nowhere.yaml"), ("asrsim", "run", __file__), ("asrsim", "run", '"open')]
)
def test_a_file_that_cannot_be_read_gives_no_words(line, words):
    line(*words)
    assert [complete.variants(""), complete.robot_keys(""), complete.joints(""), complete.quantities("")] == [[], [], [], []]
