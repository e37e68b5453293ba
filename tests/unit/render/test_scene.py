"""Shapes of a robot and its world in pictures."""

import io
from pathlib import Path

import numpy as np
import pytest
import yourdfpy
from scipy.spatial.transform import Rotation
from trimesh import creation

import asrsim
from asrsim.render.scene import RenderScene
from asrsim.render.shapes import drawable
from asrsim.robot import load_robot
from support.turned_chain import TURNED

URDF = """<robot name="r"><link name="base"/><joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<visual><origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/>
<geometry><mesh filename="stone.stl" scale="1 2 3"/></geometry></visual></link></robot>"""
ROBOTS = {path.stem: path for path in sorted((Path(__file__).parents[3] / "examples/urdf").glob("*.urdf"))}
SHAPES = {
    "stone": ({"shape": "mesh", "mesh": "stone.stl", "size": [0.1, 0.2, 0.3]}, (0.1, 0.2, 0.3)),
    "crate": ({"shape": "box", "size": [0.1, 0.2, 0.3]}, (0.1, 0.2, 0.3)),
    "can": ({"shape": "cylinder", "size": [0.05, 0.2]}, (0.1, 0.1, 0.2)),
    "ball": ({"shape": "sphere", "size": 0.1}, (0.2, 0.2, 0.2)),
}


def test_shapes_have_their_sizes_and_places(tmp_path):
    creation.box().export(tmp_path / "stone.stl")
    (tmp_path / "robot.urdf").write_text(URDF)
    objects = {name: {**keys, "mass": 0, "position": [i, 2, 3]} for i, (name, (keys, _)) in enumerate(SHAPES.items())}
    scenario = asrsim.make_scenario(tmp_path / "robot.urdf", duration=1.0, world={"objects": objects}, base_dir=tmp_path)
    scene = RenderScene(drawable(load_robot(tmp_path / "robot.urdf"))[0], scenario)
    ends = {part.body: part.mesh.bounds for part in scene.parts}
    for name, (_, size) in SHAPES.items():
        np.testing.assert_allclose(ends[name], [-0.5 * np.array(size), 0.5 * np.array(size)], atol=2e-3)
    np.testing.assert_allclose(ends["arm"], [[-0.9, -0.3, -1.2], [1.1, 0.7, 1.8]], atol=1e-9)
    frames = scene.frames({"j": 0.5}, {"ball": np.array([7.0, 8.0, 9.0, 0.0, 0.0, 0.0, 1.0])})
    assert [frames[name][:3, 3].tolist() for name in ("crate", "ball")] == [[1.0, 2.0, 3.0], [7.0, 8.0, 9.0]]
    np.testing.assert_allclose(frames["arm"][:3, :3], Rotation.from_euler("x", 0.5).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("name", [*ROBOTS, "turned"])
def test_two_readers_of_one_file_place_the_links_at_the_same_frames(name, tmp_path):
    """yourdfpy reads the text itself; asrsim's model and the scene of its pictures come from asrsim's reader."""
    file = ROBOTS.get(name, tmp_path / "turned.urdf")
    if name == "turned":
        file.write_text(TURNED)
    robot = load_robot(file)
    joints = {joint.name: value for joint, value in zip(robot.moving_joints, np.linspace(-1.1, 0.9, 50), strict=False)}
    scenario = asrsim.make_scenario(file, duration=1.0, base_dir=file.parent)
    scene = RenderScene(drawable(robot)[0], scenario)
    read = yourdfpy.URDF.load(io.BytesIO(robot.text.encode()), load_meshes=False)
    frames = scene.frames(joints, {})
    base = np.linalg.inv(frames[robot.root.name])
    for reader in (read, scene.urdf):
        reader.update_cfg(joints)
        for link in robot.links:
            np.testing.assert_allclose(reader.get_transform(link.name), base @ frames[link.name], atol=1e-12)
