"""Examination of a scenario: every problem at once, and nothing twice."""

from collections import Counter

import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.scenario import check as checks
from asrsim.simulation import examine as examination
from asrsim.simulation.examine import examine
from asrsim.simulation.prepare import prepare

CLAIM = "\nexpect: [{joint: elbow, quantity: link_position, measure: no_such_measure, value: 0}]\n"


@pytest.fixture
def counted(monkeypatch):
    """Number of calls of the checks of an examination, by name."""
    calls = Counter()

    def count(module, name):
        function = getattr(module, name)

        def counting(*arguments, **options):
            calls[name] += 1
            return function(*arguments, **options)

        monkeypatch.setattr(module, name, counting)

    for name in ("misfits", "robot_of", "doubts", "weight_warnings", "warnings_of", "make_drives"):
        count(examination, name)
    for name in ("changed_robot", "signal_faults", "unknown_names"):
        count(checks, name)
    return calls


def _run(path, folder):
    asrsim.run(path, out=folder, overwrite=True)


def _simulation(path, _folder):
    with asrsim.Simulation(path) as simulation:
        simulation.advance(1)


def _worlds(path, _folder):
    with asrsim.Worlds(path, 2) as worlds:
        worlds.advance(1)


@pytest.mark.parametrize("use", [_run, _simulation, _worlds], ids=["run", "Simulation", "Worlds"])
def test_nothing_is_examined_twice(use, tiny, counted, tmp_path):
    use(tiny.scenario, tmp_path / "out")
    assert counted["misfits"] == counted["robot_of"] == 1
    assert {name: count for name, count in counted.items() if count > 1} == {}


def test_a_plan_is_not_examined_again(tiny, counted):
    plan = examine(tiny.scenario)
    before = dict(counted)
    prepare(plan).make_engine().close()
    assert dict(counted) == before


def test_problems_of_robot_scenario_and_claims_come_in_one_error(tiny):
    robot = tiny.robot.read_text()
    tiny.robot.write_text(robot.replace('<mass value="', '<mass value="-', 1))
    text = tiny.scenario.read_text()
    tiny.scenario.write_text(text + "initial: {nobody: 0}\n" + CLAIM)
    with pytest.raises(InputError) as caught:
        examine(tiny.scenario)
    files = {problem.file.name for problem in caught.value.problems}
    codes = {problem.code for problem in caught.value.problems}
    assert files == {tiny.robot.name, tiny.scenario.name}
    assert {"unknown-joint", "bad-expectation"} <= codes, codes
    assert all(problem.line for problem in caught.value.problems)
