"""Coupled joints, rotors and weightless links against a solution in reduced coordinates, and against closed forms."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import RobotError
from asrsim.robot import load_robot
from asrsim.robot.dynamics import RobotModel
from support.coupled_ode import RODS, TWO_FREE, solve, urdf
from validation.models import INSTALLED


def run(folder, rods, engine, *, step=1e-3, compiled=None, start=0.6, **keys):
    path = folder / "rods.urdf"
    path.write_text(urdf(rods))
    keys = {"duration": 1.0, "substeps": 1, "initial": {"j1": start}, "external_torques": {"j2": 0.5}, **keys}
    return asrsim.run(asrsim.make_scenario(path, engine=engine, step=step, compiled=compiled, **keys)).run.samples


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("rods", [RODS, TWO_FREE], ids=["one freedom", "two freedoms"])
def test_coupled_chains_at_second_order(tmp_path, engine, rods):
    times = np.linspace(0.0, 1.0, 11)
    free = [0.6] + [0.0] * (sum(rod.mimic is None for rod in rods) - 1)
    truth = solve(rods, times, free, torque=lambda t: 0.5, joint=1)
    errors = []
    for step in (2e-3, 5e-4):
        samples = run(tmp_path, rods, engine, step=step)
        rows = np.round(times / step).astype(int)
        errors.append(np.abs(samples.values["link_position"][rows] - truth).max())
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)


@pytest.mark.parametrize("rods", [RODS, TWO_FREE], ids=["one freedom", "two freedoms"])
def test_inverse_dynamics_of_coupled_joints_give_the_power_of_the_kinetic_energy(tmp_path, rods):
    path = tmp_path / "rods.urdf"
    path.write_text(urdf(rods))
    model = RobotModel(load_robot(path))
    leading = np.array([rod.mimic is None for rod in rods])
    q, v = np.random.default_rng(4).uniform(-1.0, 1.0, (2, len(rods))) * leading
    v *= 5.0
    ahead, behind = (0.5 * v @ model.mass_matrix(q + way * v) @ v for way in (1e-5, -1e-5))
    torques = model.inverse_dynamics(q, v, np.zeros(len(rods))) - model.gravity_torques(q)
    assert abs(ahead - behind) > 1e-9
    assert torques @ v == pytest.approx((ahead - behind) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("rods", [RODS, TWO_FREE], ids=["one freedom", "two freedoms"])
def test_both_engines_and_the_compiled_loop_move_coupled_joints_equally(tmp_path, rods):
    ends = [
        run(tmp_path, rods, engine, compiled=compiled, duration=0.3).values["link_position"]
        for engine in INSTALLED
        for compiled in (False, True)
    ]
    for k in range(0, len(ends), 2):
        np.testing.assert_array_equal(ends[k], ends[k + 1])
    for other in ends[1:]:
        np.testing.assert_allclose(ends[0], other, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_follower_is_exactly_where_its_master_puts_it(tmp_path, engine):
    q = run(tmp_path, RODS, engine, duration=0.3).values["link_position"]
    np.testing.assert_allclose(q[:, 1], -0.7 * q[:, 0] + 0.3, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(q[:, 3], -0.5 * (1.5 * q[:, 1] - 0.1), rtol=0.0, atol=1e-15)


PAIR = """<robot name="pair"><link name="base"/>
<joint name="m" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-2" upper="2"
 effort="100" velocity="100"/><dynamics friction="{m}"/></joint>
<joint name="f" type="{kind}"><parent link="base"/><child link="b"/><axis xyz="0 0 1"/><limit lower="{low}" upper="{high}"
 effort="100" velocity="100"/><dynamics friction="{f}"/><mimic joint="m" multiplier="{ratio}"/></joint>
<link name="a"><inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02"/></inertial></link>
<link name="b"><inertial><mass value="3"/><inertia ixx="0.05" iyy="0.05" izz="0.05"/></inertial></link></robot>"""


def pair(folder, engine, *, m=0.0, f=0.0, ratio=-2.0, low=-9, high=9, kind="revolute", **keys):
    path = folder / "pair.urdf"
    path.write_text(PAIR.format(m=m, f=f, ratio=ratio, low=low, high=high, kind=kind))
    return asrsim.run(
        asrsim.make_scenario(path, engine=engine, **{"duration": 0.5, "gravity": [0, 0, 0], **keys})
    ).run.samples.values


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(("torque", "moves"), [(0.99, False), (1.01, True)])
def test_friction_of_master_and_follower_add_up_by_the_ratio(tmp_path, engine, torque, moves):
    """The master sticks until its torque exceeds .4 + 2 x .3 N m; above, the rest accelerates .02 + 4 x .05 kg m^2."""
    q = pair(tmp_path, engine, m=0.4, f=0.3, external_torques={"m": torque})["link_position"]
    assert q[-1].tolist() == pytest.approx([0.5 * 0.01 / 0.22 * 0.25, -0.01 / 0.22 * 0.25] if moves else [0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
def test_the_stop_of_a_follower_stops_its_master(tmp_path, engine):
    values = pair(tmp_path, engine, low=-0.5, external_torques={"m": 1.0}, duration=1.0)
    assert values["link_position"][-1].tolist() == pytest.approx([0.25, -0.5], abs=1e-12)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_slide_follows_a_hinge(tmp_path, engine):
    """A rack of 3 kg on a pinion of radius .1 m: q = t^2 / 2 / (.02 + .01 x 3)."""
    q = pair(tmp_path, engine, ratio=0.1, kind="prismatic", external_torques={"m": 0.1})["link_position"]
    assert q[-1].tolist() == pytest.approx([0.25, 0.025], rel=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
def test_springs_on_both_coupled_joints_share_the_load(tmp_path, engine):
    """A SEA on each joint of a symmetric pair moves as two free joints with a SEA each do."""
    actuators = {"*": {"type": "sea", "mode": 6}, "f": {"type": "sea", "mode": 6}}
    keys = {"actuators": actuators, "references": {"*": {"equilibrium_position": {"step": {"at": 0.1, "to": 0.5}}}}}
    coupled = pair(tmp_path, engine, ratio=1.0, **keys)["link_position"]
    text = PAIR.replace('izz="0.05"', 'izz="0.02"').replace('<mimic joint="m" multiplier="{ratio}"/>', "")
    path = tmp_path / "free.urdf"
    path.write_text(text.format(m=0, f=0, low=-9, high=9, kind="revolute"))
    free = asrsim.run(asrsim.make_scenario(path, engine=engine, duration=0.5, **keys)).run.samples.values["link_position"]
    text = PAIR.replace('izz="0.05"', 'izz="0.02"')
    (tmp_path / "pair.urdf").write_text(text.format(m=0, f=0, low=-9, high=9, kind="revolute", ratio=1.0))
    same = asrsim.run(asrsim.make_scenario(tmp_path / "pair.urdf", engine=engine, duration=0.5, **keys)).run.samples.values
    np.testing.assert_allclose(same["link_position"], free, rtol=0.0, atol=1e-12)
    assert np.ptp(coupled[:, 0] - free[:, 0]) > 1e-3


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_floating_robot_with_coupled_joints_keeps_its_momentum(tmp_path, engine):
    """Without external forces the centre of mass of a floating pair stays at rest, and both engines agree."""
    path = tmp_path / "pair.urdf"
    inertial = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>'
    text = PAIR.replace('<link name="base"/>', f'<link name="base">{inertial}</link>').replace(
        '<child link="b"/>', '<child link="b"/><origin xyz="0.2 0 0.1" rpy="0.4 0.3 0"/>'
    )
    path.write_text(text.format(m=0, f=0, low=-9, high=9, kind="revolute", ratio=-2.0))
    keys = {"base": {"fixed": False}, "gravity": [0, 0, 0], "duration": 0.3, "external_torques": {"m": 0.3}}
    runs = [asrsim.run(asrsim.make_scenario(path, engine=engine, **keys)).run.samples for _ in range(1)]
    runs += [asrsim.run(asrsim.make_scenario(path, engine=other, **keys)).run.samples for other in INSTALLED]
    assert np.ptp(runs[0].values["link_position"]) > 0.1
    for other in runs[1:]:
        np.testing.assert_allclose(runs[0].values["link_position"], other.values["link_position"], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(runs[0].bodies["base"], other.bodies["base"], rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("engine", INSTALLED)
def test_an_arm_of_coupled_joints_starts_at_equilibrium(tmp_path, engine):
    samples = run(tmp_path, RODS, engine, initial="equilibrium", duration=0.2)
    assert np.ptp(samples.values["link_position"], axis=0).max() < 1e-9


def test_coupled_joints_in_a_world_with_contacts_follow_within_1e_9(tmp_path):
    """MuJoCo's own step has an equality constraint for each coupling."""
    q = run(tmp_path, RODS, "mujoco", world={"ground": True}, base={"position": [0, 0, 5]}).values["link_position"]
    np.testing.assert_allclose(q[:, 1], -0.7 * q[:, 0] + 0.3, rtol=0.0, atol=1e-8)
    free = run(tmp_path, RODS, "mujoco").values["link_position"]
    np.testing.assert_allclose(q, free, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_link_without_gravity_stays_at_rest_in_a_world_with_contacts(tmp_path, engine):
    path = tmp_path / "arm.urdf"
    inertia = '<inertia ixx="0.02" iyy="0.02" izz="0.02"/>'
    arm = f'<link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>{inertia}</inertial></link>'
    text = SINGLE.format("").replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>')
    head, _, _ = text.partition('<link name="a">')
    path.write_text(head + arm + '<gazebo reference="a"><turnGravityOff>true</turnGravityOff></gazebo></robot>')
    keys = {"engine": engine, "duration": 0.3, "world": {"ground": True}, "base": {"position": [0, 0, 5]}}
    q = asrsim.run(asrsim.make_scenario(path, **keys)).run.samples.values["link_position"]
    assert np.abs(q).max() < 1e-12
    path.write_text(head + arm + "</robot>")
    assert np.ptp(asrsim.run(asrsim.make_scenario(path, **keys)).run.samples.values["link_position"]) > 0.1


@pytest.mark.skipif("bullet" not in INSTALLED, reason="PyBullet has no wheel here")
def test_pybullet_refuses_coupled_joints_and_rotors_in_a_world_with_contacts(tmp_path):
    with pytest.raises(RobotError, match="PyBullet cannot simulate a coupled joint in a world with contacts") as caught:
        run(tmp_path, RODS, "bullet", world={"ground": True})
    assert {problem.key for problem in caught.value.problems} == {"j2", "j3", "j4"}


@pytest.mark.parametrize("engine", INSTALLED)
def test_varied_rotors_move_as_those_that_the_file_states(tmp_path, engine):
    """q = t^2/2 tau / (J + armature), in two worlds of one robot, and where the file states the rotor."""
    path, stated = tmp_path / "plain.urdf", tmp_path / "stated.urdf"
    path.write_text(SINGLE.format(""))
    stated.write_text(SINGLE.format('<dynamics armature="0.05"/>'))
    keys = {"engine": engine, "duration": 0.5, "gravity": [0, 0, 0], "external_torques": {"j": 0.3}}
    prepared = asrsim.prepare(asrsim.make_scenario(path, **keys))
    truth = asrsim.run(asrsim.make_scenario(stated, **keys)).run.samples.values["link_position"][-1, 0]
    with asrsim.Worlds(prepared, 2) as worlds:
        worlds.reset([asrsim.Start(parameters={"j": {"armature": value}}) for value in (0.05, 0.08)])
        worlds.advance(500)
        ends = worlds.observe().link_position[:, 0]
    with asrsim.Simulation(prepared.vary({"j": {"armature": 0.05}})) as simulation:
        simulation.advance(500)
        assert simulation.observe().link_position[0] == truth
    assert ends[0] == truth
    np.testing.assert_allclose(ends, 0.5 * 0.5**2 * 0.3 / (0.02 + np.array([0.05, 0.08])), rtol=1e-9)


SINGLE = """<robot name="single"><link name="base"/><joint name="j" type="continuous"><parent link="base"/>
<child link="a"/><axis xyz="0 0 1"/>{}</joint><link name="a"><inertial><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02"/></inertial></link></robot>"""
