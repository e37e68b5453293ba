"""Whatever writes a log: the log alone repeats the run bit for bit, and is judged by the claims that are its own."""

import re
from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.actuators import MODES
from asrsim.errors import LogError
from asrsim.log import open_log
from asrsim.log.topics import reference_topics
from asrsim.plots.claims import judge
from asrsim.robot import load_robot, with_overrides
from asrsim.runs.rerun import rerun
from asrsim.scenario import load_scenario
from asrsim.scenario.data import Imperfections
from asrsim.signals.base import Signal
from asrsim.signals.sampled import Sampled
from support.paths import ROOT

EXAMPLES = ROOT / "examples/scenarios"


def as_file(folder):
    """`asrsim run`: a task, a body, claims about both."""
    path = "task.poses=[{time: 0.1, position: [0.30, -0.05, 0.1565]}]"
    result = asrsim.run(
        EXAMPLES / "box_push_5dof.yaml", variant="soft", overrides=["duration=0.15", path], out=folder, certify=True
    )
    return [result.log]


def as_changed(folder):
    """The library: a scenario and actuators that were changed after they were read."""
    (scenario,) = load_scenario(EXAMPLES / "step_2dof.yaml", variant="soft", overrides=["duration=0.3"])
    robot = load_robot(scenario.robot)
    robot = with_overrides(robot, parameters={"joint_1": {"spring_k_1": 0.05}})
    name = next(iter(scenario.references_of("joint_1")))
    signal = Sampled(times=np.linspace(0.0, 0.3, 7), samples=np.array([0.0, -0.0, 0.1, 0.2, 0.1, 0.3, 0.25]))
    changed = replace(
        scenario,
        robot=scenario.robot,
        gravity=(0.0, 1.0, -3.0),
        seed=5,
        references={**scenario.references, "joint_1": {**scenario.references_of("joint_1"), name: signal}},
        command_imperfections={"*": Imperfections(delay=0.003, noise=0.001)},
        substeps=3,
        expect=(),
    )
    return [asrsim.run(changed, robot=robot, out=folder).log]


PRODUCERS = (as_file, as_changed)


@pytest.mark.parametrize("produce", PRODUCERS)
def test_a_log_repeats_its_run_and_checks_its_claims(tmp_path, monkeypatch, produce):
    logs = produce(tmp_path / "made")
    assert logs
    for log in logs:
        verdicts = judge(open_log(log))
        assert any(verdict.expectation.body for verdict in verdicts) if produce is as_file else verdicts == ()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for log in logs:
        again = rerun(log)
        assert not again.differences, f"{log}: {again.differences[0]}"
        assert again.identical


class Odd(Signal):
    """A signal of a library user, which no document can say."""

    kind = "odd"

    def values(self, time):
        return 0.1 * np.sin(30.0 * time)


def test_the_log_names_changes_that_no_document_can_express(tmp_path):
    (scenario,) = load_scenario(EXAMPLES / "step_2dof.yaml", variant="soft", overrides=["duration=0.1"])
    references = {**scenario.references, "joint_1": {"equilibrium_position": Odd()}}
    robot = load_robot(scenario.robot)
    heavier = replace(robot, links=tuple(replace(link, mass=1.1) if link.mass else link for link in robot.links))
    start = {"initial_positions": {"joint_1": 0.2}}
    for what, changes, own in (
        ("references", {"references": references}, robot),
        ("initial_positions", start, robot),
        ("joints and links", {}, heavier),
    ):
        given = replace(scenario, expect=(), **changes)
        log = asrsim.run(given, robot=own, out=tmp_path, overwrite=True).log
        with pytest.raises(LogError, match=rf"cannot be repeated: .*{what}"):
            rerun(log)


@pytest.mark.parametrize("mode", MODES)
def test_topics_of_references_are_in_the_order_of_the_references(mode):
    """Those of a motor have the motor's number; an equilibrium and a preset have their names."""
    topics, references = reference_topics(mode, 2), MODES[mode].references_of(2)
    assert [re.findall(r"\d", topic) for topic in topics] == [re.findall(r"\d", reference) for reference in references]
    assert topics == references or not MODES[mode].mapped
