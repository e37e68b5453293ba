"""Worlds with contacts: bodies without contact move as in a world without contacts, and a fixed base collides with objects."""

import numpy as np
import pytest

import asrsim
from validation.models import INSTALLED

LINK = """<link name="{0}"><inertial><origin xyz="0.02 0.01 0.1"/><mass value="0.8"/>
<inertia ixx="4e-3" iyy="3e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
ARM = f"""<robot name="arm"><link name="base"/>{LINK.format("upper")}{LINK.format("tool")}
<joint name="one" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="two" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
<limit lower="LOW" upper="HIGH" effort="50" velocity="100"/></joint>{LINK.format("fore")}
<joint name="weld" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0.05 0 0.2" rpy="0.7 -0.4 1.1"/></joint>
</robot>"""


@pytest.mark.parametrize("engine", INSTALLED)
def test_things_fall_onto_a_fixed_base_and_slide_there(tmp_path, engine):
    """Base and objects have friction. The base penetrates the ground, which exerts no force on it."""
    table = '<link name="base"><collision><geometry><box size="2 2 1"/></geometry></collision></link>'
    (tmp_path / "arm.urdf").write_text(ARM.replace('<link name="base"/>', table).replace("LOW", "-1").replace("HIGH", "1"))
    objects = {
        "ball": {"shape": "sphere", "size": 0.1, "mass": 0.5, "position": [0.3, 0.2, 0.62]},
        "ice": {"shape": "box", "size": [0.2, 0.2, 0.1], "mass": 0.4, "position": [-0.8, 0.6, 0.55], "friction": 0.1},
    }
    scenario = asrsim.make_scenario(
        tmp_path / "arm.urdf",
        engine=engine,
        duration=0.5,
        compiled=False,
        world={"ground": {}, "objects": objects},
        gravity=[2.0, 0, -9.6],
    )
    run = asrsim.run(scenario)
    assert run.bodies["ball"][-1, 2] == pytest.approx(0.6, abs=2e-3)
    assert run.samples.contacts["ball/robot"][-1, 2] == pytest.approx(0.5 * 9.6, rel=0.02)
    assert run.bodies["ice"][-1, 0] + 0.8 == pytest.approx(0.5 * (2.0 - 0.1 * 9.6) * 0.5**2, rel=0.05)


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("height", [-0.7, 0.4])
def test_ground_has_the_height_in_the_scenario(tmp_path, engine, height):
    (tmp_path / "arm.urdf").write_text(ARM.replace("LOW", "-1").replace("HIGH", "1"))
    ball = {"shape": "sphere", "size": 0.1, "mass": 0.5, "position": [3, 0, height + 0.12]}
    scenario = asrsim.make_scenario(
        tmp_path / "arm.urdf",
        engine=engine,
        duration=0.5,
        compiled=False,
        world={"ground": {"height": height}, "objects": {"ball": ball}},
    )
    assert asrsim.run(scenario).bodies["ball"][-1, 2] == pytest.approx(height + 0.1, abs=2e-3)


@pytest.mark.parametrize("engine", INSTALLED)
def test_logged_contact_forces_are_mass_times_acceleration_in_every_step(tmp_path, engine):
    """A ball on a slide pushes a box over the ground and stops at its limit. The box slides on until it rests."""
    ball = "<collision><geometry><sphere radius='0.02'/></geometry></collision>"
    (tmp_path / "slide.urdf").write_text(f"""<robot name="slide"><link name="base"/><link name="ball"><inertial>
<mass value="1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>{ball}</link>
<joint name="push" type="prismatic"><parent link="base"/><child link="ball"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="0.05" effort="1000" velocity="100"/></joint></robot>""")
    mass, gravity = 2.0, np.array([0.0, 0.0, -9.81])
    box = {"shape": "box", "size": [0.2, 0.2, 0.2], "mass": mass, "friction": 0.23, "position": [0.1201, 0.0, 0.1]}
    scenario = asrsim.make_scenario(
        tmp_path / "slide.urdf",
        engine=engine,
        duration=0.7,
        compiled=False,
        base={"position": [0, 0, 0.1]},
        gravity=gravity.tolist(),
        external_torques={"push": 7.2},
        world={"ground": {}, "objects": {"box": box}},
    )
    run = asrsim.run(scenario)
    place = run.bodies["box"][:, :3]
    acceleration = (place[2:] - 2.0 * place[1:-1] + place[:-2]) / 1e-3**2
    force = run.contacts["box/ground"][2:] + run.contacts["box/robot"][2:]
    np.testing.assert_allclose(force, mass * (acceleration - gravity), rtol=0.0, atol=0.01)
    assert 0.05 < place[-1, 0] - place[0, 0] < 0.1
    assert np.abs(acceleration[-20:]).max() < 0.01


@pytest.mark.parametrize("engine", INSTALLED)
def test_weightless_links_do_not_fall_in_a_world_with_contacts(tmp_path, engine):
    """Links without gravity stay at rest while a ball falls; with gravity on one link only, its weight alone moves the arm."""
    (tmp_path / "arm.urdf").write_text(ARM.replace("LOW", "-1").replace("HIGH", "1"))
    ball = {"shape": "sphere", "size": 0.1, "mass": 0.5, "position": [3, 0, 5.0]}
    ends = []
    for off in (["upper", "fore", "tool"], ["upper", "tool"]):
        for world in ({"ground": {"height": -2}, "objects": {"ball": ball}}, {}):
            scenario = asrsim.make_scenario(
                tmp_path / "arm.urdf",
                engine=engine,
                duration=0.3,
                compiled=False,
                world=world,
                weightless=off,
                initial={"one": 0.8},
            )
            run = asrsim.run(scenario)
            ends.append(run.samples.values["link_position"][-1])
            if world:
                assert run.bodies["ball"][-1, 2] == pytest.approx(5.0 - 0.5 * 9.81 * 0.3**2, abs=0.01)
    np.testing.assert_allclose(ends[:2], [[0.8, 0.0]] * 2, rtol=0.0, atol=1e-10)
    assert ends[2][0] > 0.85
    np.testing.assert_allclose(ends[2], ends[3], rtol=0.0, atol=1e-4)
