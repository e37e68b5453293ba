"""Toolbox stepping runs every scenario that the toolbox runs in Gazebo, with Gazebo's limits and springs of URDFs."""

from dataclasses import replace

import numpy as np
import pytest

import asrsim
from asrsim.signals import Sinusoid, Step
from asrsim.simulation.run import simulate
from validation.models import INSTALLED, LOAD, Body, chain, column, run

STIFF = {"equilibrium_position": 0.8, "stiffness_preset": 0.04}


@pytest.mark.parametrize("mode", [5, 6])
def test_toolbox_stepping_runs_stiff_springs_with_motors(mode):
    """At deflections of 1 mrad, toolbox stepping creates more energy than the springs contain."""
    name = "reference_1" if mode == 5 else "equilibrium_position"
    result = run(
        chain(replace(LOAD, actuator="sea", damping=0.065, friction=0.025)),
        mode=mode,
        stepping="toolbox",
        duration=2.0,
        references={name: Sinusoid(amplitude=0.8, angular_frequency=1.6)},
        parameters={"spring_stiffness": 200.0},
    )
    assert result.status == "complete"
    goal = 0.8 * np.sin(1.6 * 2.0)
    assert column(result, "link_position")[-1] == pytest.approx(goal, abs=0.1)


@pytest.mark.parametrize(
    ("given", "start"),
    [
        ({}, 0.0),
        ({"initial_motor_positions": {"joint_1": (0.2,)}}, 0.2),
        ({"initial_motor_velocities": {"joint_1": (1.0,)}}, 0.3),
    ],
)
def test_motors_of_the_toolbox_start_at_0_unless_stated(given, start):
    """With a start velocity alone, motors start at the position of the link."""
    result = run(
        chain(Body(actuator="sea", inertia=1e-2)),
        mode=5,
        stepping="toolbox",
        initial=[0.3],
        duration=0.002,
        references={"reference_1": 0.0},
        **given,
    )
    assert column(result, "motor_1_position")[0] == pytest.approx(start, abs=2e-3)


def test_toolbox_stepping_warns_of_unresolved_springs_but_runs():
    """AwAS-II at 40 mm and 1 ms, as Gazebo ran it: omega h = 3.3."""
    result = run(
        chain(replace(LOAD, actuator="awas_ii", damping=0.065)), mode=3, references=STIFF, duration=1.0, stepping="toolbox"
    )
    assert result.status == "complete"
    (warning,) = [problem for problem in result.warnings if problem.code == "unresolved-spring"]
    assert "omega h = 3.3" in warning.message


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize(
    ("stepping", "given", "cut"), [("toolbox", None, True), ("toolbox", False, False), ("leapfrog", None, False)]
)
def test_velocity_cutoff_stops_driving_torques_but_not_braking_torques(engine, stepping, given, cut):
    """As in Gazebo, the cutoff does not affect braking torques."""
    limits = '<limit lower="-30" upper="30" effort="100" velocity="0.5"/>'
    result = run(
        chain(Body(actuator="sea", mass=0.4, reach=0.1, inertia=2e-3, limits=limits)),
        mode=0,
        gravity=0.0,
        duration=0.6,
        references={"link_torque": Step(at=0.4, before=0.01, after=-0.01)},
        stepping=stepping,
        velocity_cutoff=given,
        engine=engine,
    )
    speed, torque = column(result, "link_velocity"), column(result, "link_torque")
    gained = 0.01 * 1e-3 / (2e-3 + 0.4 * 0.01)
    if not cut:
        assert speed[400] == pytest.approx(400 * gained, rel=0.01)
        return
    assert np.all(np.abs(speed) < 0.5 + 2.0 * gained)
    assert speed[390] == pytest.approx(0.5, abs=2.0 * gained)
    assert torque[390] == 0.0, "the log has what moved the link"
    assert speed[599] < speed[400] - 190 * gained, "it brakes"


SPRUNG = """<robot name="stand"><link name="base"/><link name="leg"><inertial><origin xyz="0 0 -0.1"/><mass value="0.3"/>
<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="kick" type="revolute"><parent link="base"/><child link="leg"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0" effort="100" velocity="100"/><dynamics damping="0.5"/></joint>
<gazebo reference="kick"><springStiffness>200</springStiffness><springReference>-0.26</springReference></gazebo></robot>"""


@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("stepping", ["leapfrog", "euler", "toolbox"])
def test_gazebo_spring_holds_a_passive_joint(tmp_path, engine, stepping):
    """The joint rests where 200 (-0.26 - q) = m g l sin q."""
    path = tmp_path / "stand.urdf"
    path.write_text(SPRUNG)
    result = simulate(asrsim.make_scenario(path, duration=1.0, engine=engine, stepping=stepping))
    assert result.samples is not None
    q = float(result.samples.values["link_position"][-1, 0])
    assert 200.0 * (-0.26 - q) == pytest.approx(0.3 * 9.81 * 0.1 * np.sin(q), abs=1e-4)


@pytest.mark.parametrize(
    "effect",
    [
        {"spring_cubic": 30.0},
        {"hysteresis_torque": 0.3},
        {"backlash": 0.1},
        {"motor_1_load_friction": 0.3},
        {"motor_1_torque_constant": 0.1, "motor_1_max_current": 2.0},
    ],
)
def test_toolbox_stepping_ignores_effects_that_the_toolbox_lacks_and_warns(effect):
    runs = [
        run(
            chain(Body(actuator="sea", inertia=1e-2)),
            mode=5,
            stepping=stepping,
            duration=0.1,
            references={"reference_1": 0.8},
            parameters=parameters,
        )
        for stepping, parameters in (("toolbox", {}), ("toolbox", effect), ("leapfrog", {}), ("leapfrog", effect))
    ]
    moved = [column(one, "link_position") for one in runs]
    np.testing.assert_array_equal(moved[0], moved[1])
    assert np.abs(moved[2] - moved[3]).max() > 1e-4
    assert "released-model" in {problem.code for problem in runs[1].warnings}
