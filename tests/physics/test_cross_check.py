"""Cross-check by a run in another engine: equal without contacts; differences are reported."""

import json
from dataclasses import replace

import pytest

import asrsim
from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines import mujoco as mujoco_engine
from asrsim.engines.base import FRICTION
from asrsim.errors import SimulationError
from asrsim.robot import load_robot
from asrsim.simulation.accuracy import LIMIT, other_engine
from support.paths import ROOT

EXAMPLES = ROOT / "examples" / "scenarios"
pytestmark = pytest.mark.skipif(not ENGINES.get("bullet").available, reason="PyBullet has no wheel here")


def example(name, variant, **fields):
    (scenario,) = asrsim.load_scenario(EXAMPLES / f"{name}.yaml", variant=variant)
    return replace(scenario, expect=(), **fields)


@pytest.fixture
def wrong_mujoco(monkeypatch):
    """MuJoCo engine with a relative error of one millionth in gravity."""

    def make(scenario, robot):
        return mujoco_engine.make(replace(scenario, gravity=(0.0, -9.81 * (1 + 1e-6), 0.0)), robot)

    monkeypatch.setitem(ENGINES._entries, "mujoco", EngineEntry(make=make, doc="wrong", module="mujoco"))


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_engines_agree_where_nothing_touches(engine, tmp_path):
    result = asrsim.run(example("step_2dof", "soft", engine=engine, duration=1.0), out=tmp_path, cross_check=True)
    check = result.summary.cross_check
    assert result.ok
    assert check["agrees"]
    assert not check["note"]
    assert {check["engine"], check["other"]} == {"bullet", "mujoco"}
    assert check["engine"] == engine
    assert all(word in version for word, version in zip((engine, check["other"]), check["versions"], strict=True))
    for joint in check["joints"].values():
        assert 0.0 <= joint["position_rms"] <= joint["position_max"] < LIMIT
        assert 0.0 <= joint["torque_rms"] <= joint["torque_max"] < 1e-6
    written = json.loads((tmp_path / "summary.json").read_text())
    assert written["cross_check"] == json.loads(json.dumps(check))
    assert written["engine"] == engine
    assert written["loop"] in ("plain", "compiled")


@pytest.mark.usefixtures("wrong_mujoco")
def test_cross_check_finds_a_relative_error_of_one_millionth():
    scenario = example("step_2dof", "soft", engine="bullet", duration=1.0, gravity=(0.0, -9.81, 0.0))
    result = asrsim.run(scenario, certify=True)
    check = result.summary.cross_check
    assert "one of the engines is wrong" in check["finding"]
    assert not check["agrees"]
    assert not result.ok
    assert max(joint["position_max"] for joint in check["joints"].values()) > LIMIT
    assert result.summary.certificate


class HalfFriction(mujoco_engine.MujocoEngine):
    """Faulty engine with half the joint friction."""

    native = None

    def step(self, exchange, wrenches, lengths):
        """Step with half the friction."""
        rubbing = exchange.copy()
        rubbing[..., FRICTION] *= 0.5
        super().step(rubbing, wrenches, lengths)
        exchange[..., :FRICTION] = rubbing[..., :FRICTION]


class MovedStop(mujoco_engine.MujocoEngine):
    """Faulty engine with a stop displaced by 10 mrad."""

    def __init__(self, scenario, robot):
        moved = tuple(joint if joint.upper is None else replace(joint, upper=joint.upper + 0.01) for joint in robot.joints)
        super().__init__(scenario, replace(robot, joints=moved))


@pytest.mark.parametrize("wrong", [HalfFriction, MovedStop])
def test_cross_check_finds_wrong_friction_and_stops(wrong, tmp_path, monkeypatch):
    """The run: a link with friction falls onto its stop."""
    (tmp_path / "r.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>'
        '<inertia ixx="3e-3" iyy="3e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute">'
        '<parent link="a"/><child link="b"/><axis xyz="0 1 0"/><limit lower="-3" upper="0.5" effort="9" velocity="99"/>'
        '<dynamics friction="0.2"/></joint></robot>'
    )
    (tmp_path / "s.yaml").write_text("robot: r.urdf\nduration: 0.6\ninitial: {j: -1.2}\nengine: bullet\n")
    assert asrsim.run(tmp_path / "s.yaml", cross_check=True).summary.cross_check["agrees"]
    entry = EngineEntry(make=lambda *given: (wrong(*given), ()), doc="wrong", module="mujoco")
    monkeypatch.setitem(ENGINES._entries, "mujoco", entry)
    assert not asrsim.run(tmp_path / "s.yaml", cross_check=True).summary.cross_check["agrees"]


def test_cross_check_accepts_chaotic_motions(tmp_path):
    """Three free links rotate chaotically: a change of 1e-12 rad at the start is 1e-3 rad at the end, even in one engine.

    The first link starts on its stop.
    """
    stop = '<limit lower="-60" upper="2.5" effort="9" velocity="99"/>'
    links = "".join(
        f'<joint name="j{i}" type="{"revolute" if i == 1 else "continuous"}">{stop if i == 1 else ""}'
        f'<origin xyz="0 0 {-0.2 if i > 1 else 0}"/><parent link="l{i - 1}"/>'
        f'<child link="l{i}"/><axis xyz="0 1 0"/></joint><link name="l{i}"><inertial><origin xyz="0 0 -0.1"/>'
        '<mass value="1"/><inertia ixx="3e-3" iyy="3e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for i in (1, 2, 3)
    )
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="l0"/>{links}</robot>')
    (tmp_path / "s.yaml").write_text("robot: r.urdf\nduration: 12\ninitial: {j1: 2.5, j2: 1.0, j3: 0.5}\n")
    check = asrsim.run(tmp_path / "s.yaml", cross_check=True).summary.cross_check
    assert max(joint["position_max"] for joint in check["joints"].values()) > LIMIT
    assert check["agrees"]
    assert "amplifies small differences" in check["note"]


def test_cross_check_with_contacts_may_differ_with_a_note():
    check = asrsim.run(example("box_push_5dof", "soft", duration=0.2, task=None), cross_check=True).summary.cross_check
    assert check["contacts"]
    assert check["agrees"]
    assert "legitimate" in check["note"]


def test_cross_check_needs_a_second_engine_but_certify_does_not(monkeypatch):
    entry = replace(ENGINES.get("mujoco"), module="no_such_module_here")
    monkeypatch.setitem(ENGINES._entries, "mujoco", entry)
    assert other_engine("bullet") is None
    assert other_engine("bench") is None
    scenario = example("step_2dof", "soft", engine="bullet", duration=0.1)
    with pytest.raises(SimulationError, match="no other engine to compare 'bullet' with"):
        asrsim.run(scenario, cross_check=True)
    assert not asrsim.run(scenario, certify=True).summary.cross_check
    with pytest.raises(SimulationError, match="needs 'no_such_module_here', which is not installed; installed engines: bullet"):
        asrsim.run(replace(scenario, engine="mujoco"))


def test_cross_check_and_certify_use_the_robot_passed_in(tiny):
    """The robot is three times as heavy as in the robot file, so the robot of the file would move very differently."""
    robot = load_robot(tiny.robot)
    heavy = replace(robot, links=tuple(replace(link, mass=3.0 * link.mass) if link.mass else link for link in robot.links))
    overrides = ["engine=mujoco", "compiled=false", "duration=0.2"]
    result = asrsim.run(tiny.scenario, robot=heavy, overrides=overrides, certify=True)
    assert all(one["position_max"] < 1e-4 for one in result.summary.certificate["joints"].values())
    assert result.summary.cross_check["agrees"]
