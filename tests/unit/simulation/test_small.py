"""Small facts about the simulation core, compared with known numbers."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import asrsim
from asrsim.actuators.parameters import FRICTION_STIFFNESS
from asrsim.errors import RobotError
from asrsim.signals import PulseTrain
from asrsim.simulation.prepare import prepare
from asrsim.simulation.run import COARSE, TARGET, _stiffer_than_foreseen
from asrsim.simulation.simulation import Simulation
from support.hanging_chain import INERTIA, MASS, NEVER, REACH, joint, links, plan, samples, truth
from support.paths import ROOT
from validation.models import INSTALLED, Body, chain, column, run

LIMITS = '<limit lower="{0}" upper="{1}" effort="{2}" velocity="100"/>'
BODY = Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)
TOTAL = INERTIA + MASS * REACH**2


# -- energies and their guard ------------------------------------------------------------------------------------------


def test_a_joint_s_own_spring_gives_the_links_their_energy(tmp_path: Path) -> None:
    """If the energy balance did not include the spring, the run would stop."""
    text = links("0 1 0").replace("</robot>", '<gazebo reference="j1"><springStiffness>30</springStiffness></gazebo></robot>')
    given = plan(text, (joint("j1", start=0.6),), 0.2)
    scenario = asrsim.make_scenario(given.write(tmp_path), **(given.keys() | {"gravity": [0, 0, 0]}))
    with Simulation(scenario, record=True, compiled=False) as simulation:
        fastest = 0.0
        for _ in range(20):
            simulation.advance(10)
            simulation.flush()
            fastest = max(fastest, abs(float(simulation.observe().link_velocity[0])))
        assert fastest > 1.0


@pytest.mark.parametrize("engine", INSTALLED[:1])
def test_a_motor_at_its_stop_closes_its_energy_balance(engine: str) -> None:
    """In the step in which it comes and in that in which it leaves, the stop takes what is left."""
    result = run(
        chain(BODY), mode=4, duration=1.0, engine=engine, substeps=1, motor_substeps=1,
        references={"motor_1_torque": PulseTrain(high=2.0, low=-2.0, width=0.05, period=0.1)},
        parameters={"spring_stiffness": 20.0, "motor_1_max_position": 0.1, "motor_1_min_position": -0.1},
    )  # fmt: skip
    place = column(result, "motor_1_position")
    # Logged in the middle of a motor's step, half a drift beyond where the stop holds it.
    assert place.max() == pytest.approx(0.1, abs=2e-3)
    work = np.abs(column(result, "motor_work")).max()
    assert np.abs(column(result, "energy_residual")).max() < 2e-3 * work


# -- kicks that inputs cut ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("at", [0.0002, 0.0004, 0.0006, 0.05, 0.0503])
@pytest.mark.parametrize("mode", [0, 1, 3])
def test_a_jump_on_a_damped_joint_wherever_it_falls(tmp_path: Path, engine: str, at: float, mode: int) -> None:
    """In the first half step, in the second, on the grid and off it."""
    size = 1.0 if mode == 0 else 0.4
    jump = replace(NEVER, at=at, jump=size)
    parameters: dict[str, float] = {}
    if mode == 1:
        parameters = {"controller_1_proportional": 6.0, "controller_1_integral": 200.0, "controller_1_derivative": 0.3}
    if mode == 3:
        parameters = {"spring_stiffness": 5.0, "max_deflection": 1.5}
    first = joint("j1", damping=0.4, actuator="sea", mode=mode, parameters=parameters, references=(jump,))
    given = plan(links("0 1 0", "0 1 0", damping=0.4), (first, joint("j2", damping=0.4)), 0.1, (at,))
    found, exact = [], None
    for substeps in (2, 8):
        result = samples(given, tmp_path, engine=engine, substeps=substeps)
        exact = truth(given, result.time) if exact is None else exact
        found.append(float(np.abs(result.values["link_position"] - exact).max()))
    assert found[0] < 2e-4
    assert found[1] < found[0] / 8.0


# -- substeps ----------------------------------------------------------------------------------------------------------


def test_expected_stiffness_allows_for_twice_the_static_load() -> None:
    """sinh springs: what is foreseen is the stiffness at the torque of twice the weight."""
    robot = chain(replace(BODY, actuator="qbmove"))
    references = {"equilibrium_position": 0.0, "stiffness_preset": 0.0}
    resolved = run(robot, mode=3, duration=0.01, references=references, initial=[0.0]).resolution
    weight = MASS * 9.81 * REACH
    # Two springs without pretension carry the load together: each half of it at most, and alone all of it.
    (stiffness,) = resolved.stiffness

    def at(torque: float) -> float:
        return float(8.9992 * 0.0019 * np.cosh(np.arcsinh(torque / 0.0019)))

    assert at(2.0 * 0.9 * weight) < stiffness < 2.0 * at(2.0 * 1.1 * weight)
    assert stiffness > 1.5 * 2.0 * at(weight) * 0.9


def test_bristles_count_for_the_motors_substeps() -> None:
    """1000 N m/rad on 0.0233 kg m^2: 207 rad/s and more."""
    found = {}
    for friction in (0.0, 0.1):
        parameters = {"motor_1_friction_torque": friction, "motor_1_inertia": 1e-3, "spring_stiffness": 1.0}
        found[friction] = run(chain(BODY), mode=4, duration=0.01, parameters=parameters).resolution
    assert found[0.1].motor_frequency ** 2 - found[0.0].motor_frequency ** 2 == pytest.approx(FRICTION_STIFFNESS / 1e-3)
    assert found[0.1].motor_substeps > found[0.0].motor_substeps == 1


@pytest.mark.parametrize(("actuator", "mode"), [("qbmove", 3), ("qbmove", 6), ("bavs", 5), ("awas_ii", 6), ("sea", 4)])
def test_substeps_do_not_depend_on_the_position_of_a_joint(actuator: str, mode: int) -> None:
    """Start and references moved together: what can be reached is the same. A start off its reference reaches more."""
    name = {3: "equilibrium_position", 6: "equilibrium_position", 5: "reference_1", 4: "motor_1_torque"}[mode]
    found = []
    for start, reference in ((0.0, 0.2), (0.4, 0.6), (-0.7, -0.5), (0.4, 0.4)):
        robot = chain(replace(BODY, actuator=actuator))
        told = {name: reference if mode != 4 else 0.1} | ({"reference_2": reference} if mode == 5 else {})
        resolved = run(
            robot, mode=mode, duration=0.001, gravity=0.0, references=told, initial=[start], compiled=False
        ).resolution
        found.append(resolved.stiffness[0])
    assert found[1:3] == pytest.approx([found[0]] * 2, rel=1e-6)
    assert found[3] <= found[0] * (1 + 1e-9)


SHAPES = {
    "ball": ('<sphere radius="0.1"/>', "0 0 0", 0.1),
    "ball below": ('<sphere radius="0.1"/>', "0.02 0 -0.05", 0.15),
    "box": ('<box size="0.4 0.3 0.2"/>', "0 0 0.03", 0.07),
    "can": ('<cylinder radius="0.2" length="0.1"/>', "0 0 0", 0.05),
}


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("name", SHAPES)
def test_a_floating_base_rests_on_its_shape(tmp_path: Path, engine: str, name: str) -> None:
    """Its centre of mass is off the link's frame, in which the shape is placed: a millimetre of softness, 3 cm of a mistake."""
    geometry, place, height = SHAPES[name]
    robot = tmp_path / "robot.urdf"
    robot.write_text(
        f"""<robot name="r"><link name="b"><inertial><origin xyz="0 0 0.03"/><mass value="1"/>
        <inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="{place}"/>
        <geometry>{geometry}</geometry></collision></link><joint name="j" type="continuous"><parent link="b"/><child link="l"/>
        <axis xyz="0 0 1"/></joint><link name="l"><inertial><mass value="1e-3"/>
        <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
    )
    scenario = asrsim.make_scenario(
        robot,
        engine=engine,
        duration=0.05,
        base={"fixed": False, "position": [0, 0, height]},
        world={"ground": {}},
        compiled=False,
    )
    assert asrsim.run(scenario).bodies["b"][-1, 2] == pytest.approx(height, abs=2e-3)


RESTING: dict[str, tuple[dict[str, Any], float]] = {
    "box": ({"shape": "box", "size": [0.1, 0.2, 0.3]}, 0.15),
    "ball": ({"shape": "sphere", "size": 0.1}, 0.1),
    "can": ({"shape": "cylinder", "size": [0.05, 0.2]}, 0.1),
    "can on its side": ({"shape": "cylinder", "size": [0.05, 0.2], "rpy": [math.pi / 2, 0, 0]}, 0.05),
    "stone": ({"shape": "mesh", "mesh": "stone.stl", "size": [0.1, 0.2, 0.3]}, 0.15),
    "heavy stone": ({"shape": "mesh", "mesh": "stone.stl", "inertia": [0.1, 0.1, 0.1]}, 0.5),
}
"""Objects of the world, and the height (m) of their middle on the ground."""


def cube(edges: Any = ((1, 0, 0), (0, 1, 0), (0, 0, 1))) -> bytes:
    """A mesh in STL, 1 m wide; edges: columns of them make it another parallelepiped."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) @ np.array(edges).T
    corners = corners.astype("<f4")
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = [corners[list(three)] for a, b, c, d in sides for three in ((a, b, c), (a, c, d))]
    rows = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in triangles)
    return bytes(80) + len(triangles).to_bytes(4, "little") + rows


@pytest.mark.parametrize("engine", INSTALLED)
def test_objects_of_every_shape_rest_on_the_ground(tmp_path: Path, engine: str) -> None:
    (tmp_path / "stone.stl").write_bytes(cube())
    objects = {
        name.replace(" ", "_"): {"mass": 1, "position": [5, 2 * place, height], **shape}
        for place, (name, (shape, height)) in enumerate(RESTING.items())
    }
    robot = ROOT / "examples" / "urdf" / "dof1_sea.urdf"
    scenario = asrsim.make_scenario(
        robot, engine=engine, duration=0.05, world={"ground": {}, "objects": objects}, compiled=False,
        base_dir=tmp_path,
    )  # fmt: skip
    bodies = asrsim.run(scenario).bodies
    for name, (_, height) in RESTING.items():
        assert bodies[name.replace(" ", "_")][-1, 2] == pytest.approx(height, abs=5e-3), name


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(("amplitude", "near"), [(0.1, 1e-7), (0.4, 3e-4), (0.9, 5e-3)])
def test_a_ground_that_nothing_touches_changes_no_friction_nor_stop(
    tmp_path: Path, engine: str, amplitude: float, near: float
) -> None:
    """Under 0.1 N m both joints stick, under 0.4 they slide and come to their stops, under 0.9 they strike them. The engines'
    own solvers change the sign of friction once a step.
    """
    robot = tmp_path / "arm.urdf"
    chained = links("0 1 0", "1 0 0").replace('friction="0"', 'friction="0.15"')
    robot.write_text(chained.replace('lower="-60" upper="60"', 'lower="-0.6" upper="0.6"').replace('"1000"', '"50"'))
    push = {"sinusoid": {"amplitude": amplitude, "frequency": 2.0}}
    found = []
    for world in ({}, {"ground": {}}):
        scenario = asrsim.make_scenario(
            robot, engine=engine, duration=0.6, gravity=[0, 0, 0], external_torques={"*": push}, world=world,
            base={"position": [0, 0, 5]}, compiled=False,
        )  # fmt: skip
        found.append(asrsim.run(scenario).samples.values["link_position"])
    np.testing.assert_allclose(found[1], found[0], rtol=0.0, atol=near)
    assert np.abs(found[0]).max() < 1e-9 if amplitude < 0.15 else np.abs(found[0]).max() > 0.3


def test_objects_have_the_inertia_of_their_shape(tmp_path: Path) -> None:
    """Under a torque each turns about its axes as its moments say; a mesh as its bounding box, in MuJoCo as in PyBullet."""
    pytest.importorskip("mujoco")
    x, y, z = 0.1, 0.2, 0.4
    box = np.array([y * y + z * z, x * x + z * z, x * x + y * y]) / 12.0
    shapes: dict[str, tuple[dict[str, Any], Any]] = {
        "box": ({"shape": "box", "size": [x, y, z]}, box),
        "mesh": ({"shape": "mesh", "mesh": "stone.stl", "size": [x, y, z]}, box),
        "ball": ({"shape": "sphere", "size": x}, np.full(3, 0.4 * x * x)),
        "can": ({"shape": "cylinder", "size": [x, z]}, [(3 * x * x + z * z) / 12] * 2 + [x * x / 2]),
        "given": ({"shape": "box", "size": [x, y, z], "inertia": [0.3, 0.2, 0.4]}, [0.15, 0.1, 0.2]),
        "slab": ({"shape": "mesh", "mesh": "slab.stl"}, np.array([1.0 + 0.25, 6.25 + 0.25, 6.25 + 1.0]) / 12.0),
    }
    (tmp_path / "stone.stl").write_bytes(cube())
    # 2.5 m long, 1 m wide, 0.5 m high, along no axis of its own inertia.
    (tmp_path / "slab.stl").write_bytes(cube([[0.5, 0.5, 1.5], [0.0, 0.7, 0.3], [0.2, 0.3, 0.0]]))
    objects = {name: {"mass": 2, "position": [5, i, 1], **shape} for i, (name, (shape, _)) in enumerate(shapes.items())}
    robot = ROOT / "examples" / "urdf" / "dof1_sea.urdf"
    scenario = asrsim.make_scenario(robot, engine="mujoco", duration=0.1, world={"objects": objects}, base_dir=tmp_path)
    with Simulation(scenario) as simulation:
        model = simulation.engine.raw_model
        for name, (_, moments) in shapes.items():
            body = model.body(f"object/{name}")
            # MuJoCo may have turned the axes of a cube's inertia.
            turn = Rotation.from_quat(np.roll(body.iquat, -1)).as_matrix()
            tensor = turn @ np.diag(body.inertia) @ turn.T
            assert tensor == pytest.approx(np.diag(2.0 * np.asarray(moments)), rel=1e-6, abs=1e-7), name
            assert body.mass == pytest.approx(2.0)


# -- what is recorded --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stepping", ["leapfrog", "euler"])
def test_the_first_velocity_is_the_one_given(tmp_path: Path, stepping: str) -> None:
    given = plan(links("0 1 0"), (replace(joint("j1", start=0.5), speed=1.25),), 0.02)
    found = samples(given, tmp_path, stepping=stepping)
    speed = found.values["link_velocity"][:, 0]
    assert speed[0] == 1.25
    # One step of gravity later; centred differences are of second order.
    exact = -MASS * 9.81 * REACH * np.sin(0.5) / TOTAL
    assert (speed[1] - speed[0]) / 1e-3 == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("place", [0.3, -0.2])
def test_a_link_that_stands_exactly_on_a_stop_is_counted(place: float) -> None:
    body = replace(BODY, actuator=None, limits=LIMITS.format(-0.2, 0.3, 100))
    result = run(chain(body), duration=0.01, gravity=0.0, initial=[place])
    assert result.counts.stop[0] == 11
    assert run(chain(body), duration=0.01, gravity=0.0, initial=[0.1]).counts.stop[0] == 0


def test_a_torque_at_its_limit_is_not_beyond_it() -> None:
    body = replace(BODY, limits=LIMITS.format(-30, 30, 0.5))
    for torque, beyond in ((0.5, 0), (0.5000001, 11), (-0.6, 11)):
        result = run(chain(body), mode=0, duration=0.01, gravity=0.0, references={"link_torque": torque})
        assert result.counts.effort[0] == beyond


# -- sensors and commands ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("delay", "substeps"), [(0.0026, 3), (0.0024, 2), (0.0004, 0)])
def test_a_delay_is_the_nearest_number_of_substeps(tmp_path: Path, delay: float, substeps: int) -> None:
    gains = {"controller_1_proportional": 5.0, "controller_1_integral": 0.0, "controller_1_derivative": 0.0}
    first = joint("j1", actuator="sea", mode=1, parameters=gains, references=(NEVER,))
    given = plan(links("0 1 0"), (replace(first, start=0.3, speed=1.0),), 0.05)
    found = samples(given, tmp_path, effects={"sensors": {"*": {"delay": delay}}}, substeps=1)
    q, torque = found.values["link_position"][:, 0], found.values["link_torque"][:, 0]
    np.testing.assert_allclose(torque[10:], -5.0 * q[10 - substeps : len(q) - substeps], atol=1e-12)


@pytest.mark.parametrize("start", [0.34, -0.36])
def test_quantised_readings_are_the_nearest(tmp_path: Path, start: float) -> None:
    gains = {"controller_1_proportional": 5.0, "controller_1_integral": 0.0, "controller_1_derivative": 0.0}
    first = joint("j1", start=start, actuator="sea", mode=1, parameters=gains, references=(NEVER,))
    given = plan(links("0 1 0"), (first,), 0.01)
    found = samples(given, tmp_path, effects={"sensors": {"*": {"quantum": 0.1}}})
    nearest = 0.1 * round(start / 0.1)
    assert found.values["link_torque"][0, 0] == pytest.approx(-5.0 * nearest)


# -- references from outside -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_reference_that_is_set_acts_from_the_next_step(tmp_path: Path, engine: str) -> None:
    given = plan(links("0 1 0"), (joint("j1", actuator="sea", mode=0, references=(NEVER,)),), 0.1)
    scenario = asrsim.make_scenario(given.write(tmp_path), engine=engine, **(given.keys() | {"gravity": [0, 0, 0]}))
    prepared = prepare(scenario, ranges={"*": {"link_torque": (-0.5, 0.5)}})
    with Simulation(prepared, compiled=False) as simulation:
        simulation.advance(10)
        assert simulation.observe().link_velocity[0] == 0.0
        assert simulation.set_reference("j1", "link_torque", 2.0) == 0.5
        simulation.advance(20)
        assert simulation.observe().link_position[0] == pytest.approx(0.5 * 0.5 / TOTAL * 0.02**2, rel=0.06)
        assert simulation.time == 0.03
        assert simulation.set_reference("j1", "link_torque", -9.0) == -0.5
        simulation.set_reference("j1", "link_torque", None)
        before = simulation.observe().link_velocity[0]
        simulation.advance(5)
        assert simulation.observe().link_velocity[0] == pytest.approx(before, rel=0.06)


# -- certificates ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seen", [90.0, 110.0, 450.0, 4e4])
def test_a_spring_too_stiff_for_the_step_is_warned_of(seen: float) -> None:
    """By the root of its stiffness; and how many substeps would have done."""
    resolution = SimpleNamespace(omega_h=0.25, substeps=3, stiffness=[100.0, 0.0])
    prepared = SimpleNamespace(
        resolution=resolution, stepping=SimpleNamespace(released=False),
        drives=[SimpleNamespace(name=name) for name in ("soft", "none")],
    )  # fmt: skip
    problems = _stiffer_than_foreseen(prepared, SimpleNamespace(stiffest=np.array([seen, 5.0])))
    reached = 0.25 * math.sqrt(seen / 100.0)
    assert [problem.key for problem in problems] == (["soft"] if seen > 100.0 and reached > COARSE else [])
    for problem in problems:
        (wanted,) = re.findall(r"Set substeps to (\d+) or more", problem.hint)
        assert reached * 3 / (int(wanted) - 1) > TARGET >= reached * 3 / int(wanted)
        assert f"{seen:.4g} N m/rad" in problem.message


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("between", [1, 2])
def test_joints_without_mass_between_them_are_named_and_no_others(tmp_path: Path, engine: str, between: int) -> None:
    """On one axis with nothing between them, below an arm that has its own mass."""
    body = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = ["base", "arm", *(f"thin_{i}" for i in range(between)), "hand"]
    text = "".join(f'<link name="{name}">{"" if "thin" in name else body}</link>' for name in links)
    for number, (parent, child) in enumerate(pairwise(links)):
        text += (
            f'<joint name="j{number}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{0.3 if number == 1 else 0} 0 0" rpy="{0.7 if number == 1 else 0} 0 0"/>'
            f'<axis xyz="{"0 1 0" if number == 0 else "0 0 1"}"/></joint>'
        )
    (tmp_path / "arm.urdf").write_text(f'<robot name="r">{text}</robot>')
    with pytest.raises(RobotError) as fault:
        prepare(asrsim.make_scenario(tmp_path / "arm.urdf", engine=engine, duration=0.1))
    named = set(re.findall(r"'(j\d)'", str(fault.value)))
    assert named == {f"j{number}" for number in range(1, 2 + between)}, str(fault.value)
