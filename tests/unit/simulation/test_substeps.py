"""Number of substeps: it follows from the springs within reach, and a spring that becomes stiffer gives a warning."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import asrsim
from asrsim.actuators.parameters import FRICTION_STIFFNESS
from asrsim.errors import RobotError, UnresolvedSpringError
from asrsim.simulation.prepare import prepare
from support.hanging_chain import INERTIA, MASS, REACH
from validation.models import INSTALLED, Body, chain, run

BODY = Body(actuator="sea", mass=MASS, reach=REACH, inertia=INERTIA)
UNLOADED = {"equilibrium_position": 0.0, "stiffness_preset": 0.0}


def test_expected_stiffness_allows_for_twice_the_static_load():
    """Two sinh springs without pretension carry the load together: each at least half of it, and at most all of it."""
    found = run(chain(replace(BODY, actuator="qbmove")), mode=3, duration=0.01, references=UNLOADED).resolution
    weight = MASS * 9.81 * REACH
    (stiffness,) = found.stiffness

    def at(torque):
        return float(8.9992 * 0.0019 * np.cosh(np.arcsinh(torque / 0.0019)))

    assert at(2.0 * 0.9 * weight) < stiffness < 2.0 * at(2.0 * 1.1 * weight)
    assert stiffness > 1.5 * 2.0 * at(weight) * 0.9


@pytest.mark.parametrize("kind", ["friction_torque", "stribeck_friction", "load_friction"])
def test_bristles_of_motor_friction_need_motor_substeps(kind):
    """1000 N m/rad on 1e-3 kg m^2: 1000 rad/s."""
    found = {}
    for friction in (0.0, 0.1):
        parameters = {"motor_1_friction_torque": 0.0, "motor_1_inertia": 1e-3, "spring_stiffness": 1.0}
        parameters |= {f"motor_1_{kind}": friction}
        found[friction] = run(chain(BODY), mode=4, duration=0.01, parameters=parameters).resolution
    assert found[0.1].motor_frequency ** 2 - found[0.0].motor_frequency ** 2 == pytest.approx(FRICTION_STIFFNESS / 1e-3)
    assert found[0.1].motor_substeps > found[0.0].motor_substeps == 1


def test_derivative_action_counts_as_damping_of_the_link():
    strong = {"controller_1_derivative": 300.0}
    controlled = run(chain(BODY), mode=1, duration=0.001, parameters=strong, compiled=False).resolution
    damped = run(chain(replace(BODY, damping=300.0)), mode=0, duration=0.001, compiled=False).resolution
    assert controlled.link_implicitness == pytest.approx(damped.link_implicitness)
    assert damped.link_implicitness > 0.6


@pytest.mark.parametrize(("asked", "taken"), [(1, 1), (2, 3), (3, 3), (4, 5)])
def test_the_number_of_motor_substeps_is_odd(asked, taken):
    """The middle one belongs to the time of the substep."""
    assert run(chain(BODY), mode=6, duration=0.001, motor_substeps=asked).resolution.motor_substeps == taken


@pytest.mark.parametrize(("actuator", "mode"), [("qbmove", 3), ("qbmove", 6), ("bavs", 5), ("awas_ii", 6), ("sea", 4)])
def test_substeps_do_not_depend_on_the_position_of_a_joint(actuator, mode):
    """Start and references move together, so the same deflections are within reach. A start off its reference reaches more."""
    robot, found = chain(replace(BODY, actuator=actuator)), []
    for start, goal in ((0.0, 0.2), (0.4, 0.6), (-0.7, -0.5), (0.4, 0.4)):
        references = {4: {"motor_1_torque": 0.1}, 5: {"reference_1": goal, "reference_2": goal}}
        resolved = run(
            robot,
            mode=mode,
            duration=0.001,
            gravity=0.0,
            initial=[start],
            compiled=False,
            references=references.get(mode, {"equilibrium_position": goal}),
        ).resolution
        found.append(resolved.stiffness[0])
    assert found[1:3] == pytest.approx([found[0]] * 2, rel=1e-6)
    assert found[3] <= found[0] * (1 + 1e-9)


def test_springs_stiffer_than_expected_give_a_warning_with_enough_substeps():
    """A fast start bends a sinh spring far beyond its load: omega h grows with the root of the stiffness."""
    robot = chain(replace(BODY, actuator="qbmove"))
    keys = {"mode": 3, "duration": 0.3, "step": 0.012, "references": UNLOADED, "gravity": 0.0, "compiled": False}
    for speed, substeps in ((5.0, None), (10.0, None), (10.0, 4)):
        result = run(robot, initial_velocities={"joint_1": speed}, substeps=substeps, **keys)
        reached = result.resolution.omega_h * np.sqrt(result.counts.stiffest[0] / result.resolution.stiffness[0])
        found = [warning for warning in result.warnings if warning.code == "spring-stiffer-than-foreseen"]
        assert [warning.key for warning in found] == (["joint_1"] if reached > 0.5 else [])
        assert bool(found) == (speed == 10.0 and substeps is None)
        for warning in found:
            (wanted,) = re.findall(r"Set substeps to (\d+) or more", warning.hint or "")
            assert int(wanted) == np.ceil(reached / 0.2) == 4


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("between", [1, 2])
def test_only_joints_without_mass_between_them_are_named(tmp_path, engine, between):
    """Driven joints on one axis with nothing between them, below an arm with mass."""
    body = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = ["base", "arm", *(f"thin_{i}" for i in range(between)), "hand"]
    text = "".join(f'<link name="{name}">{"" if "thin" in name else body}</link>' for name in links)
    for number, (parent, child) in enumerate(pairwise(links)):
        text += (
            f'<joint name="j{number}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{0.3 if number == 1 else 0} 0 0" rpy="{0.7 if number == 1 else 0} 0 0"/>'
            f'<axis xyz="{"0 1 0" if number == 0 else "0 0 1"}"/></joint>'
            f'<gazebo><plugin name="p{number}" filename="libsea_plugin.so">'
            f"<joint>j{number}</joint><operation_mode>0</operation_mode></plugin></gazebo>"
        )
    (tmp_path / "arm.urdf").write_text(f'<robot name="r">{text}</robot>')
    with pytest.raises(RobotError) as fault:
        prepare(asrsim.make_scenario(tmp_path / "arm.urdf", engine=engine, duration=0.1))
    named = set(re.findall(r"'(j\d)'", str(fault.value)))
    assert named == {f"j{number}" for number in range(1, 2 + between)}, str(fault.value)


def test_a_spring_without_finite_stiffness_is_refused():
    """At the deflection limit of 0.7 rad, the cam's exponential overflows; near 0, its torque is small."""
    robot = chain(replace(BODY, actuator="bavs"))
    keys = {"parameters": {"spring_exponent": 1e3, "max_deflection": 0.75}, "mode": 2, "duration": 0.01, "gravity": 0.0}
    with pytest.raises(UnresolvedSpringError, match="'joint_1' is not finite"):
        run(robot, references={"reference_1": 1.0, "reference_2": -1.0}, **keys)


def test_each_joint_of_a_kind_is_resolved_by_its_own_references():
    """Ideal motors that pretension two sinh springs by sigma give 2 a k cosh(a sigma), whatever the other joints do."""
    presets = {"joint_1": 0.1, "joint_2": 0.4, "joint_3": 0.2}
    references = {name: {"equilibrium_position": 0.0, "stiffness_preset": preset} for name, preset in presets.items()}
    robot = chain(*(replace(BODY, actuator="qbmove") for _ in presets))
    found = run(robot, mode=3, joints=references, duration=0.01, gravity=0.0, compiled=False).resolution.stiffness
    assert found == pytest.approx([2.0 * 8.9992 * 0.0019 * np.cosh(8.9992 * preset) for preset in presets.values()])


BRANCHED = """
import math
from asrsim.actuators import Actuator, Parameter

class Kneed(Actuator):
    name = "kneed"
    title = "Linear spring up to a knee, and exponential beyond it"
    source = "this test"
    motors = 1
    parameters = (Parameter(name="max_deflection", default=2.0, unit="rad", doc="largest deflection"),)

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, parameters):
        size = min(abs(theta_1 - q), parameters[0])
        return math.copysign(5.0 * size if size < 0.2 else math.exp(1e3 * (size - 0.2)), theta_1 - q), 0.0

    @staticmethod
    def stiffness(q, theta_1, theta_2, parameters):
        size = min(abs(theta_1 - q), parameters[0])
        return 5.0 if size < 0.2 else 1e3 * math.exp(1e3 * (size - 0.2))
"""


def test_a_law_that_overflows_beyond_the_reach_of_its_spring_is_resolved(tmp_path):
    """Python's exponential raises an error there, where NumPy's is infinite. The motor jumps by 0.1 rad."""
    (tmp_path / "kneed.py").write_text(BRANCHED)
    (tmp_path / "arm.urdf").write_text(chain(replace(BODY, actuator="sea")).text.replace("libsea", "libkneed"))
    (tmp_path / "step.yaml").write_text(
        "robot: arm.urdf\nduration: 0.1\nmodes: 2\ngravity: [0, 0, 0]\nreferences: {joint_1: {reference_1: 0.1}}\n"
    )
    assert prepare(tmp_path / "step.yaml", plugins=[tmp_path / "kneed.py"]).resolution.stiffness == (5.0,)
