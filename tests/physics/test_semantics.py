"""Keys of a scenario have the documented effect, in numbers that a user can calculate."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError

ROBOT = """<robot name="arm">
  <link name="base"/>
  <link name="arm">
    <inertial>
      <origin xyz="0.1 0 0"/><mass value="1"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="j" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="100"/><dynamics damping="1"/>
  </joint>
  <gazebo>
    <plugin name="p" filename="libsea_plugin.so">
      <joint>j</joint><operation_mode>3</operation_mode>
      <pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>true</sub_ext_tau>
      <spring_k>50</spring_k><max_def>1</max_def>
    </plugin>
  </gazebo>
</robot>
"""
"""URDF of one joint about y with a spring of 50 N m/rad and 1 kg at 0.1 m along x."""
STIFFNESS, WEIGHT = 50.0, 9.81 * 1.0 * 0.1
FREE = [0.0, 0.0, 0.0]
SINE = {"sinusoid": {"amplitude": 0.1, "frequency": 2}}
BASE_MASS = '<link name="base"><inertial>{origin}<mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.3"/></inertial></link>'


@pytest.fixture
def run(tmp_path):
    """Function that runs the robot above. root: XML that replaces the root link; passive: without the actuator."""

    def runner(*, root="", passive=False, **keys):
        text = ROBOT.replace('<link name="base"/>', root or '<link name="base"/>')
        path = tmp_path / "arm.urdf"
        path.write_text(text[: text.index("<gazebo>")] + "</robot>" if passive else text)
        if not passive:
            keys.setdefault("references", {"j": {"equilibrium_position": 0.0}})
        return asrsim.run(asrsim.make_scenario(path, **{"duration": 0.5, **keys}))

    return runner


def about_y(q):
    return np.array([[np.cos(q), 0, np.sin(q)], [0, 1, 0], [-np.sin(q), 0, np.cos(q)]])


@pytest.mark.parametrize("frame", ["world", "link"])
@pytest.mark.parametrize(("force", "point"), [([0, 0, 2.0], [0.3, 0, 0]), ([3.0, 1.0, 0], [0.1, 0.4, 0.2])])
def test_force_at_a_point_has_the_correct_moment(run, frame, force, point):
    wrench = {"link": "arm", "force": force, "point": point, "frame": frame}
    q = run(gravity=FREE, duration=2.5, wrenches=[wrench])["j"].link_position[-1]
    turned = about_y(q)
    pushed = turned @ np.array(force) if frame == "link" else np.array(force)
    assert STIFFNESS * q == pytest.approx(np.cross(turned @ np.array(point), pushed)[1], abs=1e-8)


@pytest.mark.parametrize(("rpy", "tilt"), [([0, 0, 0.7], 0.0), ([0, 0.3, 0], 0.3), ([np.pi, 0, 0], np.pi), ([0.5, 0, 0], None)])
def test_gravity_on_a_turned_base(run, rpy, tilt):
    q = run(duration=2.5, base={"rpy": rpy, "position": [1, 2, 3]})["j"].link_position[-1]
    if tilt is None:  # the base is rolled: the joint axis is no longer horizontal
        expected = WEIGHT * np.cos(0.5) * np.cos(q)
    else:
        expected = WEIGHT * (np.cos(q + tilt) if tilt != np.pi else -np.cos(q))
    assert STIFFNESS * q == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("origin", ["", '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'])
def test_a_floating_robot_falls_freely(run, origin):
    """A robot that starts at rest does not rotate and falls by z = -g t^2 / 2, up to rounding."""
    start = {"fixed": False, "position": [1, 2, 10], "rpy": [0.3, 0.2, 1.0]}
    result = run(root=BASE_MASS.format(origin=origin), passive=True, duration=1.0, base=start)
    pose = result.bodies["base"]
    fallen = np.array([1.0, 2.0, 10.0]) - np.outer(0.5 * 9.81 * result.time**2, [0, 0, 1])
    np.testing.assert_allclose(pose[:, :3], fallen, atol=1e-10)
    np.testing.assert_allclose(pose[:, 3:] - pose[0, 3:], 0.0, atol=1e-12)
    np.testing.assert_allclose(result["j"].link_position, 0.0, atol=1e-10)


# -- imperfections ----------------------------------------------------------------------------------------------------------


def commanded(run, imperfections, *, signal=SINE, **keys):
    references = {"j": {"equilibrium_position": signal}}
    return run(references=references, imperfections={"commands": {"*": imperfections}}, duration=1.0, **keys)


@pytest.mark.parametrize("delay", [0.01, 0.0105])
def test_command_delay_is_exact(run, delay):
    result = commanded(run, {"delay": delay})
    expected = 0.1 * np.sin(4 * np.pi * np.maximum(result.time - delay, 0.0))
    np.testing.assert_allclose(result["j"].reference_1, expected, atol=1e-12)


def test_commands_are_held_at_the_given_rate(run):
    result = commanded(run, {"rate": 100})
    expected = 0.1 * np.sin(4 * np.pi * np.floor(result.time * 100 + 1e-6) / 100)
    np.testing.assert_allclose(result["j"].reference_1, expected, atol=1e-12)


def test_commands_are_quantised(run):
    seen = commanded(run, {"quantum": 0.01})["j"].reference_1
    np.testing.assert_allclose(seen, 0.01 * np.round(seen / 0.01), atol=1e-12)
    assert len(np.unique(np.round(seen / 0.01))) == 21


@pytest.mark.parametrize("imperfections", [{"quantum": 1e-9}, {"noise": 1e-10}])
def test_tiny_noise_does_not_shift_a_jump(run, imperfections):
    """A jump between two steps acts at its time, not at the next step. Noise changes at every step, where kicks are then split:
    their error differs by the square of the step."""
    clean, late, found = (
        commanded(run, given, signal={"step": {"at": at, "to": 0.5}})["j"].link_position
        for at, given in ((0.1004, {}), (0.101, {}), (0.1004, imperfections))
    )
    assert np.abs(found - clean).max() < 0.02 * np.abs(late - clean).max()


def test_a_delayed_jump_is_in_the_row_of_its_time(run):
    """0.1 + 0.005 is larger than 0.105 in floating point."""
    for stepping in ("leapfrog", "euler"):
        result = commanded(run, {"delay": 0.005}, signal={"step": {"at": 0.1, "to": 0.5}}, stepping=stepping)
        assert result.time[np.argmax(result["j"].reference_1)] == 0.105


def test_command_noise_depends_on_the_seed_alone(run):
    first, again, other = (commanded(run, {"noise": 0.02}, signal=0.1, seed=seed)["j"].reference_1 for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    # The tolerance for 1001 draws is 5 standard errors.
    assert first.std() == pytest.approx(0.02, rel=5 / np.sqrt(2 * 1001))
    assert first.mean() == pytest.approx(0.1, abs=5 * 0.02 / np.sqrt(1001))


def test_unused_sensor_effects_give_a_warning(run):
    words = " ".join(map(str, run(imperfections={"sensors": {"j": {"noise": 0.01}}}).summary.warnings))
    assert "no controller reads this sensor in mode 3" in words
    words = " ".join(map(str, run(modes=6, imperfections={"sensors": {"j": {"delay": 0.0102}}}).summary.warnings))
    assert "no controller" not in words


# -- the rest ---------------------------------------------------------------------------------------------------------


def test_parameters_of_all_joints_and_of_one(run):
    soft, softer = ({"*": {"spring_k": 20}}, {"*": {"spring_k": 20}, "j": {"spring_stiffness": 10}})
    for parameters, stiffness in ((soft, 20.0), (softer, 10.0)):
        result = run(parameters=parameters, gravity=FREE, external_torques={"j": 1.0}, duration=4.0)["j"]
        assert 1.0 / result.link_position[-1] == pytest.approx(stiffness, rel=1e-6)


def test_a_floating_root_needs_a_mass(run):
    with pytest.raises(InputError, match="root link 'base'"):
        run(passive=True, base={"fixed": False})
