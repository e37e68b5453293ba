"""A parallelogram as URDF, whose coupler moves on a circle without turning: a linkage with constant inertia.

Cranks of length A turn about the axis y; the coupler joins their ends at a distance of B. Without gravity a torque T on the
crank gives the angle T t^2 / (2 INERTIA).
"""

A, B = 0.2, 0.3
ARM, BAR = 0.5, 0.8
"""Masses of each crank and of the coupler, kg."""
TURN = 0.004
"""Moment of inertia of each link about its centre, kg m^2."""
CRANK = TURN + ARM * (A / 2) ** 2
"""Moment of inertia of a crank about its pivot, kg m^2."""
INERTIA = 2 * CRANK + BAR * A**2
BALL = (
    f'<loop_joint name="close" type="spherical"><link1 link="bar" xyz="{B} 0 0"/><link2 link="C" xyz="{A} 0 0"/></loop_joint>'
)
HINGE = (
    f'<loop_joint name="close" type="revolute"><link1 link="bar" xyz="{B} 0 0"/><link2 link="C" xyz="{A} 0 0"/>'
    '<axis xyz="0 1 0"/></loop_joint>'
)
SDF = (
    f'<gazebo><joint name="close" type="revolute"><parent>bar</parent><child>C</child><pose>{A} 0 0 0 0 0</pose>'
    "<axis><xyz>0 1 0</xyz></axis></joint></gazebo>"
)
"""Three ways in which a file closes the loop. The SDF joint holds at the zero posture, where all links lie on the axis x."""
START = {"crank": 1.2, "elbow": -1.2, "rocker": 1.2}


def link(name, mass, length):
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{TURN}" iyy="{TURN}" izz="{TURN}"/></inertial></link>'
    )


def joint(name, parent, child, x, words="", limit='lower="-9" upper="9" effort="100" velocity="99"'):
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{x} 0 0"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 1 0"/><limit {limit}/>{words}</joint>'
    )


def urdf(words="", *, limit='lower="-9" upper="9" effort="100" velocity="99"'):
    """words: elements that close the loop, and others; limit: of the rocker."""
    return (
        f'<robot name="parallelogram"><link name="base"/>{joint("crank", "base", "A", 0)}{link("A", ARM, A)}'
        f"{joint('elbow', 'A', 'bar', A)}{link('bar', BAR, B)}{joint('rocker', 'base', 'C', B, limit=limit)}"
        f"{link('C', ARM, A)}{words}</robot>"
    )
