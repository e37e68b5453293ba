"""`/tf` and `/tf_static` of a log: where viewers see the links is where the engine has them."""

from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

import asrsim
from asrsim.log import LogWriter
from asrsim.simulation.prepare import prepare
from asrsim.simulation.run import simulate
from support.paths import EXAMPLES
from support.random_robots import random_urdf


def matrix(transform):
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat([getattr(transform.rotation, name) for name in "xyzw"]).as_matrix()
    result[:3, 3] = [getattr(transform.translation, name) for name in "xyz"]
    return result


def transforms(path):
    """Topic -> [(time in s, {child: (parent, frame)})]."""
    found = {"/tf": [], "/tf_static": []}
    with path.open("rb") as file:
        for _, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            if channel.topic in found:
                frames = {one.child_frame_id: (one.header.frame_id, matrix(one.transform)) for one in decoded.transforms}
                stamps = {one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in decoded.transforms}
                assert stamps == {message.log_time}
                found[channel.topic].append((message.log_time * 1e-9, frames))
    return found


def placed(link, frames):
    """Frame of a link in the world."""
    pose = np.eye(4)
    while link in frames:
        link, step = frames[link]
        pose = step @ pose
    assert link in ("world", "map")
    return pose


@pytest.mark.parametrize("robot", ["dof2_vertical", "dof5_arm"])
def test_links_stand_where_the_engine_has_them(tmp_path, robot):
    path = tmp_path / "scenario.yaml"
    path.write_text(
        f"robot: {EXAMPLES}/urdf/{robot}.urdf\nduration: 0.3\ntf_rate: 20\nmax_substeps: 1000\ncompiled: false\n"
        "base: {position: [0.1, 0.2, 0.3], rpy: [0.1, 0.4, -0.2]}\n"
        "references: {'*': {equilibrium_position: 0.7, stiffness_preset: 0.1}}\nmodes: 6\n"
    )
    result = asrsim.run(path, out=tmp_path / "out")
    found = transforms(result.log)
    assert [time for time, _ in found["/tf_static"]] == [0.0]
    moving = [entry for entry in found["/tf"] if set(entry[1]) & {j.child for j in result.run.robot.moving_joints}]
    assert [round(time, 9) for time, _ in moving] == pytest.approx(np.arange(0.0, 0.301, 0.05))
    compare(path, result)


@pytest.mark.parametrize("seed", [0, 3, 8])
def test_frames_of_any_tree_are_those_of_the_engine(tmp_path, seed):
    """Sliding and turning joints about any axis, in frames that are turned, with links that fixed joints hold."""
    (tmp_path / "robot.urdf").write_text(random_urdf(seed))
    path = tmp_path / "scenario.yaml"
    path.write_text("robot: robot.urdf\nduration: 0.1\ntf_rate: 20\ncompiled: false\nbase: {rpy: [0.5, -0.3, 0.8]}\n")
    compare(path, asrsim.run(path, out=tmp_path / "out"))


def compare(path, result):
    """The log's frames at the end with those of the engine."""
    found = transforms(result.log)
    moved = {joint.child for joint in result.run.robot.moving_joints}
    time, frames = [entry for entry in found["/tf"] if set(entry[1]) & moved][-1]
    still = found["/tf_static"][0][1] if found["/tf_static"] else {}
    model = prepare(path).model
    row = round(time / result.run.scenario.step)
    positions = [result[joint]["link_position"][row] for joint in model.joints]
    for link in model.links:
        point, rotation = model.pose(positions, link, (0.0, 0.0, 0.0))
        pose = placed(link, {**still, **frames})
        np.testing.assert_allclose(pose[:3, 3], point, atol=1e-6)
        np.testing.assert_allclose(pose[:3, :3], rotation, atol=1e-6)


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("size", [1, 3, 1000])
def test_every_frame_is_written_once_however_the_log_is_cut(tmp_path, size, every):
    """A frame of a chunk's last sample belongs to it, and to no other."""
    path = EXAMPLES / "scenarios" / "step_1dof_sea.yaml"
    one = simulate(asrsim.load_scenario(path, variant="soft", overrides={"duration": 0.05, "expect": []})[0])
    # Times of which many lie a little below a whole ns in binary.
    one = replace(one, samples=replace(one.samples, time=0.0017 * np.arange(len(one.samples.time))))
    assert np.any(np.floor(one.samples.time * 1e9) != np.rint(one.samples.time * 1e9))
    info = replace(one.info, frame_rate=1.0 / (every * 0.0017))
    with LogWriter(tmp_path / "a.mcap", info) as writer:
        for start in range(0, len(one.samples.time), size):
            cut = slice(start, start + size)
            values = {name: table[cut] for name, table in one.samples.values.items()}
            writer.write(replace(one.samples, time=one.samples.time[cut], values=values))
            writer.flush()
    moving, still = transforms(tmp_path / "a.mcap").values()
    assert [time for time, _ in moving] == pytest.approx(one.samples.time[::every])
    assert len(still) <= 1
