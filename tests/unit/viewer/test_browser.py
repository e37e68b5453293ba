"""The page in a real browser: what a user does there reaches the simulation, and what happens reaches the page."""

import re
import time

import numpy as np
import pytest

import asrsim
from asrsim.log import open_log, read_log
from asrsim.runs.repeat import repeat
from support.chromium import open_page
from support.paths import EXAMPLES

SOFT_ARM = EXAMPLES / "scenarios" / "step_2dof.yaml"
STIFFNESS = 5.0
"""Stiffness of the spring of the joint that is pulled, N m/rad."""


@pytest.fixture(scope="module")
def browser():
    with open_page() as make:
        yield make


@pytest.fixture
def arm(tmp_path, browser):
    """A live view of the soft arm, and its page."""
    with asrsim.view(SOFT_ARM, variant="soft", out=tmp_path / "run") as view:
        yield view, browser(view.address)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    asrsim.run_variants(SOFT_ARM, out=folder, overrides={"duration": 1.0})
    return folder / "soft" / "log.mcap"


def until(fact, patience=120.0):
    """Wait until a fact holds. Machines that draw 3-D scenes without a graphics card are slow."""
    end = time.monotonic() + patience
    while not (found := fact()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)
    return found


def positions(view):
    return view.show.session.simulation.observe().link_position


def at_rest(view):
    """Whether the first joint stays where it is for 0.6 s of simulated time."""
    readings = []
    for _ in range(4):
        readings.append(positions(view)[0])
        then = view.show.session.time + 0.2
        until(lambda then=then: view.show.session.time > then)
    return np.ptp(readings) < 1e-9


def test_a_typed_number_moves_the_robot_while_the_scenarios_reference_moves(tmp_path, browser):
    wave = {"sinusoid": {"amplitude": 0.5, "frequency": 0.7}}
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf", duration=1.0, gravity=[0, 0, 0],
        references={"joint_1": {"equilibrium_position": wave}},
        parameters={"joint_1": {"spring_stiffness": STIFFNESS}}, link_damping={"joint_1": {"constant": 0.2}},
    )  # fmt: skip
    with asrsim.view(scenario, out=tmp_path / "run") as view:
        page = browser(view.address)
        page.tab("Joints")
        page.number("equilibrium position, rad", -0.3)
        until(lambda: abs(positions(view)[0] + 0.3) < 1e-3)


def test_pause_step_reset_and_what_was_done_is_in_a_log_that_repeats(arm, tmp_path):
    view, page = arm
    page.click("Pause")
    session = view.show.session
    until(lambda: session.paused)
    before = until(lambda: session.time)
    page.click("Step")
    until(lambda: session.time == pytest.approx(before + 1e-3))
    page.click("Go on")
    page.tab("Joints")
    page.number("equilibrium position, rad", 0.25)
    until(lambda: session.figures()["applied"])
    page.tab("Run")
    page.click("Reset")
    until(lambda: view.show.session is not session)
    page.tab("Joints")
    page.number("equilibrium position, rad", -0.4)
    until(lambda: view.show.session.operator._by_hand.get(("joint_1", "equilibrium_position")) == -0.4)
    until(lambda: view.show.session.time > 0.5)
    view.close()
    first, path = (tmp_path / "run" / name / "log.mcap" for name in ("soft", "soft_2"))
    assert list(open_log(first).commands())[-1].value == 0.25
    commands = list(open_log(path).commands())
    assert {(one.joint, one.reference) for one in commands} == {("joint_1", "equilibrium_position")}
    assert commands[-1].value == -0.4
    assert repeat(path).identical


def test_a_dragged_link_rests_where_spring_and_pull_balance(tmp_path, browser):
    """Mode 3: the motor stands at its reference. At rest, the deflection is the torque of the pull divided by the stiffness."""
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf", duration=1.0, gravity=[0, 0, 0],
        parameters={"joint_1": {"spring_stiffness": STIFFNESS}}, link_damping={"joint_1": {"constant": 0.2}},
    )  # fmt: skip
    with asrsim.view(scenario, out=tmp_path / "run") as view:
        page = browser(view.address)
        until(view.server.viser.get_clients)
        # The ball hangs 0.04 m below the axis.
        with page.dragging(page.place(view, (0.0, 0.0, 0.21)), (60, -15)):
            desk = view.show.session.operator
            until(lambda: desk._pull is not None and np.linalg.norm(desk._pull.force) > 0.5)
            # The hand rests too.
            until(lambda: at_rest(view))
            pull, q, simulation = desk._pull, positions(view), view.show.session.simulation
            grip = desk._grip
            torque = simulation.model.jacobian(q, grip.body, grip.point)[:3, 0] @ pull.force
            assert abs(torque) > 5e-3
            assert q[0] == pytest.approx(torque / STIFFNESS, abs=1e-6)
            assert np.linalg.norm(pull.force) == pytest.approx(50.0 * np.linalg.norm(pull.target - pull.point), rel=1e-6)
            assert page.has(re.compile(r"pull [\d.]+ N"))
        until(lambda: abs(positions(view)[0]) < 1e-6)
    assert repeat(tmp_path / "run" / "log.mcap").identical


def test_a_log_is_played_back_with_a_ghost_and_plots(log, browser):
    with asrsim.view(log, log.parents[1] / "stiff" / "log.mcap") as view:
        page = browser(view.address)
        player = view.show
        until(lambda: not player.playing)
        assert player.time == pytest.approx(1.0)
        page.number("Time, s", 0.25)
        until(lambda: player.time == pytest.approx(0.25))
        (companion, ghost), = player._page.stage.ghosts.values()  # fmt: skip
        until(lambda: ghost.nodes["link_1"].wxyz[0] < 0.9999)
        stiff = read_log(log.parents[1] / "stiff" / "log.mcap").samples
        row = int(np.abs(stiff.time - 0.25).argmin())
        assert companion.history.at(0.25).values["link_position"][0].tolist() == stiff.values["link_position"][row].tolist()
        plot = player._page.plots.plots[0]._plot
        until(lambda: plot.data[0][-1] == pytest.approx(0.25, abs=0.01))
        assert [one["label"] for one in plot.series][:2] == ["s", "joint_1"]
        assert page.count(".uplot canvas") == 2
        page.tab("Show")
        page.check(companion.label)
        until(lambda: not ghost.visible)


@pytest.mark.parametrize("width", [1280, 420])
def test_no_error_reaches_the_console(log, browser, width):
    with asrsim.view(log) as view:
        page = browser(view.address, width=width)
        until(lambda: page.has("step_2dof / soft"))
        time.sleep(1.0)
        assert not page.errors
