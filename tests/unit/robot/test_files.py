"""Hostile and broken robot files, structure, xacro."""

import time

import numpy as np
import pytest

from asrsim.errors import RobotError
from asrsim.robot import load_robot
from asrsim.robot.doubts import warnings_of
from asrsim.robot.edit import edited_urdf
from asrsim.robot.expansion import expand_xacro
from asrsim.robot.inertia import inertia_tensor
from asrsim.robot.packages import packages_of
from asrsim.robot.vary import varied_robot

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>'
MASSLESS = INERTIAL.replace('"1"', '"0"').replace("0.1", "0")
LIMIT = '<limit effort="1" velocity="1" lower="-1" upper="1"/>'
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def joint(name, parent, child, extra=LIMIT, kind="revolute"):
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{extra}</joint>\n'


def link(name, inertial=INERTIAL):
    return f'<link name="{name}">{inertial}</link>\n'


def robot(body):
    return f'<robot name="r">\n{body}</robot>'


GOOD = link("a", "") + joint("j", "a", "b") + link("b")


def fails(read, text, name="robot.urdf", **options):
    with pytest.raises(RobotError) as caught:
        read(text, name, **options)
    assert all(problem.file is not None for problem in caught.value.problems)
    return [problem.code for problem in caught.value.problems]


# -- hostile and malformed ---------------------------------------------------------------------------------------------


def test_entity_bomb_is_refused_and_quick(read):
    entities = '<!ENTITY a "lol">' + "".join(
        f'<!ENTITY a{i} "{("&a" + (str(i - 1) if i else "") + ";") * 10}">' for i in range(10)
    )
    start = time.perf_counter()
    assert fails(read, f"<!DOCTYPE robot [{entities}]><robot name='&a9;'/>") == ["xml-declarations"]
    assert time.perf_counter() - start < 1.0


def test_external_entity_is_refused(read, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("hidden")
    text = f'<!DOCTYPE robot [<!ENTITY x SYSTEM "{secret.as_uri()}">]><robot name="r"><link name="&x;"/></robot>'
    assert fails(read, text) == ["xml-declarations"]


def test_external_document_type_is_not_loaded(read):
    assert read('<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/x.dtd">' + robot(GOOD)).name == "r"


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "malformed-xml"),
        ("<robot>", "malformed-xml"),
        ("no xml at all", "malformed-xml"),
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "lfs-pointer"),
        ("<robot name='r'><link name='a'></robot>", "malformed-xml"),
        ("<robot>" + "<x>" * 5000 + "</x>" * 5000 + "</robot>", "malformed-xml"),
        ("<sdf version='1.6'/>", "not-a-urdf"),
        ("<robot name='r'/>", "no-links"),
        (robot("".join(link(f"l{i}", "") for i in range(2500))), "too-many-links"),
    ],
)
def test_malformed_files(read, text, code):
    assert fails(read, text) == [code]


def test_missing_file_and_folder(tmp_path):
    for path, code in ((tmp_path / "none.urdf", "missing-file"), (tmp_path, "not-a-file")):
        with pytest.raises(RobotError) as caught:
            load_robot(path)
        assert caught.value.problems[0].code == code


# -- structure ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (GOOD + link("b"), "duplicate-link"),
        (GOOD + joint("j", "a", "c") + link("c"), "duplicate-joint"),
        (GOOD + "<link/>", "missing-name"),
        (GOOD + link("c"), "several-roots"),
        (GOOD + joint("k", "b", "nothing"), "unknown-link"),
        (GOOD + joint("k", "a", "b"), "two-parents"),
        (link("a") + link("b") + joint("j", "a", "b") + joint("k", "b", "a"), "loop"),
        (link("a", "") + joint("j", "a", "b", kind="hinge") + link("b"), "joint-type"),
        (link("a", "") + joint("j", "a", "b", '<axis xyz="0 0 0"/>' + LIMIT) + link("b"), "zero-axis"),
        (link("a", "") + joint("j", "a", "b", LIMIT + '<dynamics damping="-1"/>') + link("b"), "negative-damping"),
        (link("a", "") + joint("j", "a", "b", LIMIT + '<dynamics damping="nan"/>') + link("b"), "not-finite"),
        (GOOD.replace('mass value="1"', 'mass value="-1"'), "negative-mass"),
        (GOOD.replace('ixx="0.1"', 'ixx="-0.1"'), "negative-inertia"),
        (GOOD.replace('ixx="0.1"', 'ixx="much"'), "not-a-number"),
        (GOOD.replace(' izz="0.1"', ""), "missing-attribute"),
        (GOOD.replace('mass value="1"', 'mass value="1e308"'), "out-of-range"),
        (GOOD + link("c") + joint("k", "b", "c", '<parent link="a"/>' + LIMIT), "missing-tag"),
        (link("a", "") + joint("j", "a", "b") + link("b", MASSLESS), "massless-joint"),
        (GOOD.replace('"j"', f'"{"j" * 300}"'), "long-name"),
        (GOOD.replace('<inertia ixx="0.1" iyy="0.1" izz="0.1"/>', ""), "missing-tag"),
    ],
)
def test_bad_structure(read, body, code):
    assert fails(read, robot(body)) == [code]


@pytest.mark.parametrize(
    ("given", "stops"),
    [
        ('lower="-1"', (-1.0, 0.0)),
        ('upper="1"', (0.0, 1.0)),
        ('lower="0.3" upper="0.3"', (0.3, 0.3)),
        ('lower="-2" upper="-1"', (-2.0, -1.0)),
        ("", (-np.inf, np.inf)),
        ('lower="-inf" upper="0.5"', (-np.inf, 0.5)),
    ],
)
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_missing_limit_beside_a_stated_limit_is_0(read, kind, given, stops):
    """URDF's own default; without either there are none. Continuous joints have none whatever is written."""
    limit = f'<limit effort="1" velocity="1" {given}/>'
    robots = (read(robot(link("a", "") + joint("j", "a", "b", limit, one) + link("b"))) for one in (kind, "continuous"))
    assert [one.moving_joints[0].stops for one in robots] == [stops, (-np.inf, np.inf)]


@pytest.mark.parametrize("seed", range(6))
def test_an_inertia_with_impossible_products_is_replaced_by_that_of_a_body(read, seed):
    """A cloud of points has the inertia that asrsim returns: no principal moment is above the sum of the others."""
    generator = np.random.default_rng(seed)
    moments, products = generator.uniform(0.0, 0.1, 3), generator.normal(0.0, 0.3, 3)
    xx, yy, zz, xy, xz, yz = *moments, *products
    keys = f'ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"'
    found = read(robot(GOOD.replace('ixx="0.1" iyy="0.1" izz="0.1"', keys)))
    stated = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert stated[0] < 0.0
    (warned,) = [one for one in warnings_of(found) if one.code == "impossible-inertia"]
    assert f"{stated[0]:.4g}" in str(warned.value)
    used = np.linalg.eigvalsh(inertia_tensor(found.links[-1]))
    assert used[2] <= (used[0] + used[1]) * (1.0 + 1e-12)
    assert f"{used[2]:.4g}" in warned.message


@pytest.mark.parametrize(("moment", "fine"), [("-1e-5", True), ("-1e-3", False)])
def test_a_negative_moment_is_refused_unless_rounding_explains_it(read, moment, fine):
    text = robot(GOOD.replace('ixx="0.1"', f'ixx="{moment}"'))
    if fine:
        assert "impossible-inertia" in [one.code for one in warnings_of(read(text))]
    else:
        assert fails(read, text) == ["negative-inertia"]


def test_errors_are_collected_with_lines(read):
    text = robot(link("a", "") + joint("j", "a", "b", '<axis xyz="0 0 0"/>') + GOOD.split("\n")[2].replace('"1"', '"-1"'))
    with pytest.raises(RobotError) as caught:
        read(text)
    assert [(problem.code, problem.line) for problem in caught.value.problems] == [("zero-axis", 3), ("negative-mass", 4)]


def test_structure_warnings(read):
    body = (
        link("a", "")
        + joint("j", "a", "b", '<axis xyz="0 2 0"/>')
        + link("b", INERTIAL.replace('izz="0.1"', 'izz="0.5"'))
        + joint("f", "b", "c", "", "fixed")
        + link("c", "")
        + joint("g", "b", "d", "", "fixed")
        + link("d", INERTIAL.replace("0.1", "0"))
        + joint("m", "b", "e", LIMIT + '<mimic joint="j"/>')
        + link("e")
    )
    found = {(problem.code, problem.key) for problem in warnings_of(read(robot(body)))}
    assert found == {
        ("axis-length", "j"),
        ("missing-limit", "j"),
        ("triangle-inequality", "b"),
        ("no-inertial", "c"),
        ("zero-inertia", "d"),
        ("mimic-limits", "m"),
        ("no-actuators", "r"),
    }


@pytest.mark.parametrize(
    ("kind", "limits", "code"),
    [
        ("revolute", "", "missing-limit"), ("prismatic", "", "missing-limit"), ("revolute", 'upper="1"', None),
        ("continuous", "", None), ("continuous", 'lower="-1" upper="1"', "continuous-limits"),
        ("continuous", 'lower="-3.14" upper="3.14"', None), ("continuous", 'lower="0" upper="0"', None),
    ],
)  # fmt: skip
def test_limits_that_other_readers_take_otherwise_get_a_warning(read, kind, limits, code):
    stated = f'<axis xyz="0 0 1"/><limit effort="1" velocity="1" {limits}/>'
    found = read(robot(link("a", "") + joint("j", "a", "b", stated, kind) + link("b")))
    told = {one.code for one in warnings_of(found)} & {"missing-limit", "continuous-limits"}
    assert told == ({code} if code else set())


def test_a_floating_root_says_that_the_robot_may_float(read):
    """A root of neither mass nor shape, and nothing else on it; any other floating joint would be lost in silence."""
    floating = joint("root", "world", "a", "", "floating") + GOOD.replace(link("a", ""), link("a"))
    found = read(robot(link("world", "") + floating))
    assert [one.name for one in found.links] == ["a", "b"]
    assert [one.name for one in found.joints] == ["j"]
    assert ("floating-root", "root") in {(problem.code, problem.key) for problem in warnings_of(found)}
    plugin = '<gazebo><plugin name="p" filename="libsea_plugin.so"><joint>root</joint></plugin></gazebo>'
    for other in (
        link("world") + floating,
        link("world", '<collision><geometry><sphere radius="1"/></geometry></collision>') + floating,
        link("world", "") + floating + joint("k", "world", "c") + link("c"),
        link("world", "") + floating + plugin,
        link("top") + joint("t", "top", "world", "", "fixed") + link("world", "") + floating,
    ):
        assert "joint-type" in fails(read, robot(other))


# -- xacro -------------------------------------------------------------------------------------------------------------


def xacro(body):
    return f"{HEAD}{body}</robot>"


def test_xacro_with_arguments_includes_and_packages(read, tmp_path):
    package = tmp_path / "elsewhere"
    package.mkdir()
    (package / "parts.xacro").write_text(
        f'{HEAD}<xacro:macro name="part" params="name mass:=1"><link name="${{name}}"><inertial><mass value="${{mass}}"/>'
        '<inertia ixx="1" iyy="1" izz="1"/></inertial></link></xacro:macro></robot>'
    )
    (tmp_path / "masses.yaml").write_text("hand: 0.25\n")
    body = (
        '<xacro:arg name="mode" default="2"/><xacro:include filename="$(find parts)/parts.xacro"/>'
        '<xacro:property name="masses" value="${xacro.load_yaml(\'masses.yaml\')}"/>'
        f'{link("a", "")}<xacro:part name="hand" mass="${{masses.hand * 2}}"/>{joint("j", "a", "hand")}'
        '<gazebo><plugin name="p" filename="libsea_plugin.so"><joint>j</joint><operation_mode>$(arg mode)</operation_mode>'
        "<spring_k>${ round(10*pi, 2) }</spring_k></plugin></gazebo>"
    )
    found = read(xacro(body), "r.xacro", xacro_arguments={"mode": "5"}, package_paths={"parts": package})
    assert found.links[1].mass == 0.5
    assert found.actuators[0].mode == 5
    assert found.actuators[0].values()["spring_stiffness"] == 31.42
    assert found.actuators[0].line is None


def test_file_finds_its_own_package(read, tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>mine</name></package>")
    (tmp_path / "links").mkdir()
    (tmp_path / "urdf").mkdir()
    (tmp_path / "links/a.xacro").write_text(xacro(GOOD))
    assert read(xacro('<xacro:include filename="$(find mine)/links/a.xacro"/>'), "urdf/r.xacro").links[1].name == "b"


@pytest.mark.parametrize(
    "expression",
    [
        "${().__class__}", "${(x for x in [1]).gi_frame}", "${python.type(1)}", "${python.vars(1)}", "${lambda: 1}",
        "${[(y:=1)]}", "${asrsim_attribute(1, 'real')}", "${str.format}", "$(eval ''.__class__)", "$(eval open)",
        "$(env HOME)", "${load_yaml('../outside.yaml')}", "$(find nowhere)", "${nothing}", "${'a'*10**12}",
    ],
)  # fmt: skip
def test_xacro_expressions_reach_nothing(read, tmp_path, expression):
    (tmp_path / "outside.yaml").write_text("secret: 1")
    (tmp_path / "inner").mkdir()
    text = xacro(GOOD + f'<gazebo note="{expression}"/>')
    found = fails(read, text, "inner/r.xacro")
    assert found[0] in ("xacro-refused", "xacro-failed", "path-outside", "unknown-package")


def test_xacro_includes_stay_inside(read, tmp_path):
    (tmp_path / "outside.xacro").write_text(xacro(GOOD))
    (tmp_path / "inner").mkdir()
    for target in ("../outside.xacro", str(tmp_path / "outside.xacro")):
        assert fails(read, xacro(f'<xacro:include filename="{target}"/>'), "inner/r.xacro") == ["path-outside"]
    (tmp_path / "inner/link.xacro").symlink_to(tmp_path / "outside.xacro")
    assert fails(read, xacro('<xacro:include filename="link.xacro"/>'), "inner/r.xacro") == ["path-outside"]


def test_xacro_includes_are_not_trusted_with_entities(read, tmp_path):
    (tmp_path / "bomb.xacro").write_text('<!DOCTYPE r [<!ENTITY a "x">]><robot name="&a;"/>')
    assert fails(read, xacro('<xacro:include filename="bomb.xacro"/>'), "r.xacro") == ["xml-declarations"]


def test_xacro_recursion_and_unknown_macros(read):
    loop = '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>'
    assert fails(read, xacro(loop), "r.xacro") == ["xacro-failed"]
    assert fails(read, xacro("<xacro:nothing/>"), "r.xacro") == ["xacro-failed"]


def test_xacro_is_stopped_in_time(tmp_path):
    path = tmp_path / "r.xacro"
    path.write_text(xacro('<gazebo note="${9**9**9}"/>'))
    with pytest.raises(RobotError) as caught:
        expand_xacro(path, {}, packages_of(path), time_limit=0.5)
    assert caught.value.problems[0].code == "xacro-timeout"


def test_xacro_sees_no_environment(read, monkeypatch):
    monkeypatch.setenv("ASRSIM_SECRET", "hidden")
    text = read(xacro(GOOD + '<gazebo note="$(optenv ASRSIM_SECRET nothing)"/>'), "r.xacro").text
    assert "hidden" not in text
    assert 'note="nothing"' in text


# -- anything at all ---------------------------------------------------------------------------------------------------


def test_other_encodings_are_read(tmp_path):
    text = robot(GOOD.replace('"b"', '"café"'))
    for encoding in ("ISO-8859-1", "utf-16", "utf-8-sig"):
        path = tmp_path / f"{encoding}.urdf"
        declared = "utf-8" if encoding == "utf-8-sig" else encoding
        path.write_bytes(f'<?xml version="1.0" encoding="{declared}"?>{text}'.encode(encoding))
        found = load_robot(path)
        assert found.links[1].name == "café"


# -- shapes ------------------------------------------------------------------------------------------------------------


WHITE = '<material name="m"><color rgba="{}"/></material>'
SHAPES = {
    "box": ('<geometry><box size="1 2 3"/></geometry>', {"size": (1, 2, 3), "origin": (0, 0, 0), "rpy": (0, 0, 0)}),
    "largest": ('<geometry><sphere radius="1e6"/></geometry>', {"size": (1e6,)}),
    "too large": ('<geometry><sphere radius="1.001e6"/></geometry>', None),
    "cylinder": (
        '<origin xyz="1 2 3" rpy=".1 .2 .3"/><geometry><cylinder length="2" radius="1"/></geometry>',
        {"size": (1, 2), "origin": (1, 2, 3), "rpy": (0.1, 0.2, 0.3)},
    ),
    "turned": (
        '<origin rpy="0 0 1"/><geometry><capsule length="2" radius="1"/></geometry>',
        {"rpy": (0, 0, 1), "size": (1, 2)},
    ),
    "mesh": ('<geometry><mesh filename="a.stl"/></geometry>', {"mesh": "a.stl", "scale": (1, 1, 1), "size": ()}),
    "one scale": ('<geometry><mesh filename="a.stl" scale="2"/></geometry>', {"scale": (2, 2, 2)}),
    "colour": (f'<geometry><sphere radius="1"/></geometry>{WHITE.format("2 -1 .5 .25")}', {"colour": (1, 0, 0.5, 0.25)}),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_read_as_they_stand(read, name):
    text, expected = SHAPES[name]
    found = read(robot(GOOD.replace("</link>", f"<visual>{text}</visual></link>", 1)))
    shapes = found.root.visuals
    assert len(shapes) == (expected is not None)
    assert bool([one for one in warnings_of(found) if one.line is not None and "shape" in one.code]) == (expected is None)
    for key, value in (expected or {}).items():
        assert getattr(shapes[0], key) == value


ORIGINS = ("", "<origin/>", "<origin rpy='0 0 0.5'/>", "<origin\n xyz='0.1\t0.2  0.3' rpy='0 0 0.5'/>")
DYNAMICS = (
    "",
    "<dynamics/>",
    "<dynamics armature='0.4'/>",
    "<dynamics friction='0.1'/>",
    '<dynamics damping = "0.3"></dynamics>',
)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_numbers_put_into_a_file_are_read_from_it(tmp_path, origin, dynamics):
    """Whatever the file has of the numbers already: it reads as the robot that was varied without it."""
    path = tmp_path / "r.urdf"
    tensor = INERTIAL.replace("/></inertial>", f" ixy='0.01'/>{origin}</inertial>")
    path.write_text(robot(link("a", "") + joint("j", "a", "b", LIMIT + dynamics) + link("b", tensor)))
    changes = {
        "j": {"damping": 0.7, "friction": 0.2, "armature": 0.3},
        "b": {"mass": 2.0, "ixx": 0.12, "ixz": 0.02, "y": -0.25, "z": 0.5},
    }
    plain = load_robot(path)
    wanted = varied_robot(plain, changes)
    path.write_bytes(edited_urdf(path.read_bytes(), plain, changes))
    found = load_robot(path)
    assert [(one.mass, one.inertia, one.centre_of_mass, one.inertial_rpy) for one in found.links] == [
        (one.mass, one.inertia, one.centre_of_mass, one.inertial_rpy) for one in wanted.links
    ]
    for name in ("damping", "friction", "armature"):
        assert [getattr(one, name) for one in found.joints] == [getattr(one, name) for one in wanted.joints]
