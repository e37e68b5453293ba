"""Live runs without any network: what comes in is checked and recorded, what goes out is in the log, and that repeats it."""

import gc
import math
import random
import struct
import time

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import asrsim
from asrsim.live import TRANSPORTS, Received, TransportEntry
from asrsim.live.commands import CommandInput
from asrsim.live.pace import Pace
from asrsim.live.session import Session, Settings
from asrsim.log import open_log, read_log
from asrsim.runs.rerun import rerun
from asrsim.samples import Command, HeldWrench, JointInfo, WrenchCommand
from asrsim.simulation.examine import examine
from support.paths import EXAMPLES


class Script:
    """Transport that sends one of the given messages in each poll, and keeps the messages that the run publishes."""

    def __init__(self, messages=()):
        self.messages = list(messages)
        """Topic, values, and further fields of `Received`."""
        self.heard, self.polls, self.closed = [], 0, False

    def make(self, interface, access, tell):
        self.interface = interface
        self.inlets = {inlet.name: number for number, inlet in enumerate(interface.inlets)}
        self.wanted = [not outlet.latched for outlet in interface.outlets if not outlet.latched]
        return self

    def publish(self, time, messages):
        self.heard.append((time, [bytes(message) for message in messages]))

    def poll(self):
        self.polls += 1
        if self.messages:
            name, values, *more = self.messages.pop(0)
            yield Received(self.inlets[name], values, *more)

    def close(self):
        self.closed = True


def arm(**changes):
    (one,) = asrsim.load_scenario(STEP, variant="soft", overrides={**PLAIN, **changes})
    return one


def run_live(folder, script, *, scenario=None, duration=0.4, tell=lambda text: None, **settings):
    TRANSPORTS.add("script", TransportEntry(make=script.make, doc="", module="json"), replace=True)
    settings = Settings(duration=duration, transports=["script"], **{"speed": math.inf, **settings})
    session = Session(examine(scenario or arm()), folder, settings, tell=tell)
    return session, session.run(stop=lambda: False)


STEP = EXAMPLES / "scenarios" / "step_2dof.yaml"
PLAIN = {"compiled": False, "expect": [], "reference_ranges": {"*": {"external_torque": [-0.3, 0.3]}}}


def random_commands(seed, count=300):
    chance = random.Random(seed)
    for _ in range(count):
        joint = chance.choice(("joint_1", "joint_2"))
        kind, spread = chance.choice((("equilibrium_position", 1.0), ("stiffness_preset", 0.4), ("external_torque", 0.3)))
        yield f"/{joint}/{kind}", [chance.uniform(-spread, spread)]


def test_a_live_run_is_repeated_bit_for_bit(tmp_path):
    _, summary = run_live(tmp_path / "run", Script(random_commands(1)))
    assert summary.ok
    assert summary.live["applied"] > 100
    commands = list(open_log(tmp_path / "run" / "log.mcap").commands())
    assert len(commands) == summary.live["applied"]
    assert {command.reference for command in commands} == {"equilibrium_position", "stiffness_preset", "external_torque"}
    found = rerun(tmp_path / "run" / "log.mcap")
    assert found.identical
    assert found.samples == 401
    assert not found.missing


def test_a_wrench_that_an_operator_holds_on_a_box_is_repeated_bit_for_bit(tmp_path):
    """The operator also holds a wrench on a link, and sets references between."""

    class Hand:
        def ask(self, session):
            time = round(session.time, 3)
            if time < 0.05:
                session.hold(HeldWrench("box", (2.0 + time, 0.5, 0.0), point=(0.0, 0.0, 0.05)))
                session.hold(HeldWrench("link_2", (0.0, 0.1, 0.0), torque=(0.0, 0.0, 0.01)))
            elif time < 0.06:
                session.hold(HeldWrench("box", (0.0, 0.0, 0.0)))
            return {("joint_1", "equilibrium_position"): 0.3 if time > 0.02 else None}

        def write(self, samples):
            pass

    box = {"shape": "box", "size": [0.2, 0.2, 0.2], "mass": 0.5, "friction": 0.1, "position": [2.0, 0.0, 0.1]}
    scenario = arm(world={"ground": {}, "objects": {"box": box}})
    session = Session(examine(scenario), tmp_path / "run", Settings(speed=math.inf, duration=0.1))
    session.operator = Hand()
    assert session.run(stop=lambda: False).ok
    log = open_log(tmp_path / "run" / "log.mcap")
    commands = list(log.commands())
    assert len(commands) == session.figures()["applied"] > 50
    assert {type(one) for one in commands} == {Command, WrenchCommand}
    assert log.read().samples.bodies["box"][-1, 0] > 2.001
    assert rerun(log.path).identical


def test_topics_are_published_half_as_often_by_late_runs(tmp_path, monkeypatch):
    script = Script()
    monkeypatch.setattr(Pace, "is_behind", lambda pace: script.polls in (50, 60))
    monkeypatch.setattr("asrsim.live.session.TOPICS_SHARE", 0.0)
    _, summary = run_live(tmp_path / "run", script, duration=0.2, speed=1.0)
    assert summary.live["rate"] == 250.0
    np.testing.assert_allclose(np.diff([at for at, _ in script.heard][-5:]), 4e6)


def test_a_transport_that_cannot_be_had_costs_no_earlier_log(tmp_path):
    run_live(tmp_path / "run", Script(), duration=0.1)
    before = {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()}

    def taken(*_):
        raise asrsim.AsrsimError("the port is taken")

    script = Script()
    TRANSPORTS.add("script", TransportEntry(make=script.make, doc="", module="json"), replace=True)
    TRANSPORTS.add("taken", TransportEntry(make=taken, doc="", module="json"), replace=True)
    session = Session(examine(arm()), tmp_path / "run", Settings(speed=math.inf, duration=0.1, transports=["script", "taken"]))
    with pytest.raises(asrsim.AsrsimError, match="the port is taken"):
        session.run(stop=lambda: False)
    assert script.closed
    assert {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before


def test_published_numbers_are_those_of_the_log(tmp_path):
    script = Script([("/joint_1/equilibrium_position", [0.5]), ("/joint_2/external_torque", [0.2])])
    session, _ = run_live(tmp_path / "run", script, scenario=arm(initial={"joint_1": 0.3}), duration=0.1)
    samples = read_log(tmp_path / "run" / "log.mcap").samples
    assert [time for time, _ in script.heard] == [round(t * 1e9) for t in samples.time]
    types = get_typestore(Stores.ROS2_HUMBLE)
    for row, (_, messages) in enumerate(script.heard):
        said = dict(zip((outlet.name for outlet in session.publisher.outlets), messages, strict=False))
        for topic, quantities in (
            ("/joint_states", ("link_position", "link_velocity", "link_torque")),
            ("/motor_2_state", ("motor_2_position", "motor_2_velocity", "motor_2_torque")),
        ):
            state = types.deserialize_cdr(said[topic], "sensor_msgs/msg/JointState")
            assert state.name == ["joint_1", "joint_2"]
            assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == round(samples.time[row] * 1e9)
            for numbers, quantity in zip((state.position, state.velocity, state.effort), quantities, strict=True):
                np.testing.assert_array_equal(numbers, samples.values[quantity][row])
        for topic, quantity in (("stiffness", "stiffness"), ("torque_el2_state", "elastic_torque_2")):
            (value,) = struct.unpack_from("<d", said[f"/joint_1/{topic}"], 4)
            assert value == samples.values[quantity][row, 0]
        applied = types.deserialize_cdr(said["/applied_commands"], "sensor_msgs/msg/JointState")
        assert applied.header.stamp == state.header.stamp
        values = dict(zip(applied.name, applied.position, strict=True))
        assert values["joint_1.equilibrium_position"] == samples.values["reference_1"][row, 0]
        assert values["joint_2.external_torque"] == samples.values["external_torque"][row, 1]
        # As ros2_control expects, presets are the positions of pseudo-joints with the names of its commands.
        state = types.deserialize_cdr(said["/ros2_control/joint_states"], "sensor_msgs/msg/JointState")
        assert state.name == ["joint_1", "joint_2", "joint_1_stiffness", "joint_2_stiffness"]
        np.testing.assert_array_equal(state.position[:2], samples.values["link_position"][row])
        np.testing.assert_array_equal(state.position[2:], samples.values["reference_2"][row])
        np.testing.assert_array_equal(state.velocity[:2], samples.values["link_velocity"][row])
        np.testing.assert_array_equal(state.effort[:2], samples.values["link_torque"][row])
    assert (values["joint_1.equilibrium_position"], values["joint_2.external_torque"]) == (0.5, 0.2)
    assert script.closed


STILL = {"joint_1": {"equilibrium_position": 0.1}, "joint_2": {"equilibrium_position": -0.1}}
NONSENSE = [
    ("/joint_1/equilibrium_position", [math.nan]),
    ("/joint_1/equilibrium_position", [math.inf]),
    ("/joint_1/equilibrium_position", [1e308]),
    ("/joint_1/equilibrium_position", []),
    ("/joint_1/equilibrium_position", [0.1, 0.2]),
    ("/reference_1", [0.1]),
    ("/reference_1", [0.1, 0.2, 0.3]),
    ("/reference_2", [-math.inf, 0.1]),
    ("/ros2_control/joint_commands", [0.1], ["nobody"]),
    ("/ros2_control/joint_commands", [0.1, 0.2], ["joint_1"]),
    ("/ros2_control/joint_commands", [math.inf], ["joint_1_stiffness"]),
    ("/ros2_control/joint_commands", [0.1, 0.2, 0.3, 0.4]),
    ("/joint_trajectory", [0.1, 0.2, 0.3, 0.4]),
    ("/joint_1/equilibrium_position", [0.1], ["joint_1"]),
]


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_a_live_run_says_that_commands_from_outside_are_perfect(tmp_path, delay):
    said, imperfections = [], {"commands": {"joint_1": {"delay": delay}}}
    run_live(tmp_path / "run", Script(), scenario=arm(imperfections=imperfections), duration=0.01, tell=said.append)
    told = [text for text in said if text.startswith("imperfections of the commands of joint_1 act on the signals")]
    assert bool(told) == bool(delay)


def test_nonsense_is_counted_reported_once_and_dropped(tmp_path):
    said = []
    session, summary = run_live(tmp_path / "run", Script(NONSENSE * 3), duration=0.2, tell=said.append)
    assert sum(summary.live["dropped"].values()) == 3 * 13
    assert summary.live["clamped"] == {"joint_1.equilibrium_position": 3}
    told = [text for text in said if "further messages are only counted" in text]
    assert len(told) == len(set(told)) == len(summary.live["dropped"])
    assert len([text for text in said if "clamped; later values outside are only counted" in text]) == 1
    command, low, *_ = list(open_log(tmp_path / "run" / "log.mcap").commands())
    assert (command.joint, command.reference) == ("joint_1", "equilibrium_position")
    assert command.value == session.simulation.scenario.ranges_of("joint_1")["equilibrium_position"][1]
    assert low.joint == "joint_2"


def test_kinds_of_nonsense_beyond_a_hundred_are_counted_together(tmp_path):
    """Other programs can send endless kinds of nonsense; each kind takes memory."""
    kinds = [("/reference_1", [0.1] * (3 + n)) for n in range(150)]
    said = []
    _, summary = run_live(tmp_path / "run", Script(kinds), duration=0.2, tell=said.append)
    dropped = summary.live["dropped"]
    assert (len(dropped), dropped["others"], sum(dropped.values())) == (101, 50, 150)
    assert len([text for text in said if "only counted" in text]) == 101


def test_ros2_control_leaves_uncommanded_joints_alone(tmp_path):
    names = ["joint_1", "joint_2", "joint_1_stiffness", "joint_2_stiffness"]
    script = Script([("/ros2_control/joint_commands", [0.3, math.nan, math.nan, 0.1], names)])
    _, summary = run_live(tmp_path / "run", script, duration=0.05)
    assert not summary.live["dropped"]
    commands = list(open_log(tmp_path / "run" / "log.mcap").commands())
    assert [(c.joint, c.reference, c.value) for c in commands] == [
        ("joint_1", "equilibrium_position", 0.3),
        ("joint_2", "stiffness_preset", 0.1),
    ]


def test_commands_reach_their_joints_by_topic_array_place_or_name():
    """Of the toolbox's arrays, one entry for each joint with an actuator."""
    kinds = {"vsa": ("qbmove", 6, 2), "free": ("rigid", None, 0), "motors": ("qbmove", 5, 2), "single": ("sea", 5, 1)}
    joints = [JointInfo(name=name, actuator=kind, mode=mode, motors=count) for name, (kind, mode, count) in kinds.items()]
    ranges = {
        "vsa": {"equilibrium_position": (-1.0, 1.0), "stiffness_preset": (0.0, 0.4)},
        "free": {"external_torque": (-2.0, 2.0)},
        "motors": {"reference_1": (-1.0, 1.0), "reference_2": (-1.0, 1.0)},
        "single": {"reference_1": (-1.0, 1.0)},
    }
    commands = CommandInput(joints, ranges)
    inlets = {inlet.name: number for number, inlet in enumerate(commands.inlets)}
    assert commands.check(Received(inlets["/reference_1"], [0.1, 0.2, 0.3])) == [
        (("vsa", "equilibrium_position"), 0.1),
        (("motors", "reference_1"), 0.2),
        (("single", "reference_1"), 0.3),
    ]
    assert commands.check(Received(inlets["/reference_2"], [0.1, 0.2, 0.3])) == [
        (("vsa", "stiffness_preset"), 0.1),
        (("motors", "reference_2"), 0.2),
    ]
    assert commands.check(Received(inlets["/free/external_torque"], [0.5])) == [(("free", "external_torque"), 0.5)]
    names = ["vsa", "vsa_stiffness", "motors", "motors_stiffness", "single", "free"]
    assert commands.check(Received(inlets["/ros2_control/joint_commands"], [0.1] * 6, names)) == [
        (("vsa", "equilibrium_position"), 0.1),
        (("vsa", "stiffness_preset"), 0.1),
        (("motors", "reference_1"), 0.1),
        (("single", "reference_1"), 0.1),
    ]
    assert sum(commands.refused.values()) == 2


def test_topics_of_the_paper_and_of_the_toolbox_set_the_same_torques():
    targets = [("arm", "motor_1_torque"), ("arm", "motor_2_torque")]
    commands = CommandInput(
        [JointInfo(name="arm", actuator="qbmove", mode=4, motors=2)], {"arm": {name: (-1.0, 1.0) for _, name in targets}}
    )
    inlets = {inlet.name: number for number, inlet in enumerate(commands.inlets)}
    for names in ("motor_{}_command", "torque_m{}_command"):
        assert [commands.check(Received(inlets[f"/arm/{names.format(i)}"], [0.5])) for i in (1, 2)] == [
            [(target, 0.5)] for target in targets
        ]


POINTS = [(0.05, [0.2, -0.1], [1.0, 0.0]), (0.1, [0.3, 0.1], [0.0, 0.0])]


@pytest.mark.parametrize("smooth", [True, False])
def test_a_trajectory_moves_its_joints_through_its_points(tmp_path, smooth):
    """Straight lines, or with velocities cubic pieces, from the reference on; the run is repeated bit for bit."""
    points = [(time, positions, velocities if smooth else []) for time, positions, velocities in POINTS]
    script = Script([("/joint_trajectory", [], ["joint_1", "joint_2"], points)])
    run_live(tmp_path / "run", script, scenario=arm(references=STILL), duration=0.2)
    samples = read_log(tmp_path / "run" / "log.mcap").samples
    wanted = {0: (0.1, -0.1), 50: (0.2, -0.1), 75: (0.25625, 0.0) if smooth else (0.25, 0.0), 150: (0.3, 0.1)}
    for row, references in wanted.items():
        np.testing.assert_allclose(samples.values["reference_1"][row], references, atol=1e-12)
    assert rerun(tmp_path / "run" / "log.mcap").identical


def test_objects_that_a_program_has_excluded_from_garbage_collection_stay_excluded(tmp_path):
    gc.freeze()
    run_live(tmp_path / "run", Script(), duration=0.01)
    assert gc.get_freeze_count() > 0


@pytest.mark.parametrize(
    ("names", "points", "why"),
    [
        (["joint_1"], [(0.1, [0.1, 0.2], [])], "2 values where 1 are expected"),
        (["joint_1"], [(0.2, [0.1], []), (0.1, [0.2], [])], "order of time"),
        (["joint_1"], [(0.1, [math.nan], [])], "not finite"),
        (["joint_1"], [(0.1, [1e308], [-1e308]), (0.2, [-1e308], [1e308])], "too large for a robot"),
        (["joint_1"], [(1e308, [0.1], [])], "order of time"),
        (["nobody"], [(0.1, [0.1], [])], "takes none on this topic"),
    ],
)
def test_a_wrong_trajectory_is_refused(tmp_path, names, points, why):
    _, summary = run_live(tmp_path / "run", Script([("/joint_trajectory", [], names, points)]), duration=0.05)
    (reason,) = summary.live["dropped"]
    assert why in reason
    assert summary.live["applied"] == 0


@pytest.mark.parametrize("velocities", [[], [1e12], [-1e12]])
def test_points_that_nearly_coincide_give_finite_references(tmp_path, velocities):
    points = [(5e-324, [1e12], velocities), (1e-300, [-1e12], velocities), (0.05, [0.2], velocities)]
    run_live(
        tmp_path / "run", Script([("/joint_trajectory", [], ["joint_1"], points)]), scenario=arm(references=STILL), duration=0.1
    )
    samples = read_log(tmp_path / "run" / "log.mcap").samples
    assert np.isfinite(samples.values["reference_1"]).all()


def test_a_killed_run_is_repeated_up_to_its_end(tmp_path, tiny):
    commands = [("/elbow/equilibrium_position", [0.5 * math.sin(0.1 * k)]) for k in range(400)]
    (one,) = asrsim.load_scenario(tiny.scenario, overrides={"compiled": False})
    run_live(tmp_path / "run", Script(commands), scenario=one, duration=5.0)
    whole = (tmp_path / "run" / "log.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: int(0.7 * len(whole))])
    found = rerun(tmp_path / "cut.mcap")
    assert found.logged_status == "truncated"
    assert found.identical
    assert 1000 < found.samples < 5001


def test_a_diverging_run_is_reported_and_has_a_whole_log(tmp_path, monkeypatch):
    from asrsim.simulation.divergence import runaway
    from asrsim.simulation.simulation import Simulation

    advance_to = Simulation.advance_to

    def breaks(self, end):
        if end > 500:
            raise runaway(self.prepared, "joint_1", 0.1, "its motion is no longer finite, or impossibly fast")
        advance_to(self, end)

    monkeypatch.setattr(Simulation, "advance_to", breaks)
    _, summary = run_live(tmp_path / "run", Script())
    assert summary.status == "diverged"
    assert not summary.ok
    assert "joint_1" in summary.message
    assert open_log(tmp_path / "run" / "log.mcap").status == "diverged"


def test_the_command_ends_by_its_duration(asrsim_command, tiny):
    done = asrsim_command("live", tiny.scenario, "--on", "none", "--speed", "max", "--duration", 0.2, "--set", "compiled=false")
    assert done.code == 0, done.err
    assert "asrsim rerun" in done.out


@pytest.mark.parametrize(
    "wrong",
    [
        ("--speed", "fast"),
        ("--speed", "0"),
        ("--duration", "-1"),
        ("--publish-rate", "0"),
        ("--port", "70000"),
        ("--on", "pigeon"),
    ],
)
def test_wrong_options_are_refused(asrsim_command, tiny, wrong):
    done = asrsim_command("live", tiny.scenario, *wrong)
    assert done.code != 0
    assert "Traceback" not in done.err


def test_ticks_catch_up_and_slip():
    """Each sleep takes 0.1 ms too long."""
    now = [0.0]
    pace = Pace(2.0, now=lambda: now[0], sleep=lambda s: now.__setitem__(0, now[0] + s + 1e-4))
    for _ in range(10):
        now[0] += 0.001
        pace.wait(0.01)
    assert now[0] == pytest.approx(0.0501)
    assert pace.lateness() == pytest.approx((1e-4, 1e-4))
    assert pace.busy == pytest.approx(0.01)
    now[0] += 0.1
    for _ in range(30):
        pace.wait(0.01)
    assert now[0] == pytest.approx(0.2001)
    assert not pace.slips
    now[0] += 1.0
    pace.wait(0.01)
    assert pace.slips == 1
    pace.wait(0.01)
    assert now[0] == pytest.approx(1.2052)


def test_a_run_is_late_after_two_seconds_of_lateness():
    now = [0.0]
    pace = Pace(1.0, now=lambda: now[0], sleep=lambda s: now.__setitem__(0, now[0] + s))

    def seconds_behind(work):
        """Whether each of the next ticks of 1 ms finds the run behind; work: time in a tick, s."""
        end, found = now[0] + 2.5, []
        while now[0] < end:
            now[0] += work
            pace.wait(1e-3)
            found.append(pace.is_behind())
        return sum(found)

    assert seconds_behind(0.9e-3) == 0
    now[0] += 0.2
    assert seconds_behind(0.5e-3) == 0
    assert seconds_behind(1.2e-3) == 1


def test_a_run_stops_within_a_second_of_long_ticks(tmp_path):
    session = Session(examine(arm(step=0.01)), tmp_path / "run", Settings(speed=0.001))
    asked = []

    def stop():
        asked.append(time.monotonic())
        return len(asked) == 3

    assert session.run(stop=stop).ok
    assert asked[-1] - asked[0] < 1.0
