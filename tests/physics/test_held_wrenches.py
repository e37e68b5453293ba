"""Forces and torques that a caller holds on bodies: free bodies follow Newton and Euler, springs rest where they balance."""

import numpy as np
import pytest

import asrsim
from asrsim.errors import InputError
from support.paths import EXAMPLES
from validation.models import INSTALLED

SEA = EXAMPLES / "urdf" / "dof1_sea.urdf"
STEP, END = 1e-3, 0.2
BALL = {"shape": "sphere", "size": 0.1, "mass": 0.5, "inertia": [2e-3] * 3, "position": [3, 0, 1]}
"""A ball far from the robot, with equal moments of inertia."""
FORCE, POINT = np.array([1.5, -0.4, 0.8]), np.array([0.0, 0.05, 0.1])
BODY = """<robot name="brick"><link name="brick"><inertial><origin xyz="0.03 0 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1e-6"/><inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="j" type="revolute"><parent link="brick"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="10"/></joint></robot>"""


def with_objects(engine, **objects):
    return asrsim.make_scenario(
        SEA, engine=engine, duration=1.0, step=STEP, compiled=False, gravity=[0, 0, 0], world={"objects": objects}
    )


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_pushed_object_moves_and_turns_by_newton_and_euler(engine):
    """The wrench ends with the last kick, half a substep before the whole step."""
    with asrsim.Simulation(with_objects(engine, ball=BALL), record=True) as simulation:
        simulation.set_wrench("ball", FORCE, torque=[0, 0, 4e-3])
        simulation.advance(round(END / STEP))
        simulation.set_wrench("ball", [0, 0, 0])
        simulation.advance(100)
        path = simulation.samples.bodies["ball"]
        moved, time = path[-1, :3] - [3, 0, 1], simulation.samples.time[-1]
        acted = END - 0.5 * simulation.prepared.substep
    way = 0.5 * acted**2 + acted * (time - acted)
    np.testing.assert_allclose(moved, FORCE / 0.5 * way, rtol=1e-5)
    angle = 2.0 * np.arctan2(path[-1, 5], path[-1, 6])
    assert angle == pytest.approx(4e-3 / 2e-3 * way, rel=1e-5)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_force_beside_the_centre_turns_an_object(engine):
    """The arm of the force turns with the body: compared with steps of Euler's equation of a ball."""
    with asrsim.Simulation(with_objects(engine, ball=BALL), record=True) as simulation:
        simulation.set_wrench("ball", [0.1, 0, 0], point=[0, 0.1, 0])
        simulation.advance(round(END / STEP))
        samples = simulation.samples
        x, y, z, w = samples.bodies["ball"][-1, 3:]
    h, angle, speed = 1e-5, 0.0, 0.0
    for _ in range(round(samples.time[-1] / h)):
        speed += h * -0.1 * 0.1 * np.cos(angle) / 2e-3
        angle += h * speed
    assert [x, y] == pytest.approx([0, 0], abs=1e-9)
    assert 2.0 * np.arctan2(z, w) == pytest.approx(angle, rel=1e-4)


@pytest.mark.parametrize("ground", [False, True])
@pytest.mark.parametrize("engine", INSTALLED)
def test_a_pushed_floating_base_accelerates_by_newton(engine, ground, tmp_path):
    (tmp_path / "brick.urdf").write_text(BODY)
    world = {"ground": {"height": -5.0}} if ground else {}
    scenario = asrsim.make_scenario(
        tmp_path / "brick.urdf",
        engine=engine,
        duration=1.0,
        step=STEP,
        compiled=False,
        gravity=[0, 0, 0],
        base={"fixed": False},
        world=world,
    )
    with asrsim.Simulation(scenario, record=True) as simulation:
        # Through the centre of mass.
        simulation.set_wrench("brick", FORCE, point=[0.03, 0, 0])
        simulation.advance(round(END / STEP))
        samples = simulation.samples
    np.testing.assert_allclose(samples.bodies["brick"][-1, :3], 0.5 * FORCE / 2.0 * samples.time[-1] ** 2, rtol=1e-4)


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_held_wrench_is_a_wrench_of_the_scenario(engine):
    """On a robot without contacts, plain and compiled."""
    wrench = {"link": "link_2", "force": FORCE.tolist(), "torque": [0.0, 0.01, 0.0], "point": POINT.tolist()}
    one, two = (
        asrsim.prepare(EXAMPLES / "scenarios" / "step_2dof.yaml", variant="soft", overrides={"engine": engine, **more})
        for more in ({"wrenches": [wrench]}, {})
    )
    for compiled in (False, True):
        with asrsim.Simulation(one, compiled=compiled) as first, asrsim.Simulation(two, compiled=compiled) as second:
            second.set_wrench("link_2", FORCE, torque=[0.0, 0.01, 0.0], point=POINT)
            for simulation in (first, second):
                simulation.advance(50)
            positions = [simulation.observe().link_position for simulation in (first, second)]
            np.testing.assert_allclose(*positions, atol=1e-12)
            assert np.abs(positions[0]).max() > 1e-4


@pytest.mark.parametrize("engine", INSTALLED)
def test_a_pulled_arm_rests_by_its_springs_and_is_no_divergence(engine):
    scenario = asrsim.make_scenario(
        SEA,
        engine=engine,
        duration=5.0,
        gravity=[0, 0, 0],
        compiled=False,
        parameters={"joint_1": {"spring_stiffness": 5.0}},
        link_damping={"joint_1": {"constant": 0.2}},
    )
    with asrsim.Simulation(scenario, record=True) as simulation:
        simulation.set_wrench("link_1", [3.0, 0.0, 3.0], point=[0.0, 0.0, 0.1])
        simulation.advance(2000)
        q = simulation.observe().link_position
        torque = simulation.model.jacobian(q, "link_1", (0.0, 0.0, 0.1))[:3, 0] @ [3.0, 0.0, 3.0]
        simulation.flush()
    assert abs(torque) > 0.1
    assert q[0] == pytest.approx(torque / 5.0, abs=1e-6)


@pytest.mark.parametrize("engine", INSTALLED)
def test_snapshots_hold_wrenches_and_resets_do_not(engine):
    with asrsim.Simulation(with_objects(engine, ball=BALL), record=True) as simulation:

        def place():
            return simulation.look().scene().bodies["ball"]

        simulation.set_wrench("ball", FORCE)
        simulation.advance(50)
        snapshot, ends = simulation.snapshot(), []
        for _ in range(2):
            simulation.advance(50)
            ends.append(place())
            simulation.set_wrench("ball", [0, 0, 0])
            simulation.restore(snapshot)
        assert ends[0] == ends[1]
        simulation.reset()
        simulation.advance(50)
        assert place()[:3] == pytest.approx([3, 0, 1], abs=1e-12)


def test_what_cannot_be_pushed_is_refused():
    wall = {"shape": "box", "size": [0.1, 0.1, 0.1], "position": [3, 0, 1]}
    with asrsim.Simulation(with_objects("mujoco", wall=wall)) as simulation:
        for body, force, said in (
            ("wall", [1, 0, 0], "'wall' is neither a link nor a movable object"),
            ("bal", [1, 0, 0], "'bal' is neither a link"),
            ("link_1", [np.nan, 0, 0], "three finite numbers"),
            ("link_1", [1, 0], "three finite numbers"),
        ):
            with pytest.raises(InputError, match=said):
                simulation.set_wrench(body, force)
    bench = asrsim.make_scenario(SEA, engine="bench", duration=1.0)
    with asrsim.Simulation(bench) as simulation, pytest.raises(InputError, match="'bench' takes no wrenches"):
        simulation.set_wrench("link_1", [1, 0, 0])
