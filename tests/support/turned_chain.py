"""A chain whose joints have turned frames and oblique axes, with a fixed joint between two that move."""

BODY = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
SHAPE = '<visual><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.1 0.05"/></geometry></visual>'
KINDS = ("revolute", "fixed", "prismatic", "continuous")


def part(number, kind):
    """A link and the joint that carries it."""
    return (
        f'<link name="l{number + 1}">{BODY}{SHAPE}</link>'
        f'<joint name="j{number}" type="{kind}"><parent link="l{number}"/><child link="l{number + 1}"/>'
        '<origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/><axis xyz="0 0.6 0.8"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
    )


TURNED = f'<robot name="turned"><link name="l0"/>{"".join(part(n, kind) for n, kind in enumerate(KINDS))}</robot>'
