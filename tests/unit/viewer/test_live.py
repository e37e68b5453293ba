"""Live runs on a page, without a browser: the desk's wishes, what the log says, and who may connect."""

import contextlib
import re
import socket
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import websockets.exceptions
from websockets.sync.client import connect

import asrsim
from asrsim.errors import InputError
from asrsim.log import open_log, read_log
from asrsim.outfile import csv_text
from asrsim.runs.rerun import rerun
from asrsim.simulation.drives import EXTERNAL_TORQUE
from asrsim.viewer.pull import Grip
from support.paths import EXAMPLES
from validation.models import INSTALLED

SOFT_ARM = EXAMPLES / "scenarios" / "step_2dof.yaml"


def until(fact, patience=60.0):
    end = time.monotonic() + patience
    while not (found := fact()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)
    return found


@pytest.fixture
def arm(tmp_path):
    with asrsim.view(SOFT_ARM, variant="soft", out=tmp_path / "run", speed=4.0) as view:
        until(lambda: view.show.session is not None and view.show.session.operator is not None)
        yield view


def test_a_live_view_gives_the_samples_of_a_run(arm, tmp_path):
    until(lambda: arm.show.session.time > 0.5)
    # References may be set anywhere in their ranges, which takes more substeps than the scenario's own.
    substeps = arm.show.session.simulation.substeps
    arm.close()
    live = read_log(tmp_path / "run" / "soft" / "log.mcap").samples
    run = asrsim.run(SOFT_ARM, variant="soft", overrides={"substeps": substeps}).samples
    count = min(len(live.time), len(run.time))
    assert count > 400
    for name, values in run.values.items():
        np.testing.assert_array_equal(live.values[name][:count], values[:count], err_msg=name)


@pytest.mark.parametrize(("name", "value"), [("spring_a_1", 5.0), ("damping", 0.3)])
def test_a_changed_parameter_starts_a_run_that_its_log_describes(arm, tmp_path, name, value):
    first = arm.show.session
    until(lambda: first.time > 0.1)
    first.operator._ask_for(tuned={"joint_1": {name: value}})
    second = until(lambda: arm.show.session if arm.show.session is not first else None)
    assert f"joint_1.{name}" in second.operator._news
    assert "the run before" in second.operator._page.stage.ghosts
    until(lambda: second.time > 0.1)
    drive = second.simulation.prepared.drives[0]
    assert {**drive.values, "damping": drive.joint.damping}[name] == value
    arm.close()
    for folder in ("soft", "soft_2"):
        assert rerun(tmp_path / "run" / folder / "log.mcap").identical


def test_a_change_that_is_not_physical_is_said_and_the_run_starts_again(arm):
    first = arm.show.session
    first.operator._ask_for(tuned={"joint_1": {"spring_a_1": -1.0}})
    second = until(lambda: arm.show.session if arm.show.session is not first else None)
    assert "must be at least 0" in second.operator._news
    assert second.simulation.prepared.drives[0].values["spring_a_1"] == 11.0


def test_another_variant_is_another_run(arm):
    first = arm.show.session
    first.operator._ask_for(variant="stiff")
    second = until(lambda: arm.show.session if arm.show.session is not first else None)
    assert second.simulation.scenario.variant == "stiff"


def test_a_run_that_diverges_says_so_and_a_reset_goes_on(tmp_path):
    push = {"step": {"at": 0.05, "to": 1e9}}
    scenario = asrsim.make_scenario(
        EXAMPLES / "urdf" / "dof1_sea.urdf",
        duration=1.0,
        compiled=False,
        external_torques={"joint_1": push},
        references={"joint_1": {"equilibrium_position": 0.5}},
    )
    with asrsim.view(scenario, out=tmp_path / "run") as view:
        first = until(lambda: view.show.session)
        until(lambda: "diverged at t = 0.05" in (text := first.operator._page._status.content) and "Reset" in text)
        said = re.search(r"<b>(\S+) s</b>", first.operator._page._status.content)[1]
        assert float(said) == pytest.approx(0.05, abs=0.01)
        first.operator._ask_for()
        until(lambda: view.show.session is not first)


def test_a_pull_is_the_force_of_a_spring_up_to_its_limit():
    model = asrsim.prepare(SOFT_ARM, variant="soft").model
    q = np.array([0.4, -0.7])
    frames = model.poses(q)
    place = frames["link_2"][:3, 3] + frames["link_2"][:3, :3] @ [0.05, 0.01, 0.0]
    for away, size in ((0.1, 5.0), (1.0, 20.0)):
        target = place + away * np.array([0.6, 0.8, 0.0])
        torques, pull = Grip.at("link_2", frames["link_2"], place, target).torques(model, q, 50.0, 20.0)
        np.testing.assert_allclose(pull.force, size * np.array([0.6, 0.8, 0.0]), atol=1e-12)
        # Virtual work: the force on the way of the point is the torques on the way of the joints.
        step = 1e-7 * np.array([0.3, -0.5])
        moved, _ = model.pose(q + step, "link_2", (0.05, 0.01, 0.0))
        assert pull.force @ (moved - place) == pytest.approx(torques @ step, rel=1e-5)


def test_the_torques_of_a_pull_do_the_work_of_its_force(arm):
    session = arm.show.session
    desk, model = session.operator, session.simulation.model
    until(lambda: desk.subject.history.latest is not None)
    session.paused = True
    until(lambda: session.time == (time.sleep(0.1) or session.time))
    positions = session.simulation.observe().link_position
    point = (0.05, 0.0, 0.0)
    start, _ = model.pose(positions, "link_2", point)
    desk._grip = Grip("link_2", point, start + np.array([0.01, 0.03, 0.0]))
    torques = desk.ask(session)
    step = 1e-6 * np.array([0.3, -0.5])
    moved, _ = model.pose(positions + step, "link_2", point)
    work = sum(torques[joint, EXTERNAL_TORQUE] * way for joint, way in zip(model.joints, step, strict=True))
    assert work == pytest.approx(desk._pull.force @ (moved - start), rel=1e-4)


def test_letting_go_gives_the_torque_back_to_the_scenario(arm, tmp_path):
    session = arm.show.session
    desk = session.operator
    until(lambda: desk.subject.history.latest is not None)
    frame = session.simulation.model.poses(session.simulation.observe().link_position)["link_2"]
    desk._grip = Grip.at("link_2", frame, frame[:3, 3] + 0.05, frame[:3, 3] + 0.2)
    until(lambda: desk._pull is not None)
    desk._grip = None
    until(lambda: desk._pull is None)
    until(lambda: session.time > 0.2)
    arm.close()
    path = tmp_path / "run" / "soft" / "log.mcap"
    last = {one.joint: one for one in open_log(path).commands()}
    assert {(one.reference, one.value) for one in last.values()} == {(EXTERNAL_TORQUE, None)}
    assert rerun(path).identical


def test_pages_of_other_origins_are_refused(arm):
    address = arm.address.replace("http", "ws")
    with pytest.raises(websockets.exceptions.InvalidStatus):
        connect(address, origin="https://example.org", subprotocols=["viser-v1.1.1"]).__enter__()
    with connect(address, origin=arm.address, subprotocols=["viser-v1.1.1"]) as client:
        assert client.recv(timeout=20)


def test_a_client_that_never_reads_neither_stops_the_run_nor_its_end(arm):
    with socket.create_connection(("127.0.0.1", arm.server.port)) as client:
        head = "GET / HTTP/1.1", f"Host: localhost:{arm.server.port}", "Upgrade: websocket", "Connection: Upgrade"
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Protocol: viser-v1.1.1"
        client.sendall("\r\n".join([*head, *key, "", ""]).encode())
        before = arm.show.session.time
        until(lambda: arm.show.session.time > before + 1.0)
        began = time.monotonic()
        arm.close()
        assert time.monotonic() - began < 20.0


def test_a_port_that_is_taken_is_named():
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"127.0.0.1:{port} cannot be opened"):
            asrsim.view(SOFT_ARM, variant="soft", port=port)


@pytest.mark.parametrize("speed", [0.0, -1.0, 1e9, float("nan"), float("inf")])
def test_a_speed_that_no_run_can_have_is_refused(speed):
    with pytest.raises(InputError, match=r"speed: must be from 0.01 to 100"):
        asrsim.view(SOFT_ARM, variant="soft", speed=speed)


@pytest.mark.parametrize("port", [-1, 99999])
def test_a_port_that_does_not_exist_is_refused(port):
    with pytest.raises(InputError, match="port: must be from 0 to 65535"):
        asrsim.view(SOFT_ARM, variant="soft", port=port)


def test_a_variant_is_a_ghost_that_moves_as_its_scenario_states(arm):
    desk = arm.show.session.operator
    desk._add_ghost("stiff")
    companion, _ = until(lambda: desk._page.stage.ghosts.get("stiff"))
    run = asrsim.run(SOFT_ARM, variant="stiff").samples
    np.testing.assert_array_equal(companion.history.at(0.3).values["link_position"][0], run.values["link_position"][300])


def test_logs_and_recordings_move_beside_a_live_run(tmp_path):
    shorter = {"duration": 0.3}
    run = asrsim.run(SOFT_ARM, variant="soft", overrides=shorter, out=tmp_path / "before")
    series = run["joint_1"]
    names = ["time [s]", "joint_1.link_position [rad]", "joint_1.reference_1 [rad]"]
    lab = tmp_path / "lab.csv"
    lab.write_text(csv_text(names, np.column_stack([run.time, series.link_position, series.reference_1])))
    with asrsim.view(SOFT_ARM, run.log, variant="soft", overrides=shorter, experiments=[lab]) as view:
        desk = until(lambda: view.show.session and view.show.session.operator)
        assert {Path(name).name for name in desk._page.stage.ghosts} == {"before", "lab.csv"}


def test_a_plot_that_is_removed_is_drawn_no_more(arm):
    plots = arm.show.session.operator._page.plots
    plots.add("motor_1_torque")
    (*others, last) = plots.plots
    last.remove()
    last.remove()
    assert plots.plots == others


def drag(desk, body, place, target):
    """What a user does with the mouse: takes a body at a place in the world, and holds the hand at a target."""
    desk._drag(body, SimpleNamespace(phase="start", start_position=place, end_position=place))
    desk._drag(body, SimpleNamespace(phase="drag", start_position=place, end_position=target))


INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
FLOATING = f"""<robot name="satellite"><link name="hull">{INERTIAL}</link><link name="boom">{INERTIAL}</link>
<joint name="hinge" type="continuous"><parent link="hull"/><child link="boom"/><origin xyz="0 0 0.3"/></joint></robot>"""


@pytest.mark.parametrize("engine", INSTALLED)
def test_the_mouse_pulls_objects_and_robots_with_a_floating_base(tmp_path, engine):
    ball = {"shape": "sphere", "size": 0.05, "mass": 0.5, "position": [1.0, 0.0, 0.5]}
    (tmp_path / "robot.urdf").write_text(FLOATING)
    wall = {"shape": "box", "size": [0.1, 0.1, 0.1], "position": [2.0, 0.0, 0.5]}
    scenario = asrsim.make_scenario(
        tmp_path / "robot.urdf",
        duration=1.0,
        gravity=[0, 0, 0],
        engine=engine,
        compiled=False,
        base={"fixed": False},
        world={"objects": {"ball": ball, "wall": wall}},
    )
    with asrsim.view(scenario, out=tmp_path / "run") as view:
        desk = until(lambda: view.show.session and view.show.session.operator)
        session = view.show.session
        until(lambda: desk.subject.history.latest)
        drag(desk, "wall", [2.0, 0.0, 0.5], [2.1, 0.0, 0.5])
        assert desk._grip is None
        assert "'wall' cannot be pulled" in desk._news
        for body in ("ball", "hull"):
            before = desk.subject.history.latest.bodies[body][-1, :3]
            drag(desk, body, before, before + np.array([0.0, 0.2, 0.0]))
            until(lambda body=body, before=before: desk.subject.history.latest.bodies[body][-1, 1] > before[1] + 0.01)
            assert desk._pull.force[1] > 0.0
            desk._drag(body, SimpleNamespace(phase="end"))
            until(lambda: desk._held is None)
    assert session.figures()["applied"] > 10
    assert rerun(tmp_path / "run" / "log.mcap").identical
