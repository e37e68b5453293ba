"""COLLADA files in all their spellings: groups of triangles and polygons, scenes of nodes within nodes, materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asrsim.render.mesh_files import read_mesh

pytestmark = pytest.mark.once

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 3]], float)
FANS = SQUARE[[[0, 1, 2], [0, 2, 3]]]
VERTEX, NORMAL = '<input semantic="VERTEX" source="#v" offset="{}"/>', '<input semantic="NORMAL" source="#n" offset="{}"/>'
GROUPS = {
    "triangles": f"<triangles>{VERTEX.format(0)}<p>0 1 2 0 2 3</p></triangles>",
    "triangles behind normals": f"<triangles>{NORMAL.format(0)}{VERTEX.format(1)}<p>9 0 9 1 9 2 9 0 9 2 9 3</p></triangles>",
    "two lists": f"<triangles>{VERTEX.format(0)}<p>0 1 2</p></triangles><triangles>{VERTEX.format(0)}<p>0 2 3</p></triangles>",
    "polylist": f"<polylist>{VERTEX.format(0)}<vcount>4</vcount><p>0 1 2 3</p></polylist>",
    "polylist of two": f"<polylist>{VERTEX.format(0)}{NORMAL.format(2)}<vcount>3 3</vcount>"
    "<p>0 5 5 1 5 5 2 5 5 0 5 5 2 5 5 3 5 5</p></polylist>",
    "polygons": f"<polygons>{VERTEX.format(0)}<p>0 1 2 3</p></polygons>",
    "polygons of three": f"<polygons>{VERTEX.format(0)}{NORMAL.format(1)}<p>0 0 1 0 2 0</p><p>0 0 2 0 3 0</p></polygons>",
}
INSTANCE = '<instance_geometry url="#g"/>'
TURNED, TIPPED = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], float), np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
SCENES: dict[str, tuple[str, list[np.ndarray]]] = {
    "none": ("", [SQUARE]),
    "plain": (f"<node>{INSTANCE}</node>", [SQUARE]),
    "twice": (
        f"<node>{INSTANCE}</node><node><translate>0 0 7</translate>{INSTANCE}</node>",
        [SQUARE, np.add(SQUARE, (0, 0, 7))],
    ),
    "scaled": (f"<node><scale>1 2 3</scale>{INSTANCE}</node>", [SQUARE * [1, 2, 3]]),
    "turned": (f"<node><rotate>0 0 1 90</rotate>{INSTANCE}</node>", [SQUARE @ TURNED.T]),
    "matrix": (
        f"<node><matrix>0 -1 0 4 1 0 0 5 0 0 1 6 0 0 0 1</matrix>{INSTANCE}</node>",
        [np.add(SQUARE @ TURNED.T, (4, 5, 6))],
    ),
    "in order": (
        f"<node><translate>1 2 3</translate><rotate>1 0 0 90</rotate><scale>2 1 1</scale>{INSTANCE}</node>",
        [np.add((SQUARE * [2, 1, 1]) @ TIPPED.T, (1, 2, 3))],
    ),
    "within": (
        f"<node><rotate>0 0 1 90</rotate><node><translate>1 0 0</translate>{INSTANCE}</node></node>",
        [np.add(SQUARE, (1, 0, 0)) @ TURNED.T],
    ),
    "by name": ('<node><translate>1 0 0</translate><instance_node url="#i"/></node>', [np.add(SQUARE, (1, 1, 0))]),
    "too few numbers": (f"<node><translate>1 2</translate><scale>3</scale><matrix>1 2 3</matrix>{INSTANCE}</node>", [SQUARE]),
}  # fmt: skip


def document(group: str, nodes: str = "", *, stride: int = 3, more: str = "", unit: str = "") -> str:
    places = " ".join(" ".join(str(x) for x in (*point, 9.0)[:stride]) for point in SQUARE)
    scene = f"<library_visual_scenes><visual_scene>{nodes}</visual_scene></library_visual_scenes>" if nodes else ""
    kept = f'<library_nodes><node id="i"><translate>0 1 0</translate>{INSTANCE}</node></library_nodes>'
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset>{unit}</asset>{more}<library_geometries>
    <geometry id="g"><mesh><source id="p"><float_array>{places}</float_array><technique_common><accessor stride="{stride}"/>
    </technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{group}</mesh></geometry>
    </library_geometries>{kept}{scene}</COLLADA>"""


def triangles(folder: Path, text: str) -> np.ndarray:
    (folder / "m.dae").write_text(text)
    mesh = read_mesh(folder / "m.dae")
    return mesh.points[mesh.triangles]


@pytest.mark.parametrize("stride", [3, 4])
@pytest.mark.parametrize("name", GROUPS)
def test_every_group_of_faces_is_the_same_square(tmp_path: Path, name: str, stride: int) -> None:
    np.testing.assert_allclose(triangles(tmp_path, document(GROUPS[name], stride=stride)), FANS, atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_nodes_place_what_they_hold(tmp_path: Path, name: str) -> None:
    nodes, places = SCENES[name]
    wanted = np.concatenate([place[[[0, 1, 2], [0, 2, 3]]] for place in places])
    np.testing.assert_allclose(triangles(tmp_path, document(GROUPS["polylist"], nodes)), wanted, atol=1e-12)


def test_a_unit_is_that_of_all_lengths(tmp_path: Path) -> None:
    text = document(GROUPS["triangles"], SCENES["matrix"][0], unit='<unit meter="0.01"/>')
    np.testing.assert_allclose(triangles(tmp_path, text)[0, 0], [0.04, 0.05, 0.06], atol=1e-12)


def test_nodes_within_themselves_end(tmp_path: Path) -> None:
    nodes = f'<node id="a"><translate>1 0 0</translate>{INSTANCE}<instance_node url="#a"/></node>'
    found = triangles(tmp_path, document(GROUPS["polylist"], nodes))
    assert len(found) == 2 * 33
    assert found[..., 0].max() == 34.0


def test_colours_come_by_the_scene_s_binding_or_by_name(tmp_path: Path) -> None:
    effect = '<effect id="e{0}"><diffuse><color>{0} 0.5 0.25 1</color></diffuse></effect>'
    material = '<material id="m{0}"><instance_effect url="#e{0}"/></material>'
    more = "".join(text.format(n) for text in (effect, material) for n in (0, 1))
    group = GROUPS["triangles"].replace("<triangles>", '<triangles material="m0">')
    bound = '<bind_material><instance_material symbol="m0" target="#m1"/></bind_material>'
    for nodes, red in (("", 0.0), (f'<node><instance_geometry url="#g">{bound}</instance_geometry></node>', 1.0)):
        (tmp_path / "m.dae").write_text(document(group, nodes, more=more))
        np.testing.assert_allclose(read_mesh(tmp_path / "m.dae").colours, [[red, 0.5, 0.25]] * 2)
    (tmp_path / "m.dae").write_text(document(group, more=more.replace(" 0.25 1", "")))
    assert np.isnan(read_mesh(tmp_path / "m.dae").colours).all()


@pytest.mark.parametrize(
    "group",
    [
        "", GROUPS["triangles"].replace("3</p>", "4</p>"), GROUPS["triangles"].replace("#v", "#nobody"),
        GROUPS["triangles"].replace("VERTEX", "NORMAL"), GROUPS["polylist"].replace("<vcount>4", "<vcount>5"),
        GROUPS["polylist"].replace("<p>0 1 2 3</p>", ""),
    ],
)  # fmt: skip
def test_what_shows_nothing_is_an_error(tmp_path: Path, group: str) -> None:
    with pytest.raises(ValueError, match="no geometry"):
        triangles(tmp_path, document(group))


def test_faces_of_obj_files_have_the_material_before_them(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0 0\nNs 5\nnewmtl b\nKd 0 .5 1 9\n")
    lines = ["", "mtllib m.mtl", *("v " + " ".join(map(str, point)) for point in SQUARE), "f 1 2 3", "usemtl b", "f 1//4 3 -1"]
    (tmp_path / "m.obj").write_text("\n".join([*lines, "usemtl a", "f 1 2 3 4", "usemtl c", "f 2 3 4"]))
    mesh = read_mesh(tmp_path / "m.obj")
    np.testing.assert_allclose(mesh.points[mesh.triangles], np.concatenate([FANS, FANS, SQUARE[[[1, 2, 3]]]]))
    np.testing.assert_allclose(mesh.colours, [[np.nan] * 3, [0, 0.5, 1], [1, 0, 0], [1, 0, 0], [np.nan] * 3])
