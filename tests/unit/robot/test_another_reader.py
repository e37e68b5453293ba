"""Another reader of URDF, yourdfpy, puts every link where asrsim puts it, with the same mass."""

import numpy as np
import pytest

from asrsim.robot import load_robot
from asrsim.robot.dynamics import RobotModel
from support.paths import ROOT
from support.random_robots import random_urdf

yourdfpy = pytest.importorskip("yourdfpy")
EXAMPLES = sorted((ROOT / "examples" / "urdf").glob("*.urdf"))


def check(path):
    robot = load_robot(path)
    other = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    source = np.random.default_rng(1)
    positions = {joint.name: float(source.uniform(-0.5, 0.5)) for joint in robot.moving_joints}
    other.update_cfg({name: positions[name] for name in other.actuated_joint_names})
    model = RobotModel(robot)
    masses = {link.name: link.mass or 0.0 for link in robot.links}
    for link, pose in model.poses([positions[name] for name in model.joints]).items():
        expected = other.get_transform(link, robot.root.name)
        np.testing.assert_allclose(pose, expected, atol=1e-12)
        inertial = other.link_map[link].inertial
        assert masses[link] == (inertial.mass if inertial else 0.0)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_links_of_the_examples_are_where_yourdfpy_has_them(path):
    check(path)


@pytest.mark.parametrize("seed", range(3))
def test_links_of_random_trees_are_where_yourdfpy_has_them(seed, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(random_urdf(seed, square=False), encoding="utf-8")
    check(path)
