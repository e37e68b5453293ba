"""What a page shows comes from logs, recordings, twins and robot files alike."""

import time
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import asrsim
from asrsim.cli.app import COMMANDS
from asrsim.errors import InputError, LogError
from asrsim.log import open_log, read_log
from asrsim.outfile import csv_text
from asrsim.robot.model import Joint
from asrsim.runs.rerun import rerun
from asrsim.samples import JointInfo, Samples
from asrsim.scenario import load_scenario
from asrsim.simulation.prepare import prepare
from asrsim.twin.follow import Followed, follow_recording
from asrsim.viewer.colours import words_of
from asrsim.viewer.events import events_of, limit_events
from asrsim.viewer.figure import frames_of
from asrsim.viewer.history import History
from asrsim.viewer.page import Page
from asrsim.viewer.recorded import recorded
from asrsim.viewer.server import PageServer
from asrsim.viewer.stage import Pull, ViewerStage
from asrsim.viewer.subject import as_companion, logged
from asrsim.viewer.twin import FollowView, followed_player
from support.paths import EXAMPLES
from support.plot_example import made_up_log
from support.turned_chain import TURNED

SOFT_ARM = EXAMPLES / "scenarios" / "step_2dof.yaml"


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return asrsim.run(SOFT_ARM, variant="soft", overrides={"duration": 0.6}, out=tmp_path_factory.mktemp("run") / "soft")


@pytest.fixture
def server():
    with PageServer(0) as server:
        yield server


def test_a_history_keeps_the_newest_samples_and_the_rate_of_the_page(result):
    history = History(result.run.info.joints)
    samples = result.samples
    whole = History(history.joints, samples)
    for first in range(0, 600, 40):
        history.write(whole.rows(samples.time[first], samples.time[first + 40]))
    assert history.latest.time[-1] == samples.time[599]
    time, values = history.curve("joint_1", "link_position", 0.1, 0.5)
    assert np.diff(time).max() == pytest.approx(0.005)
    np.testing.assert_array_equal(values, np.interp(time, samples.time, samples.values["link_position"][:, 0]))
    _, deflection = history.curve("joint_1", "deflection", 0.1, 0.5)
    np.testing.assert_array_equal(deflection, np.interp(time, samples.time, result["joint_1"].deflection))


def test_a_history_in_pieces_is_that_of_the_whole(result):
    """The nearest sample to a time is the same, whatever pieces the samples came in."""
    samples = result.samples
    whole, pieces = History(result.run.info.joints, samples), History(result.run.info.joints)
    for first, last in pairwise((0, 100, 110, 350, len(samples.time))):
        pieces.write(whole.rows(samples.time[first], samples.time[last - 1] + 1e-6))
    assert pieces.span == pytest.approx(whole.span, abs=0.006)
    for wanted in (-1.0, 0.0, 0.0502, 0.2, 0.333, 0.45, 0.6, 2.0):
        (near,) = pieces.at(wanted).time
        assert near == pytest.approx(min(max(wanted, 0.0), samples.time[-1]), abs=0.006), wanted
        np.testing.assert_array_equal(
            pieces.at(wanted).values["link_position"][0], samples.values["link_position"][np.abs(samples.time - near).argmin()]
        )


def test_the_trace_is_the_way_of_the_tip_in_the_last_seconds(result, server):
    stage = ViewerStage(server.viser, logged(result.log))
    (link, point), model = stage.tip, stage.subject.scene.model
    stage.draw_trace(0.5)
    assert "trace" not in stage._lines
    stage.look.trace = True
    stage.draw_trace(0.5)
    segments = np.asarray(stage._lines["trace"].points)
    np.testing.assert_allclose(segments[1:, 0], segments[:-1, 1], atol=1e-6)
    for end, moment in ((segments[0, 0], 0.0), (segments[-1, 1], 0.5)):
        frame = model.poses(stage.subject.history.at(moment).values["link_position"][0])[link]
        np.testing.assert_allclose(end, frame[:3, :3] @ point + frame[:3, 3], atol=5e-3)
    stage.look.trace = False
    stage.draw_trace(0.5)
    assert "trace" not in stage._lines


def test_in_a_narrow_window_the_robot_stands_above_the_controls(server):
    """The camera sinks across its view by a fifth of the height that it sees at the robot, and turns nowhere."""
    page = Page(server)
    start = server.viser.initial_camera
    for width, share in ((1200, 0.0), (400, 0.2)):
        camera = SimpleNamespace(image_width=width, position=np.array(start.position), look_at=np.array(start.look_at))
        page._make_room(SimpleNamespace(camera=camera, atomic=nullcontext))
        way, moved = np.subtract(start.look_at, start.position), camera.position - start.position
        np.testing.assert_allclose(np.subtract(camera.look_at, camera.position), way, atol=1e-9)
        seen = 2.0 * np.linalg.norm(way) * np.tan(0.5 * start.fov)
        assert np.linalg.norm(moved) == pytest.approx(share * seen)
        assert moved @ way == pytest.approx(0.0, abs=1e-9)
        assert moved[2] <= 0.0


def stands_where_the_model_puts_it(stage, sample):
    """Assert that each body and mesh on the page has the frame that the robot's model gives it."""
    stage.draw(sample)
    frames = stage.subject.scene.model.poses(sample.values["link_position"][0])
    places = {"": np.eye(4)}
    for name, node in stage.figure.nodes.items():
        # A node is placed in the node before it, as its path says.
        own = np.eye(4)
        own[:3, :3], own[:3, 3] = Rotation.from_quat(node.wxyz, scalar_first=True).as_matrix(), node.position
        places[node.name] = places.get(node.name.rpartition("/")[0], np.eye(4)) @ own
        np.testing.assert_allclose(places[node.name], frames[name], atol=1e-12)
    for link, meshes in stage.figure.meshes.items():
        for mesh, _ in meshes:
            place = places[mesh.name.rpartition("/")[0]] @ [*mesh.position, 1.0]
            np.testing.assert_allclose(place, frames[link][:, 3], atol=1e-12)


def test_links_behind_fixed_joints_stand_on_the_links_that_carry_them(tmp_path, server):
    (tmp_path / "turned.urdf").write_text(TURNED)
    start = {"j0": 0.4, "j2": 0.1, "j3": -1.0}
    scenario = asrsim.make_scenario(tmp_path / "turned.urdf", duration=0.01, compiled=False, initial=start, gravity=[0, 0, 0])
    stage = ViewerStage(server.viser, logged(asrsim.run(scenario, out=tmp_path / "run").log))
    assert len(stage.figure.nodes) == 4
    stands_where_the_model_puts_it(stage, stage.subject.history.at(0.005))


def test_links_stand_where_the_model_puts_them_and_are_coloured_by_deflection(result, server):
    stage = ViewerStage(server.viser, logged(result.log))
    sample = stage.subject.history.at(0.2)
    stage.look.colour = "deflection"
    stands_where_the_model_puts_it(stage, sample)
    ((mesh, own), *_) = stage.figure.meshes["link_1"]
    assert tuple(mesh.color) != own
    assert "deflection, rad" in stage.legend()
    stage.look.colour = ""
    stage.draw(sample)
    assert (tuple(mesh.color), stage.legend()) == (own, "")


def test_objects_of_the_world_fall_on_the_page_and_ghosts_have_none(tiny, server):
    """A ball in free fall; only the robot has ghosts."""
    ball = {"shape": "sphere", "size": 0.05, "mass": 0.5, "position": [1.0, 0.0, 2.0], "rpy": [0.3, 0.0, 0.0]}
    keys = {"gravity": [0, 0, -9.81], "compiled": False, "world": {"objects": {"ball": ball}}}
    scenario = asrsim.make_scenario(tiny.robot, duration=0.3, **keys)
    stage = ViewerStage(server.viser, logged(asrsim.run(scenario, out=tiny.folder / "run").log))
    stage.draw(stage.subject.history.at(0.2))
    node = stage.figure.nodes["ball"]
    np.testing.assert_allclose(node.position, [1.0, 0.0, 2.0 - 0.5 * 9.81 * 0.2**2], atol=2e-3)
    np.testing.assert_allclose(node.wxyz, Rotation.from_rotvec([0.3, 0.0, 0.0]).as_quat(scalar_first=True), atol=1e-6)
    assert len(stage.figure.meshes["ball"]) == 1
    assert "ball" not in stage._equilibrium.nodes


def test_a_motion_too_slow_for_one_picture_is_shown_after_many(result, server):
    figure = ViewerStage(server.viser, logged(result.log)).figure
    sample = result.samples
    for angle in np.linspace(0.0, 1e-5, 400):
        values = sample.values | {"link_position": np.full((1, 2), angle)}
        frames = figure.place(replace(sample, time=sample.time[:1], values=values))
    node = figure.nodes["link_2"]
    turn = Rotation.from_quat(node.wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(turn, frames["link_1"][:3, :3].T @ frames["link_2"][:3, :3], rtol=0, atol=5e-7)


def test_a_recording_stands_beside_the_run_on_the_clock_that_plot_finds(result, tmp_path):
    """The recording is the run itself, 0.07 s later on its own clock."""
    series = result["joint_1"]
    columns = np.column_stack([result.time + 0.07, series.link_position, series.reference_1])
    (tmp_path / "lab.csv").write_text(
        csv_text(["time [s]", "joint_1.link_position [rad]", "joint_1.reference_1 [rad]"], columns)
    )
    reader = open_log(result.log)

    def read(quantities, joints):
        return reader.read(quantities=quantities, joints=joints).samples

    found = recorded(tmp_path / "lab.csv", reader.info, read)
    assert found.notes[0].startswith("lab.csv: lag 0.07 s")
    row = found.history.at(0.3).values["link_position"][0]
    assert row[0] == pytest.approx(series.link_position[300], abs=1e-4)
    assert np.isnan(row[1])
    times, values = found.curve("joint_1", "link_position", 0.1005, 0.2005)
    assert times == pytest.approx(result.time[101:201], abs=1e-4)
    assert values == pytest.approx(series.link_position[101:201])
    assert found.curve("joint_2", "link_position", 0.1, 0.2)[0].size == 0


def test_events_are_the_beginnings_of_limits(result):
    samples, robot = result.samples, result.run.robot
    torque = samples.values["motor_1_torque"][:, 0]
    most = float(np.abs(torque).max())
    parameters = {"joint_1": {"motor_1_max_torque": most}}
    found = [event for event in limit_events(samples, result.run.info.joints, robot, parameters) if "motor 1" in event.text]
    assert found[0].time == samples.time[np.flatnonzero(np.abs(torque) >= 0.999 * most)[0]]


def test_every_kind_of_limit_of_every_joint_is_an_event():
    """Each quantity reaches its limit at its own time; a second time soon after is the same event, a later one is another."""
    time = np.arange(401) * 0.01
    joints = tuple(JointInfo(name=name, actuator="three", mode=5, motors=3) for name in ("slow", "quick"))
    lasting = {"link_position": 0.0, "link_torque": 0.0, **{f"motor_{i}_torque": 0.0 for i in (1, 2, 3)}, "deflection": 0.0}
    values = {name: np.full((401, 2), value) for name, value in lasting.items()}
    reached = [
        ("link_position", 1, 0.5, 1.0, "quick at its upper stop"),
        ("link_position", 0, 1.0, -2.0, "slow at its lower stop"),
        ("link_torque", 1, 1.5, -3.0, "quick at its effort limit"),
        ("motor_1_torque", 0, 2.0, 0.4, "slow: motor 1 at its torque limit"),
        ("motor_3_torque", 1, 2.5, -0.6, "quick: motor 3 at its torque limit"),
    ]
    for name, column, at, value, _ in reached:
        values[name][np.isin(np.round(time, 2), [at, at + 0.03, at + 1.0]), column] = value
    stops = {"slow": (-2.0, 2.0, 7.0), "quick": (-1.0, 1.0, 3.0)}
    robot = SimpleNamespace(
        joints=[
            Joint(name=name, kind="revolute", parent="a", child=name, lower=low, upper=high, effort=most)
            for name, (low, high, most) in stops.items()
        ]
    )
    limits = {"slow": {"motor_1_max_torque": 0.4}, "quick": {"motor_3_max_torque": 0.6, "motor_1_max_torque": 0.1}}
    found = limit_events(Samples(time=time, joints=("slow", "quick"), values=values), joints, robot, limits)
    wanted = [(pytest.approx(later), text) for *_, at, _, text in reached for later in (at, at + 1.0)]
    assert sorted((event.time, event.text) for event in found) == sorted(wanted, key=lambda pair: (pair[0].expected, pair[1]))


@pytest.mark.parametrize(
    ("measure", "at"), [("maximum", 0.9), ("minimum", 0.3), ("peak", 0.3), ("overshoot", 0.3), ("mean", 1.0)]
)
def test_a_claim_that_fails_is_an_event_at_its_extreme(tmp_path, measure, at):
    """The position falls to -3 at 0.3 s and rises to 2 at 0.9 s; a mean belongs to the end."""
    position = np.interp(np.arange(1001) * 1e-3, [0.0, 0.3, 0.9, 1.0], [0.0, -3.0, 2.0, 0.0])
    claim = {"joint": "joint_1", "quantity": "link_position", "measure": measure, "value": 77.0}
    log = made_up_log(tmp_path / "log.mcap", values={"link_position": position}, expect=(claim,))
    read = read_log(log)
    (event,) = events_of(log, read.samples, read.info.joints, SimpleNamespace(joints=()))
    assert event.time == pytest.approx(at)
    assert f"{measure} of link_position" in event.text


def test_the_preset_of_two_antagonistic_springs_uses_up_part_of_the_largest_deflection(result):
    """Motors that are 0.4 rad apart leave 0.5 of 0.7 rad."""
    time = np.arange(101) * 0.01
    values = {"link_position": -time[:, None], "motor_1_position": np.full((101, 1), 0.2)}
    values["motor_2_position"] = -values["motor_1_position"]
    samples = Samples(time=time, joints=("joint_1",), values=values)
    limits = {"joint_1": {"max_deflection": 0.7}}
    (event,) = limit_events(samples, result.run.info.joints[:1], SimpleNamespace(joints=()), limits)
    assert (event.time, event.text) == (pytest.approx(0.5), "joint_1: deflection limit")


(SWING,) = load_scenario(SOFT_ARM, variant="nominal_soft", overrides=["duration=0.7"])
TURN = asrsim.make_scenario(
    EXAMPLES / "urdf" / "dof1_sea.urdf",
    duration=0.7,
    modes={"*": 3},
    initial={"joint_1": 1.5},
    references={"joint_1": {"equilibrium_position": {"ramp": {"duration": 0.6, "from": 1.5, "to": -1.6}}}},
)
"""A link turns by half a turn."""


@pytest.mark.parametrize("scenario", [SWING, TURN], ids=["swing", "half a turn"])
def test_the_first_picture_has_room_for_a_motion_that_is_known(tmp_path, server, scenario):
    """In a window of 1280 x 800 pixels, the picture begins at 304, and the controls cover what is right of 945."""
    moved = asrsim.run(scenario, out=tmp_path / "moved")
    stage = ViewerStage(server.viser, logged(moved.log))
    start, scene = server.viser.initial_camera, stage.subject.scene
    forward = np.subtract(start.look_at, start.position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, start.up) / np.linalg.norm(np.cross(forward, start.up))
    for at in (0.0, 0.35, 0.7):
        frames = frames_of(scene, stage.subject.history.at(at))
        for part in scene.parts:
            corners = part.mesh.bounding_box.vertices @ frames[part.body][:3, :3].T + frames[part.body][:3, 3] - start.position
            x = 400.0 / np.tan(0.5 * start.fov) * (corners @ right) / (corners @ forward)
            assert 304.0 - 792.0 < x.min() < x.max() < 945.0 - 792.0


def test_a_twin_s_torques_are_played_with_jumps_to_its_alarms(tmp_path, server):
    lab = tmp_path / "lab.yaml"
    lab.write_text((EXAMPLES / "scenarios" / "step_2dof.yaml").read_text().replace("../urdf", str(EXAMPLES / "urdf")))
    recording = EXAMPLES / "recordings" / "two_joints.csv"
    found = follow_recording(lab, recording, variant="soft")
    player = followed_player(Page(server), prepare(lab, variant="soft"), found)
    (start, _), *_ = found.alarms(0)
    player.jump(start)
    player.draw()
    assert player.subject.history.at(start).values["external_torque"][0] == pytest.approx(
        found.external_torque[np.abs(found.time - start).argmin()], nan_ok=True
    )
    assert player._page.stage._arrows["torque"].visible


def test_each_control_changes_what_its_label_says(result, server, monkeypatch):
    """Boxes begin with what is shown."""
    controls = {}
    monkeypatch.setattr("asrsim.viewer.page.by_hand", lambda one, act: controls.setdefault(one.label, (one, []))[1].append(act))
    page, subject = Page(server), logged(result.log)
    page.show(subject, companions=[as_companion(subject, "other run")])
    page.finish()
    look, stage = page.stage.look, page.stage
    labels = {
        "Equilibrium (faint)": "equilibrium", "Forces and torques": "forces", "Trace of the tip": "trace",
        "Collision shapes": "collisions",
    }  # fmt: skip
    names = {f"{words_of(name)}": name for name in ("deflection", "stiffness")}
    for control, acts in controls.values():
        before = dict(vars(look))
        if control.label in labels:
            changed = labels[control.label]
            assert control.value == before[changed]
            for act in acts:
                act(not control.value)
            assert vars(look) == before | {changed: not before[changed]}
        elif control.label == "Colour of the links":
            assert {*names} <= {*control.options}
            for option in control.options:
                acts[0](option)
                assert look.colour == names.get(option, look.colour)
                assert bool(look.colour) == (option != control.value)
        elif control.label == "other run":
            assert stage.ghosts["other run"][1].visible is control.value is True
            acts[0](False)
            assert not stage.ghosts["other run"][1].visible
    assert {*labels, "Colour of the links", "other run"} <= {*controls}


def test_a_twin_s_torques_are_shown_as_they_are_found_and_then_played(server):
    """Steps of a twin are on the page before the last one is done."""
    prepared = prepare(EXAMPLES / "scenarios" / "step_2dof.yaml", variant="soft")
    page, count, seen, results = Page(server), 40, [], []
    torques = np.outer(np.arange(count), [0.1, -0.2])

    def work(watch, stop):
        for k, torque in enumerate(torques):
            step = SimpleNamespace(external_torque=torque, stiffness=np.full(2, 5.0), alarm=np.array([k > 20, False]))
            watch(k * 0.01, np.full(2, 0.01 * k), step)
            time.sleep(0.01)
            seen.append(view._subject.history.span[1])
        times = 0.01 * np.arange(count)
        return Followed(
            name="lab", joints=("joint_1", "joint_2"), units={}, time=times, positions=np.outer(times, [1, 1]),
            external_torque=torques, stiffness=np.full((count, 2), 5.0), residual=0 * torques, threshold=0 * torques + 1,
            alarm=torques > 2.0, notes=(),
        )  # fmt: skip

    view = FollowView(page, prepared, work, results.append)
    found = view.run(lambda: bool(results))
    assert results == [found]
    assert 0.1 < seen[len(seen) // 2] < seen[-1]
    latest = view._subject.history.latest
    row = round(latest.time[0] / 0.01)
    assert latest.values["external_torque"][0].tolist() == torques[row].tolist()


def test_a_log_without_poses_and_an_unknown_variant_are_errors_before_a_page_opens(tmp_path):
    with pytest.raises(LogError, match=r"log\.mcap: robot: has no link"):
        asrsim.view(made_up_log(tmp_path / "log.mcap", count=20))
    with pytest.raises(InputError, match="no variant is called 'sotf'"):
        asrsim.view(SOFT_ARM, variant="sotf")


def test_a_robot_whose_meshes_are_missing_is_shown_with_a_note(tmp_path):
    """Its fixed joint does not move and has no slider."""
    robot = tmp_path / "robot.urdf"
    visual = '<visual><geometry><mesh filename="package://nobody/arm.stl"/></geometry></visual>'
    mass = '<inertial><origin xyz="0 0 0.2"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/></joint>'
    joints = joint.format("foot", "fixed", "floor", "base") + joint.format("j", "continuous", "base", "arm")
    links = f'<link name="floor"/><link name="base"/><link name="arm">{mass}{visual}</link>'
    robot.write_text(f'<robot name="r">{joints}{links}</robot>')
    with asrsim.view(robot) as view:
        assert any("nobody" in note for note in view.show.subject.notes)
        assert view.show._values.keys() == {"j"}
        view.show._values["j"] = 0.7
        end = time.monotonic() + 30.0
        while abs(view.show._page.stage.figure.nodes["arm"].wxyz[0] - np.cos(0.35)) > 1e-9:
            assert time.monotonic() < end
            time.sleep(0.02)


def test_commands_show_pages_and_end(asrsim_command, tmp_path):
    done = asrsim_command("live", SOFT_ARM, "--variant", "soft", "--on", "none", "--duration", "0.3", "--view", "-o", "live")
    assert done.code == 0, done.err
    assert "view: http://localhost:" in done.err
    assert rerun(tmp_path / "live" / "log.mcap").identical
    done = asrsim_command("view", "live", "--duration", "0.3", "--port", "0", "--no-browser", "--json")
    assert (done.code, done.out.strip()[:1]) == (0, "{")
    assert "view" in COMMANDS


def test_a_notebook_displays_the_page(result):
    with result.view() as page:
        assert f'src="{page.address}"' in page._repr_html_()


def test_the_arrow_of_a_single_torque_follows_the_link_and_goes_with_the_torque(result, server):
    """Its length is proportional to the torque, and the largest torque so far has the longest arrow."""
    stage = ViewerStage(server.viser, logged(result.log))
    joint = next(joint for joint in stage.subject.scene.model.robot.joints if joint.name == "joint_2")
    sample = stage.subject.history.at(0.2)
    lengths = []
    for angle, torque in ((0.0, 2.0), (0.7, -1.0), (0.7, 0.0)):
        torques, angles = np.array([[0.0, torque]]), np.array([[angle, 0.3]])
        moved = replace(sample, values=sample.values | {"external_torque": torques, "link_position": angles})
        stage.draw(moved)
        arrow = stage._arrows["torque"]
        assert arrow.visible == (torque != 0.0)
        if arrow.visible:
            ((begin, end),) = arrow.points
            frame = frames_of(stage.subject.scene, moved)[joint.child]
            np.testing.assert_allclose(begin, frame[:3, 3], atol=1e-6)
            lengths.append((end - begin) @ frame[:3, :3] @ np.array(joint.axis))
    assert lengths[1] == pytest.approx(-0.5 * lengths[0])
    assert lengths[0] > 0.0


def test_the_spring_of_a_pull_is_drawn_where_it_is_and_goes_with_the_pull(result, server):
    stage = ViewerStage(server.viser, logged(result.log))
    sample = stage.subject.history.at(0.2)
    for point in ([0.1, 0.2, 0.3], [0.3, 0.1, 0.0]):
        pull = Pull(point=np.array(point), target=np.add(point, [0.0, 0.1, 0.0]), force=np.array([0.0, 3.0, 4.0]))
        stage.draw(sample, pull=pull)
        np.testing.assert_allclose(stage._arrows["pull"].points, [[pull.point, pull.target]], atol=1e-6)
        assert (stage._label.text, stage._label.visible) == ("5 N", True)
        np.testing.assert_allclose(stage._label.position, pull.target)
    stage.draw(sample)
    assert (stage._arrows["pull"].visible, stage._label.visible) == (False, False)
