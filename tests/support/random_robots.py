"""Random robots: trees with rotated, offset and massless links, fixed joints and every kind of moving joint."""

import numpy as np


def random_urdf(seed, *, moving=5, fixed=6, massless_root=False, mass=(0.1, 3.0), size=0.1):
    """URDF of a random tree. moving, fixed: numbers of joints. mass: range of the masses of links, kg; size: deviation (m) of
    their points from their centre of mass. Some angles are quarter turns, rounded as 1.5708."""
    source = np.random.default_rng(seed)
    kinds = ["moving"] * moving + ["fixed"] * fixed
    source.shuffle(kinds)
    links, joints = [_link("l0", source, mass, size, massless=massless_root)], []
    for index, kind in enumerate(kinds, start=1):
        parent = f"l{source.integers(max(0, index - 4), index)}"
        # A moving joint must carry mass.
        links.append(_link(f"l{index}", source, mass, size, massless=kind == "fixed" and source.random() < 0.3))
        if kind == "moving":
            kind = str(source.choice(["revolute", "continuous", "prismatic"]))
        limit = "" if kind == "fixed" else '<limit lower="-3" upper="3" effort="100" velocity="100"/>'
        axis = "" if kind == "fixed" else f'<axis xyz="{_text(_unit(source))}"/>'
        joints.append(
            f'<joint name="j{index}" type="{kind}"><parent link="{parent}"/><child link="l{index}"/>'
            f'<origin xyz="{_text(source.normal(size=3) * 0.2)}" rpy="{_text(_angles(source))}"/>{axis}{limit}</joint>'
        )
    return f'<robot name="r{seed}">{"".join(links)}{"".join(joints)}</robot>'


def _link(name, source, mass, size, *, massless):
    if massless:
        return f'<link name="{name}"/>'
    # The inertia of a set of point masses is physically valid.
    points = source.normal(size=(6, 3)) * size
    tensor = sum((p @ p * np.eye(3) - np.outer(p, p) for p in points), np.zeros((3, 3)))
    entries = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), tensor[np.triu_indices(3)], strict=True)
    values = " ".join(f'{key}="{float(value)!r}"' for key, value in entries)
    place = f'xyz="{_text(source.normal(size=3) * 0.1)}" rpy="{_text(_angles(source))}"'
    weight = f'<mass value="{float(source.uniform(*mass))!r}"/>'
    return f'<link name="{name}"><inertial><origin {place}/>{weight}<inertia {values}/></inertial></link>'


def _angles(source):
    turned = source.choice([0.0, 1.5708, -1.5708, np.pi / 2, 3.14159], size=3)
    return turned if source.random() < 0.6 else source.uniform(-np.pi, np.pi, 3)


def _unit(source):
    axis = source.normal(size=3)
    return axis / np.linalg.norm(axis)


def _text(values):
    return " ".join(repr(float(value)) for value in values)
