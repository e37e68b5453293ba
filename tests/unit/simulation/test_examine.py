"""Examination of a scenario: every problem at once, and nothing twice."""

from collections import Counter

import pytest

import asrsim
from asrsim.errors import InputError
from asrsim.scenario import check as checks
from asrsim.simulation import examine as examination
from asrsim.simulation.examine import examine
from asrsim.simulation.prepare import prepare
from asrsim.simulation.run import simulate
from asrsim.viewer.open import maker

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


@pytest.fixture
def faulty(tiny):
    """The tiny scenario with a fault in the robot, an unknown key, an unknown joint, and an unknown measure."""
    robot = tiny.robot.read_text()
    tiny.robot.write_text(robot.replace('<mass value="', '<mass value="-', 1))
    tiny.scenario.write_text(f"{tiny.scenario.read_text()}initial: {{nobody: 0}}\nduraton: 1\n{CLAIM}")
    return tiny


DOORS = {
    "run": asrsim.run,
    "run_variants": asrsim.run_variants,
    "simulate": simulate,
    "Simulation": asrsim.Simulation,
    "Worlds": lambda path: asrsim.Worlds(path, 2),
    "prepare": asrsim.prepare,
    "Twin": asrsim.Twin,
    "learn": lambda path: asrsim.learn(path, path.parent / "learned"),
    "sweep": lambda path: asrsim.sweep(path, {"duration": [0.1, 0.2]}),
    "make_env": lambda path: asrsim.make_env(path),
    "view": lambda path: maker(path),
    "export": lambda path: asrsim.export(path, path.parent / "robot.xml"),
}


@pytest.mark.parametrize("door", DOORS)
def test_every_door_shows_the_problems_of_robot_scenario_and_claims_together(door, faulty):
    with pytest.raises(InputError) as caught:
        DOORS[door](faulty.scenario)
    problems = caught.value.problems
    assert {problem.file.name for problem in problems} == {faulty.robot.name, faulty.scenario.name}
    codes = sorted(problem.code for problem in problems)
    assert codes == ["bad-expectation", "negative-mass", "unknown-joint", "unknown-key"]
    assert all(problem.line for problem in problems)


@pytest.mark.parametrize("command", ["check", "run", "sweep", "live", "view", "ilc"])
def test_every_command_shows_the_same_problems(command, faulty, asrsim_command):
    more = ["--over", "duration=[0.1, 0.2]"] if command == "sweep" else []
    outcome = asrsim_command(command, faulty.scenario, *more)
    assert outcome.code == 1
    text = outcome.out + outcome.err
    assert all(word in text for word in ("mass", "nobody", "duraton", "no_such_measure")), text


def test_variants_are_examined_before_the_first_one_runs(tiny, asrsim_command):
    tiny.scenario.write_text(tiny.scenario.read_text() + "variants: {first: {}, second: {initial: {nobody: 0}}}\n")
    outcome = asrsim_command("run", tiny.scenario, "--out", "out")
    assert outcome.code == 1
    assert "initial.nobody" in outcome.err
    assert not (tiny.folder / "out").exists()


def test_a_folder_of_other_results_is_reported_with_the_problems_of_the_scenario(faulty):
    folder = faulty.folder / "taken"
    folder.mkdir()
    (folder / "log.mcap").write_text("mine")
    with pytest.raises(InputError) as caught:
        asrsim.run(faulty.scenario, out=folder)
    assert "output" in {problem.code for problem in caught.value.problems}
    assert "log.mcap: exists and was not written by asrsim" in str(caught.value)
