"""Shapes of links and objects in contact with the ground, and their inertia."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import asrsim
from asrsim.errors import ScenarioError
from asrsim.simulation.simulation import Simulation
from support.paths import EXAMPLES
from validation.models import INSTALLED, Body, chain

ROBOT = EXAMPLES / "urdf" / "dof1_sea.urdf"
SHAPES = {
    "ball": ('<sphere radius="0.1"/>', "0 0 0", 0.1),
    "ball below": ('<sphere radius="0.1"/>', "0.02 0 -0.05", 0.15),
    "box": ('<box size="0.4 0.3 0.2"/>', "0 0 0.03", 0.07),
    "cylinder": ('<cylinder radius="0.2" length="0.1"/>', "0 0 0", 0.05),
}
"""Shapes of a floating base: geometry, origin, and height of the link's frame on the ground, m."""


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("name", SHAPES)
def test_a_floating_base_rests_on_its_shape(tmp_path, engine, name):
    """The centre of mass is 3 cm off the link's frame, in which the shape is placed."""
    geometry, place, height = SHAPES[name]
    robot = tmp_path / "robot.urdf"
    robot.write_text(
        f"""<robot name="r"><link name="b"><inertial><origin xyz="0 0 0.03"/><mass value="1"/>
        <inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="{place}"/>
        <geometry>{geometry}</geometry></collision></link><joint name="j" type="continuous"><parent link="b"/><child link="l"/>
        <axis xyz="0 0 1"/></joint><link name="l"><inertial><mass value="1e-3"/>
        <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
    )
    base = {"fixed": False, "position": [0, 0, height]}
    scenario = asrsim.make_scenario(robot, engine=engine, duration=0.05, base=base, world={"ground": {}}, compiled=False)
    assert asrsim.run(scenario).bodies["b"][-1, 2] == pytest.approx(height, abs=2e-3)


RESTING = {
    "box": ({"shape": "box", "size": [0.1, 0.2, 0.3]}, 0.15),
    "ball": ({"shape": "sphere", "size": 0.1}, 0.1),
    "cylinder": ({"shape": "cylinder", "size": [0.05, 0.2]}, 0.1),
    "cylinder_on_its_side": ({"shape": "cylinder", "size": [0.05, 0.2], "rpy": [math.pi / 2, 0, 0]}, 0.05),
    "stone": ({"shape": "mesh", "mesh": "stone.stl", "size": [0.1, 0.2, 0.3], "inertia": [0.02, 0.01, 0.01]}, 0.15),
    "heavy_stone": ({"shape": "mesh", "mesh": "stone.stl", "inertia": [0.1, 0.1, 0.1]}, 0.5),
}
"""Objects of the world, and the height of their centres on the ground, m."""


def cube():
    """STL mesh of a cube with edges of 1 m."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], dtype="<f4")
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = [corners[list(three)] for a, b, c, d in sides for three in ((a, b, c), (a, c, d))]
    rows = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in triangles)
    return bytes(80) + len(triangles).to_bytes(4, "little") + rows


@pytest.mark.parametrize("engine", INSTALLED)
def test_objects_of_every_shape_rest_on_the_ground(tmp_path, engine):
    (tmp_path / "stone.stl").write_bytes(cube())
    objects = {
        name: {"mass": 1, "position": [5, 2 * place, height], **shape}
        for place, (name, (shape, height)) in enumerate(RESTING.items())
    }
    world = {"ground": {}, "objects": objects}
    bodies = asrsim.run(
        asrsim.make_scenario(ROBOT, engine=engine, duration=0.05, world=world, compiled=False, base_dir=tmp_path)
    ).bodies
    for name, (_, height) in RESTING.items():
        assert bodies[name][-1, 2] == pytest.approx(height, abs=5e-3), name


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(("amplitude", "near"), [(0.1, 1e-7), (0.4, 3e-4), (0.9, 5e-3)])
def test_a_ground_out_of_reach_changes_neither_friction_nor_stops(tmp_path, engine, amplitude, near):
    """Under 0.1 N m both joints stick; under 0.4 they slide and come to their stops; under 0.9 they strike their stops.
    The solvers of the engines, which are used with contacts, change the sign of friction once a step.
    """
    robot = tmp_path / "arm.urdf"
    link = Body(
        mass=0.4,
        reach=0.1,
        inertia=2e-3,
        length=0.2,
        friction=0.15,
        limits='<limit lower="-0.6" upper="0.6" effort="1e6" velocity="50"/>',
    )
    robot.write_text(chain(link, replace(link, axis="1 0 0")).text)
    push = {"sinusoid": {"amplitude": amplitude, "frequency": 2.0}}
    found = []
    for world in ({}, {"ground": {}}):
        scenario = asrsim.make_scenario(
            robot,
            engine=engine,
            duration=0.6,
            gravity=[0, 0, 0],
            external_torques={"*": push},
            world=world,
            base={"position": [0, 0, 5]},
            compiled=False,
        )
        found.append(asrsim.run(scenario).samples.values["link_position"])
    np.testing.assert_allclose(found[1], found[0], rtol=0.0, atol=near)
    assert np.abs(found[0]).max() < 1e-9 if amplitude < 0.15 else np.abs(found[0]).max() > 0.3


def test_a_mesh_that_moves_needs_its_inertia(tmp_path):
    (tmp_path / "stone.stl").write_bytes(cube())
    world = {"objects": {"stone": {"shape": "mesh", "mesh": "stone.stl", "mass": 1}}}
    with pytest.raises(ScenarioError, match="needs its principal moments of inertia"):
        asrsim.make_scenario(ROBOT, duration=0.1, world=world, base_dir=tmp_path)


def test_objects_have_the_inertia_of_their_shape(tmp_path):
    pytest.importorskip("mujoco")
    x, y, z = 0.1, 0.2, 0.4
    box = np.array([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    shapes = {
        "box": ({"shape": "box", "size": [x, y, z]}, box),
        "mesh": ({"shape": "mesh", "mesh": "stone.stl", "size": [x, y, z], "inertia": [0.1, 0.2, 0.3]}, [0.05, 0.1, 0.15]),
        "ball": ({"shape": "sphere", "size": x}, np.full(3, 0.4 * x * x)),
        "cylinder": ({"shape": "cylinder", "size": [x, z]}, [(3 * x * x + z * z) / 12] * 2 + [x * x / 2]),
        "given": ({"shape": "box", "size": [x, y, z], "inertia": [0.3, 0.2, 0.4]}, [0.15, 0.1, 0.2]),
    }
    (tmp_path / "stone.stl").write_bytes(cube())
    objects = {name: {"mass": 2, "position": [5, i, 1], **shape} for i, (name, (shape, _)) in enumerate(shapes.items())}
    scenario = asrsim.make_scenario(ROBOT, engine="mujoco", duration=0.1, world={"objects": objects}, base_dir=tmp_path)
    with Simulation(scenario) as simulation:
        model = simulation.engine.raw_model
        for name, (_, moments) in shapes.items():
            body = model.body(f"object.{name}")
            # MuJoCo may have turned the axes of a cube's inertia.
            turn = Rotation.from_quat(np.roll(body.iquat, -1)).as_matrix()
            tensor = turn @ np.diag(body.inertia) @ turn.T
            assert tensor == pytest.approx(np.diag(2.0 * np.asarray(moments)), rel=1e-6, abs=1e-7), name
            assert body.mass == pytest.approx(2.0)
