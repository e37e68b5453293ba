"""Joints of several freedoms, and joints that move no mass of their own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import asrsim
from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from asrsim.scenario import load_scenario
from support.accepted import faults_of
from validation.models import INSTALLED

G, MASS, ARM = 9.81, 0.8, 0.3
INERTIA = np.array([0.004, 0.006, 0.003])
BODY = (
    f'<inertial><origin xyz="0 0 {-ARM}"/><mass value="{MASS}"/>'
    f'<inertia ixx="{INERTIA[0]}" iyy="{INERTIA[1]}" izz="{INERTIA[2]}" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def moved(folder, engine, joints, links, *, step=5e-4, duration=0.5, **keys):
    """Positions (steps, joints) of the joints of a robot, by name."""
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r"><link name="base"/>{links}{joints}</robot>')
    scenario = asrsim.make_scenario(path, engine=engine, step=step, duration=duration, substeps=1, **keys)
    result = asrsim.run(scenario).run
    values = result.samples.values["link_position"]
    return {joint.name: values[:, j] for j, joint in enumerate(result.info.joints)}


def joint(name, kind, *, child="body", parent="base", axis="0 0 1", words=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        f'<limit lower="-9" upper="9" effort="99" velocity="99"/>{words}</joint>'
    )


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("kind", ["spherical", "ball"])
def test_a_spherical_joint_moves_as_eulers_equations_say(tmp_path, engine, kind):
    """A body on a ball joint, its rotation by a quaternion and its angular momentum about the joint."""
    rates = {"neck_1": 1.2, "neck_2": -0.8, "neck_3": 2.0}
    inertia = np.diag(INERTIA + MASS * ARM**2 * np.array([1.0, 1.0, 0.0]))

    def change(_time, y):
        turn = Rotation.from_quat(y[:4])
        spin = np.linalg.solve(inertia, turn.inv().apply(y[4:]))
        rate = 0.5 * np.array([*(y[3] * spin + np.cross(y[:3], spin)), -y[:3] @ spin])
        return [*rate, *np.cross(turn.apply([0.0, 0.0, -ARM]), [0.0, 0.0, -MASS * G])]

    exact = solve_ivp(change, (0.0, 0.5), [0, 0, 0, 1, *(inertia @ [*rates.values()])], rtol=1e-11, atol=1e-12, method="DOP853")
    target = Rotation.from_quat(exact.y[:4, -1]).as_matrix()
    errors = []
    for step in (1e-3, 5e-4):
        initial = {name: {"velocity": rate} for name, rate in rates.items()}
        q = moved(tmp_path, engine, joint("neck", kind), f'<link name="body">{BODY}</link>', step=step, initial=initial)
        angles = [q[name][-1] for name in rates]
        errors.append(np.abs(Rotation.from_euler("XYZ", angles).as_matrix() - target).max())
    assert errors[1] < 1e-5
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.parametrize(("words", "told"), [('damping="0.1"', True), ('friction="0.1"', True), ('damping="0"', False)])
def test_losses_of_a_spherical_joint_that_are_not_isotropic_are_told(tmp_path, words, told):
    path, neck = tmp_path / "robot.urdf", joint("neck", "ball", words=f"<dynamics {words}/>")
    path.write_text(f'<robot name="r"><link name="base"/><link name="body">{BODY}</link>{neck}</robot>')
    (warning,) = (one for one in warnings_of(load_robot(path)) if one.code == "several-freedoms")
    assert (f"has its {words.split('=')[0]} about its own axis: together they are not isotropic" in warning.message) is told


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_planar_joint_slides_in_its_plane_and_turns_about_its_normal(tmp_path, engine):
    """In the plane x, z, gravity pulls along z, and nothing turns a body about its centre of mass."""
    body = f'<link name="body">{BODY.replace(str(-ARM), "0")}</link>'
    q = moved(tmp_path, engine, joint("cart", "planar", axis="0 1 0"), body, initial={"cart_3": {"velocity": 2.0}})
    slides = np.array([q["cart_1"][-1], q["cart_2"][-1]])
    assert sorted(np.abs(slides).tolist()) == pytest.approx([0.0, 0.5 * G * 0.5**2], abs=1e-3)
    assert q["cart_3"][-1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_point_mass_away_from_the_axis_is_a_pendulum(tmp_path, engine):
    """Its inertia about the axis is m r^2, so its small swings have the frequency sqrt(g / r)."""
    inertial = f'<inertial><origin xyz="0 0 {-ARM}"/><mass value="{MASS}"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'
    point = f'<link name="body">{inertial}</link>'
    q = moved(tmp_path, engine, joint("pivot", "revolute", axis="0 1 0"), point, initial={"pivot": {"position": 1e-3}})
    assert q["pivot"][-1] == pytest.approx(1e-3 * np.cos(np.sqrt(G / ARM) * 0.5), abs=1e-8)


@pytest.mark.parametrize("engine", INSTALLED)
def test_of_two_joints_on_one_axis_without_mass_between_them_one_is_fixed(tmp_path, engine):
    """The other one moves as if it were alone; so it does beside a wrist with a point mass on its axis."""
    arm = joint("first", "revolute", axis="0 1 0", child="middle") + '<link name="middle"/>'
    tip = '<link name="tip"><inertial><mass value="0.1"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>'
    more = (
        arm
        + joint("second", "continuous", axis="0 1 0", parent="middle")
        + joint("roll", "continuous", parent="body", child="tip")
    )
    links = f'<link name="body">{BODY}</link>{tip}'
    start = {"position": 0.4}
    found = moved(tmp_path, engine, more, links, initial={"second": start})
    assert set(found) == {"second"}
    warned = {one.key: one.message for one in warnings_of(load_robot(tmp_path / "robot.urdf")) if one.code == "massless-motion"}
    assert "'second' can move against each other" in warned["first"]
    assert "no inertia about its axis" in warned["roll"]
    glued = joint("second", "continuous", axis="0 1 0") + joint("roll", "fixed", parent="body", child="tip")
    alone = moved(tmp_path, engine, glued, links, initial={"second": start})
    np.testing.assert_allclose(found["second"], alone["second"], rtol=0.0, atol=1e-12)


def test_init_leaves_joints_without_actuator_that_only_their_rotors_move(tmp_path):
    """Two joints on one axis, whose rotors would move with the motors of springs: one of them gets a spring."""
    pytest.importorskip("pybullet", reason="the check of the written scenario compares both engines")
    path, words = tmp_path / "robot.urdf", '<dynamics armature="1e-3"/>'
    links = f'<link name="base"/><link name="middle"/><link name="body">{BODY}</link>'
    first = joint("first", "revolute", axis="0 1 0", child="middle", words=words)
    second = joint("second", "continuous", axis="0 1 0", parent="middle", words=words)
    path.write_text(f'<robot name="r">{links}{first}{second}</robot>')
    assert faults_of(path, tmp_path, "sea", duration=0.05, compiled=False) == []
    (scenario,) = load_scenario(tmp_path / "robot_sea.yaml")
    assert [*scenario.actuators] == ["second"]
