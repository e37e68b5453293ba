"""The page in a real browser: what a user does there reaches the simulation, and what happens reaches the page.

All tests share a browser, a live view and a played-back log, since a page takes long to load without a graphics card.
"""

import re
import time

import numpy as np
import pytest

import asrsim
from asrsim.log import open_log, read_log
from asrsim.runs.rerun import rerun
from support.chromium import open_page, until
from support.paths import EXAMPLES

pytestmark = pytest.mark.browser

STIFFNESS = 5.0
"""Stiffness of the spring of the joint that is pulled, N m/rad."""


@pytest.fixture(scope="module")
def browser():
    with open_page() as make:
        yield make


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    """A live view of an arm whose reference moves, and the folder of its first log."""
    folder = tmp_path_factory.mktemp("live") / "run"
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf",
        duration=1.0,
        gravity=[0, 0, 0],
        compiled=False,
        references={"joint_1": {"equilibrium_position": {"sinusoid": {"amplitude": 0.5, "frequency": 0.7}}}},
        parameters={"joint_1": {"spring_stiffness": STIFFNESS}},
        link_damping={"joint_1": {"constant": 0.2}},
    )
    with asrsim.view(scenario, out=folder) as view:
        yield view, folder


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A log that is played back beside another one, and the folder of both."""
    folder = tmp_path_factory.mktemp("runs")
    asrsim.run_variants(EXAMPLES / "scenarios" / "step_2dof.yaml", out=folder, overrides={"duration": 1.0})
    with asrsim.view(folder / "soft", folder / "stiff") as view:
        yield view, folder


def position(view):
    return view.show.session.simulation.observe().link_position[0]


def time_of_standing(session):
    """Time at which a paused run stands, s. Its operator is asked before each step: after two questions, none is under way."""
    questions, ask = [], session.operator.ask

    def counted(session):
        questions.append(session.paused)
        return ask(session)

    session.operator.ask = counted
    until(lambda: questions.count(True) > 1)
    return session.time


def at_rest(view):
    """Whether the joint stays where it is for 0.6 s of simulated time."""
    readings = []
    for _ in range(4):
        readings.append(position(view))
        then = view.show.session.time + 0.2
        until(lambda then=then: view.show.session.time > then)
    return np.ptp(readings) < 1e-9


def test_a_typed_number_moves_the_robot_while_the_scenarios_reference_moves(live, browser):
    view, _ = live
    page = browser(view)
    page.tab("Joints")
    page.number("equilibrium position, rad", -0.3)
    until(lambda: abs(position(view) + 0.3) < 1e-3)


def test_a_dragged_link_rests_where_spring_and_pull_balance(live, browser):
    """Mode 3: the motor stands at its reference. At rest, the deflection is the torque of the pull divided by the stiffness."""
    view, _ = live
    page = browser(view)
    page.tab("Joints")
    page.number("equilibrium position, rad", 0)
    until(lambda: abs(position(view)) < 1e-6)
    # The ball hangs 0.04 m below the axis.
    desk = view.show.session.operator

    def held():
        return desk._pull is not None and np.linalg.norm(desk._pull.force) > 0.5

    with page.dragging(view, (0.0, 0.0, 0.21), (60, -15), held):
        # The hand rests too.
        until(lambda: at_rest(view))
        pull, grip = desk._pull, desk._grip
        q = view.show.session.simulation.observe().link_position
        torque = view.show.session.simulation.model.jacobian(q, grip.body, grip.point)[:3, 0] @ pull.force
        assert abs(torque) > 5e-3
        assert q[0] == pytest.approx(torque / STIFFNESS, abs=1e-6)
        assert np.linalg.norm(pull.force) == pytest.approx(50.0 * np.linalg.norm(pull.target - pull.point), rel=1e-6)
        until(lambda: page.has(re.compile(r"pull [\d.]+ N")))
    until(lambda: abs(position(view)) < 1e-6)


def test_pause_step_reset_and_what_was_done_is_in_logs_that_repeat(live, browser):
    view, folder = live
    page = browser(view)
    page.tab("Run")
    # A new run, since that of the other tests is long.
    first = view.show.session
    page.click("Reset")
    until(lambda: view.show.session is not first)
    session = view.show.session
    page.tab("Joints")
    page.number("equilibrium position, rad", 0.25)
    until(lambda: session.operator._by_hand.get(("joint_1", "equilibrium_position")) == 0.25)
    page.tab("Run")
    page.click("Pause")
    until(lambda: session.paused)
    before = time_of_standing(session)
    page.click("Step")
    until(lambda: session.time == pytest.approx(before + 1e-3))
    page.click("Go on")
    until(lambda: session.time > before + 0.1)
    page.click("Reset")
    second = until(lambda: view.show.session if view.show.session is not session else None)
    until(lambda: second.time > 0.2)
    page.click("Reset")
    until(lambda: view.show.session is not second)
    assert not page.errors
    logs = [folder.with_name(name) / "log.mcap" for name in ("run_2", "run_3")]
    assert list(open_log(logs[0]).commands())[-1].value == 0.25
    assert not list(open_log(logs[1]).commands())
    assert rerun(logs[0]).identical


def test_a_log_is_played_back_with_a_ghost_and_plots(played, browser):
    view, folder = played
    page = browser(view, width=1280, height=600)
    player = view.show
    until(lambda: not player.playing)
    assert player.time == pytest.approx(1.0)
    page.number("Time, s", 0.25)
    until(lambda: player.time == pytest.approx(0.25))
    ((companion, ghost),) = player._page.stage.ghosts.values()
    until(lambda: ghost.nodes["link_1"].wxyz[0] < 0.9999)
    stiff = read_log(folder / "stiff" / "log.mcap").samples
    row = int(np.abs(stiff.time - 0.25).argmin())
    assert companion.history.at(0.25).values["link_position"][0].tolist() == stiff.values["link_position"][row].tolist()
    plot = player._page.plots.plots[0]._plot
    until(lambda: plot.data[0][-1] == pytest.approx(0.25, abs=0.01))
    assert [one["label"] for one in plot.series][:2] == ["s", "joint_1"]
    # Points on whole pixels would make stairs of a slope.
    assert [one["pxAlign"] for one in plot.series[1:]] == [0] * (len(plot.series) - 1)
    assert page.count(".uplot canvas") == 2
    page.tab("Show")
    page.check(companion.label)
    until(lambda: not ghost.visible)


@pytest.mark.parametrize(("width", "lit"), [(1280, False), (420, False), pytest.param(1280, True, marks=pytest.mark.slow)])
def test_no_error_reaches_the_console(played, browser, width, lit):
    view, _ = played
    page = browser(view, width=width, height=600, lit=lit)
    until(lambda: page.has("step_2dof / soft"))
    # The robot is drawn after the controls.
    until(lambda: page.count("canvas"))
    time.sleep(1.0)
    assert not page.errors
