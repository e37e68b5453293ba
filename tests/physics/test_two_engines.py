"""Every documented feature gives the same motion in both engines, up to rounding, if there are no contacts."""

import numpy as np
import pytest

import asrsim
from asrsim.engines import ENGINES

pytestmark = pytest.mark.skipif(not ENGINES.get("bullet").available, reason="PyBullet has no wheel here")
SAME = 1e-11
"""Tolerance, rad or m. Measured differences are 1e-16 to 1e-14."""


def inertial(mass, centre, rpy="0 0 0"):
    return (
        f'<inertial><origin xyz="{centre}" rpy="{rpy}"/><mass value="{mass}"/>'
        '<inertia ixx="1e-3" iyy="2e-3" izz="9e-3" ixy="1e-4" ixz="0" iyz="0"/></inertial>'
    )


def actuator(joint, kind):
    return (
        f'<gazebo><plugin name="p_{joint}" filename="lib{kind}_plugin.so"><joint>{joint}</joint><operation_mode>6'
        "</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau></plugin></gazebo>"
    )


ROBOT = f"""<robot name="all">
<link name="base">{inertial(2.0, "0.1 0 0.05")}</link><link name="tool">{inertial(0.3, "0 0.02 0")}</link>
<link name="a">{inertial(1.0, "0.05 0 0")}</link><link name="b">{inertial(0.5, "0 0 -0.1", "0.3 0.2 0.1")}</link>
<link name="mount">{inertial(0.2, "0.01 0 0")}</link><link name="c">{inertial(0.4, "0.02 0 -0.05")}</link>
<joint name="f0" type="fixed"><origin xyz="0 0 0.1" rpy="0.2 0 0.4"/><parent link="base"/><child link="tool"/></joint>
<joint name="j1" type="prismatic"><origin xyz="0 0 0.2" rpy="0.1 0 0"/><parent link="tool"/><child link="a"/>
<axis xyz="1 0 1"/><limit lower="-0.15" upper="0.2" effort="30" velocity="5"/><dynamics damping="2" friction="1"/></joint>
<joint name="j2" type="revolute"><origin xyz="0.1 0 0"/><parent link="a"/><child link="b"/>
<axis xyz="0 1 0.3"/><limit lower="-1" upper="1.2" effort="3" velocity="10"/><dynamics damping="0.02" friction="0.05"/></joint>
<joint name="f1" type="fixed"><origin xyz="0 0 -0.2" rpy="0 1.5708 0.3"/><parent link="b"/><child link="mount"/></joint>
<joint name="j3" type="continuous"><origin xyz="0.02 0 -0.02"/><parent link="mount"/><child link="c"/>
<axis xyz="0 1 0"/><dynamics damping="0.01" friction="0.01"/></joint>
{actuator("j2", "qbmove")}{actuator("j3", "bavs")}</robot>"""
"""Robot with a slide that reaches its stop, a limited and a free hinge with motors, links fixed at an angle, friction and
effort limits. Its inertias violate the triangle inequality, as those of many published robots do."""
SCENARIO = """robot: robot.urdf
duration: 0.6
references:
  j2: {equilibrium_position: {step: {at: 0.2003, to: 0.5}}, stiffness_preset: 0.2}
  j3: {equilibrium_position: {sinusoid: {amplitude: 0.5, frequency: 1.0}}, stiffness_preset: 0.05}
"""
FLOATING = "base: {fixed: false, position: [0, 0, 5], rpy: [0.4, 0.2, 0.1]}\n"
TURN = "torque: [0.5, 0.3, 0.2]"
FEATURES = {
    "as it is": "",
    "tilted base": "base: {rpy: [0.3, 0.5, 0.2], position: [0.1, 0, 1]}\n",
    "euler": "stepping: euler\n",
    "toolbox": "stepping: toolbox\n",
    "imperfections": "imperfections: {sensors: {j3: {delay: 0.01, noise: 0.001}}, commands: {j2: {quantum: 0.01}}}\n",
    "initial motion": "initial: {j1: {velocity: 0.5}, j2: {position: 0.3, velocity: -1}}\n",
    "equilibrium": "initial: equilibrium\n",
    "velocity limit": "velocity_limit_cutoff: true\n",
    "spring and damping": "link_damping: {j3: {constant: 0.02}}\nexternal_torques: {j2: {ramp: {to: 0.4, duration: 0.3}}}\n",
    "force on a link": "wrenches: [{link: c, force: [2, 0.5, 1], point: [0.01, 0.02, -0.1], frame: link}]\n",
    "force on a fixed link": "wrenches: [{link: mount, force: [0.5, 0.3, 0], torque: [0.1, 0, 0.05], frame: link}]\n",
    "force in the world": "wrenches: [{link: mount, force: [0.5, 0.3, 0], point: [0, 0.1, 0], frame: world}]\n",
    "floating": FLOATING,
    "floating, euler": FLOATING + "stepping: euler\n",
    "floating, tumbling": FLOATING + f"wrenches: [{{link: base, {TURN}}}]\n",
    "floating, turned link": FLOATING
    + f"wrenches: [{{link: tool, {TURN}, force: [0, 1, 0], point: [0.3, 0, 0], frame: link}}]\n",
}


def runs(folder, more):
    (folder / "robot.urdf").write_text(ROBOT)
    (folder / "s.yaml").write_text(SCENARIO + more)
    return [asrsim.run(folder / "s.yaml", overrides=[f"engine={engine}"]) for engine in ("bullet", "mujoco")]


def turned_alike(poses, others):
    """Largest difference of poses. A quaternion and its negative describe the same rotation."""
    sign = np.sign(np.sum(poses[:, 3:] * others[:, 3:], axis=1, keepdims=True))
    return float(np.max(np.abs(poses - np.hstack([others[:, :3], sign * others[:, 3:]]))))


@pytest.mark.parametrize("feature", FEATURES)
def test_engines_differ_by_rounding(feature, tmp_path):
    bullet, mujoco = runs(tmp_path, FEATURES[feature])
    assert np.max(np.abs(bullet.samples.values["link_position"])) > 0.01
    for name, values in bullet.samples.values.items():
        scale = max(1.0, float(np.nanmax(np.abs(values), initial=0.0)))
        np.testing.assert_allclose(mujoco.samples.values[name], values, rtol=0, atol=1e3 * SAME * scale, err_msg=name)
    np.testing.assert_allclose(
        mujoco.samples.values["link_position"], bullet.samples.values["link_position"], rtol=0, atol=SAME
    )
    assert set(bullet.bodies) == set(mujoco.bodies)
    for name, poses in bullet.bodies.items():
        assert turned_alike(poses, mujoco.bodies[name]) < SAME, name
    limits = [[joint.as_dict()["limits"] for joint in run.summary.joints] for run in (bullet, mujoco)]
    assert limits[0] == limits[1]
