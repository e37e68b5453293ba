"""Shapes as pictures show them: places, units and colours of COLLADA scenes and OBJ materials; smooth solids."""

import math

import numpy as np
import pytest
import trimesh

import asrsim
from asrsim.render.scene import GREY, RenderScene
from asrsim.render.shapes import drawable
from asrsim.robot import load_robot
from asrsim.robot.meshes import mesh_parts

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 3]], float)
FANS = SQUARE[[[0, 1, 2], [0, 2, 3]]]
VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'
GROUPS = {
    "triangles": f'<triangles count="2" material="m0">{VERTEX}<p>0 1 2 0 2 3</p></triangles>',
    "polylist": f'<polylist count="1" material="m0">{VERTEX}<vcount>4</vcount><p>0 1 2 3</p></polylist>',
    "polygons": f'<polygons count="1" material="m0">{VERTEX}<p>0 1 2 3</p></polygons>',
}
BOUND = '<bind_material><technique_common><instance_material symbol="m0" target="#m"/></technique_common></bind_material>'
SHOWN = f'<instance_geometry url="#g">{BOUND}</instance_geometry>'


def document(group, nodes, unit=""):
    """A COLLADA file of a red square."""
    places = " ".join(" ".join(map(str, point)) for point in SQUARE)
    lambert = "<lambert><diffuse><color>1 0 0 1</color></diffuse></lambert>"
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <asset>{unit}<up_axis>Y_UP</up_axis></asset>
    <library_effects><effect id="e"><profile_COMMON><technique sid="c">{lambert}</technique></profile_COMMON></effect>
    </library_effects><library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
    <library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="12">{places}</float_array>
    <technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
    <param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{group}</mesh></geometry></library_geometries>
    <library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
    <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def shown(folder, shape):
    """Meshes and colours of a shape of a robot's only link, as pictures show them."""
    file = folder / "robot.urdf"
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    joint = '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint>'
    visual = f"<visual><geometry>{shape}</geometry></visual>"
    file.write_text(f'<robot name="r"><link name="base"/>{joint}<link name="arm">{body}{visual}</link></robot>')
    scenario = asrsim.make_scenario(file, duration=1.0, base_dir=folder)
    scene = RenderScene(drawable(load_robot(file))[0], scenario)
    return [(part.mesh, part.colour) for part in scene.parts if part.body == "arm"]


def corners(triangles):
    return {frozenset(map(tuple, triangle)) for triangle in np.round(triangles, 9).tolist()}


@pytest.mark.parametrize(("group", "name"), [*((group, "m.dae") for group in GROUPS), ("triangles", "M.DAE")])
def test_nodes_place_and_scale_faces_in_the_file_s_unit(tmp_path, group, name):
    inner = f'<node id="i"><translate>1 0 0</translate>{SHOWN}</node>'
    nodes = f'<node id="o"><rotate>0 0 1 90</rotate>{inner}</node>'
    (tmp_path / name).write_text(document(GROUPS[group], nodes, '<unit meter="0.01"/>'))
    ((mesh, colour),) = shown(tmp_path, f'<mesh filename="{name}"/>')
    turned = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], float)
    np.testing.assert_allclose(mesh.triangles, 0.01 * np.add(FANS, (1, 0, 0)) @ turned.T, atol=1e-8)
    np.testing.assert_allclose(colour, [1, 0, 0])


@pytest.mark.parametrize("nodes", ["", f'<node id="n">{SHOWN}<instance_node url="#n"/></node>', '<node id="n"/>'])
def test_what_shows_nothing_or_has_no_end_is_an_error(tmp_path, nodes):
    (tmp_path / "m.dae").write_text(document(GROUPS["triangles"], nodes))
    with pytest.raises(ValueError, match=r"cannot be read|no triangle"):
        mesh_parts(tmp_path / "m.dae")


def test_faces_of_obj_files_have_the_material_before_them(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0 0\nNs 5\nnewmtl b\nKd 0 .5 1\n")
    lines = ["mtllib m.mtl", *("v " + " ".join(map(str, point)) for point in SQUARE), "usemtl b", "f 1 3 -1"]
    (tmp_path / "m.obj").write_text("\n".join([*lines, "usemtl a", "f 1 2 3 4"]))
    (blue, red) = sorted(shown(tmp_path, '<mesh filename="m.obj"/>'), key=lambda part: part[1][0])
    for (mesh, colour), faces, expected in ((blue, FANS[1:], [0, 0.5, 1]), (red, FANS, [1, 0, 0])):
        assert corners(mesh.triangles) == corners(faces)
        np.testing.assert_allclose(colour, expected, atol=1 / 255)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_stl_files_are_read(tmp_path, kind):
    trimesh.creation.box(extents=(1.0, 2.0, 3.0)).export(tmp_path / "box.stl", file_type=kind)
    ((mesh, colour),) = shown(tmp_path, '<mesh filename="box.stl" scale="1 1 0.5"/>')
    assert (mesh.volume, colour.tolist()) == (pytest.approx(3.0), list(GREY))


@pytest.mark.parametrize(
    ("shape", "ends", "volume"),
    [
        ('<box size="1 2 3"/>', (0.5, 1, 1.5), 6),
        ('<sphere radius="0.5"/>', (0.5,) * 3, math.pi / 6),
        ('<cylinder radius="0.5" length="2"/>', (0.5, 0.5, 1), math.pi / 2),
        # A capsule is drawn as a cylinder and two balls.
        ('<capsule radius="0.5" length="2"/>', (0.5, 0.5, 1.5), math.pi / 2 + 2 * math.pi / 6),
    ],
)
def test_solids_have_their_size_and_sharp_edges_only_where_faces_meet(tmp_path, shape, ends, volume):
    meshes = [mesh for mesh, _ in shown(tmp_path, shape)]
    np.testing.assert_allclose(np.max([mesh.bounds[1] for mesh in meshes], axis=0), ends, rtol=0.02)
    assert sum(mesh.volume for mesh in meshes) == pytest.approx(volume, rel=0.04)
    bends = [np.einsum("mki,mi->mk", mesh.vertex_normals[mesh.faces], mesh.face_normals).min() for mesh in meshes]
    assert min(bends) == pytest.approx(1.0) if "box" in shape else 0.98 < min(bends) < 0.9999


def test_a_fine_mesh_is_simplified_and_keeps_its_shape(tmp_path):
    trimesh.creation.icosphere(subdivisions=6).export(tmp_path / "ball.stl")
    ((mesh, _),) = shown(tmp_path, '<mesh filename="ball.stl"/>')
    assert 10_000 < len(mesh.faces) <= 20_000
    assert mesh.volume == pytest.approx(4.0 / 3.0 * math.pi, rel=0.02)
