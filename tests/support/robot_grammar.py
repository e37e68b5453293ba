"""Random robot files of the kinds that the field writes: a grammar of links, joints, limits and the words of other programs."""

import numpy as np

KINDS = ("revolute", "revolute", "continuous", "prismatic", "fixed")
LIMITS = (
    'lower="-1.5" upper="1.5" effort="80" velocity="5"',
    'lower="0" upper="0" effort="0" velocity="0"',
    'lower="0.2" upper="1.1" effort="-1" velocity="-1"',
    'lower="-inf" upper="0.4" effort="50" velocity="10"',
    'lower="-2" upper="inf" effort="1e3" velocity="10"',
    'effort="30" velocity="3"',
    'upper="0.8" effort="300" velocity="3"',
    'lower="0.001" upper="0.0011" effort="10" velocity="1"',
)
DYNAMICS = (
    "",
    '<dynamics damping="0.1"/>',
    '<dynamics damping="0" friction="0.05"/>',
    '<dynamics damping="2" friction="0"/>',
    '<dynamics damping="1e-4" armature="1e-3"/>',
    '<dynamics damping="0.05" spring_stiffness="3" spring_reference="0.1"/>',
)
MORE = (
    '<safety_controller soft_lower_limit="-0.1" soft_upper_limit="0.1" k_velocity="10"/>',
    '<calibration rising="0.1"/>',
    "",
    "",
)
SHAPES = (
    '<sphere radius="0"/>',
    '<box size="0.1 0.05 0.02"/>',
    '<cylinder radius="0.02" length="0.1"/>',
    "",
    '<mesh filename="package://away/a.stl"/>',
    '<mesh filename=""/>',
    '<sphere radius="0.03"/>',
)
GAZEBO_OF_JOINTS = (
    "<springStiffness>5</springStiffness>",
    '<springStiffness value="2"/><springReference value="0.1"/>',
    "<implicitSpringDamper>1</implicitSpringDamper>",
    "<stopKp>1e6</stopKp>",
    "<stribeckFriction>0.01</stribeckFriction>",
)
GAZEBO_OF_LINKS = (
    "<mu1>0.2</mu1>",
    "<turnGravityOff>true</turnGravityOff>",
    "<selfCollide>true</selfCollide>",
    "<gravity>true</gravity>",
)
EMPTY = (
    '<link name="{name}"><inertial><mass value="0"/><inertia ixx="0" iyy="0" izz="0"/></inertial><visual><geometry>'
    '<mesh filename="package://away/b.stl" scale="0.001 0.001 -0.001"/></geometry></visual></link>'
)
"""A link without mass, in the middle of an arm or at its end."""
START = (
    '<ros2_control name="c_{name}" type="system"><joint name="{name}"><state_interface name="position">'
    '<param name="initial_value">{value}</param></state_interface></joint></ros2_control>'
)
PROLOGS = ('<?xml version="1.0"?>', '\n<?xml version="1.0"?>', '<!-- a -- b -->\n<?xml version="1.0" encoding="utf-8"?>', "")


def random_file(seed, *, joints=6):
    """Text of a random robot file. joints: largest number of joints."""
    source, more = np.random.default_rng([seed, 49]), np.random.default_rng([seed, 50])
    count = int(source.integers(1, joints + 1))
    floor, links, parts, extra = str(source.choice(["base", "world"])), [], [], []
    if floor == "base" or source.random() < 0.5:
        links.append(_link(floor, source, heavy=False))
    names, moving = [floor], []
    # Fingers at the end of arms are lighter by orders of magnitude.
    mass = 10.0 ** source.uniform(-0.5, 1.0)
    for i in range(1, count + 1):
        kind = str(source.choice(KINDS)) if i > 1 else "revolute"
        parent, name = names[-1] if source.random() < 0.8 else str(source.choice(names)), f"l{i}"
        mass *= 10.0 ** source.uniform(-1.2, 0.0)
        heavy = kind != "fixed" or source.random() < 0.5
        links.append(_link(name, source, heavy=heavy, mass=mass) if more.random() > 0.12 else EMPTY.format(name=name))
        parts.append(_joint(f"j{i}", kind, parent, name, moving, source, stretch=more.choice([1.0, 1.0, 1.0, 0.5, 2.0, 1.001])))
        if kind != "fixed" and more.random() < 0.15:
            extra.append(START.format(name=f"j{i}", value=more.choice([0.0, 0.25, "0.1"])))
        if kind != "fixed":
            moving.append(f"j{i}")
        if source.random() < 0.3:
            word = source.choice(GAZEBO_OF_JOINTS if kind != "fixed" else GAZEBO_OF_LINKS[:1])
            extra.append(f'<gazebo reference="{f"j{i}" if kind != "fixed" else name}">{word}</gazebo>')
        if source.random() < 0.3:
            extra.append(f'<gazebo reference="{name}">{source.choice(GAZEBO_OF_LINKS)}</gazebo>')
        if kind in ("revolute", "continuous") and source.random() < 0.2:
            extra.append(
                f'<transmission name="t{i}"><type>transmission_interface/SimpleTransmission</type><joint name="j{i}"/>'
                '<actuator name="m"><mechanicalReduction>20</mechanicalReduction><motorInertia>1e-6</motorInertia></actuator>'
                "</transmission>"
            )
        names.append(name)
    if more.random() < 0.15:
        links.append('<link name="odom"/>')
        parts.append(f'<joint name="float" type="floating"><parent link="odom"/><child link="{floor}"/></joint>')
        if not any(f'<link name="{floor}"' in link for link in links):
            links.append(f'<link name="{floor}"/>')
    space = ' xmlns="http://example.org/urdf"' if source.random() < 0.2 else ""
    return f'{source.choice(PROLOGS)}<robot name="r{seed}"{space}>{"".join(links)}{"".join(parts)}{"".join(extra)}</robot>'


def _joint(name, kind, parent, child, moving, source, *, stretch):
    limit = f"<limit {source.choice(LIMITS)}/>" if kind in ("revolute", "prismatic") and source.random() < 0.95 else ""
    if kind == "continuous" and source.random() < 0.5:
        limit = '<limit effort="20" velocity="4"/>'
    axis = "" if kind == "fixed" else f'<axis xyz="{_text(_axis(source) * stretch)}"/>'
    mimic = ""
    if kind != "fixed" and moving and source.random() < 0.15:
        mimic = f'<mimic joint="{source.choice(moving)}" multiplier="{source.choice([1.0, -0.8, 0.5])}" offset="0"/>'
    words = "" if kind == "fixed" else f"{limit}{source.choice(DYNAMICS)}{source.choice(MORE)}{mimic}"
    place = f'xyz="{_text(source.normal(size=3) * 0.15)}" rpy="{_text(source.choice([0.0, 1.5708, -1.5708], size=3))}"'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<origin {place}/>{axis}{words}</joint>'


def _link(name, source, *, heavy, mass=1.0):
    shape = source.choice(SHAPES)
    bodies = f"<collision><geometry>{shape}</geometry></collision>" if source.random() < 0.4 else ""
    if not heavy:
        return f'<link name="{name}">{bodies}</link>'
    # The inertia of a box: its edges are a tenth to a third of a metre at 1 kg, and shrink with the mass.
    edges = source.uniform(0.1, 0.3, 3) * mass ** (1.0 / 3.0)
    moments = mass / 12.0 * (np.sum(edges**2) - edges**2)
    keys = " ".join(f'{key}="{value:.6g}"' for key, value in zip(("ixx", "iyy", "izz"), moments, strict=True))
    centre = f'<origin xyz="{_text(source.normal(size=3) * 0.3 * edges)}"/>'
    return f'<link name="{name}"><inertial>{centre}<mass value="{mass:.6g}"/><inertia {keys}/></inertial>{bodies}</link>'


def _axis(source):
    if source.random() < 0.6:
        return np.eye(3)[source.integers(3)] * source.choice([1.0, -1.0])
    axis = source.normal(size=3)
    return axis / np.linalg.norm(axis)


def _text(values):
    return " ".join(f"{float(value):.6g}" for value in values)
