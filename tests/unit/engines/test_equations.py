"""Engines from a user's equations: asrsim uses their masses and forces, not those of the robot's file."""

import numpy as np
import pytest

import asrsim
from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines.equations import EquationEngine
from asrsim.errors import DivergenceError
from asrsim.robot.dynamics import robot_model
from asrsim.simulation.prepare import prepare
from asrsim.simulation.run import simulate
from support.paths import EXAMPLES

SOFT = EXAMPLES / "scenarios" / "step_1dof_sea.yaml"
"""A link of 3.2e-4 kg m^2 on a spring of 200 N m/rad."""


@pytest.fixture
def engine(monkeypatch):
    """Function that registers an engine from functions for mass matrix and bias, each of the engine and its arguments."""

    def register(mass, bias):
        class Own(EquationEngine):
            version = "own 1"

            def __init__(self, scenario, robot):
                super().__init__(scenario, robot)
                self.known = robot_model(scenario, robot)

            def mass_matrix(self, positions):
                return mass(self.known, positions)

            def bias(self, positions, velocities):
                return bias(self.known, positions, velocities)

        ENGINES.add("own", EngineEntry(make=lambda scenario, robot: (Own(scenario, robot), ()), doc="own"), replace=True)

    before = ENGINES.state()
    yield register
    ENGINES.put(before)


def of_file(known, positions, velocities):
    return known.inverse_dynamics(positions, velocities, np.zeros_like(positions))


def test_equations_of_the_file_give_the_model_of_the_file(engine):
    engine(lambda known, q: known.mass_matrix(q), of_file)
    prepared = prepare(
        EXAMPLES / "scenarios" / "step_2dof.yaml",
        variant="soft",
        overrides={"engine": "own", "robot": str(EXAMPLES / "urdf" / "dof2_vertical.urdf"), "expect": []},
    )
    own, known = prepared.model, prepared.plan.model
    assert own is not known
    q, v, a = np.random.default_rng(1).uniform(-9.0, 9.0, (3, 4, 2))
    for name, arguments, rounding in (
        ("mass_matrix", (q,), 1e-15),
        ("gravity_torques", (q,), 1e-15),
        ("inverse_dynamics", (q, v, a), 1e-12),
        ("gravity_stiffness", (q,), 1e-6),
    ):
        for found, right in zip(getattr(own, name)(*arguments), getattr(known, name)(*arguments), strict=True):
            np.testing.assert_allclose(found, right, rtol=0.0, atol=rounding)
    found = [np.ptp([own.energy(*row) - known.energy(*row)]) for row in zip(q, v, strict=True)]
    assert max(found) < 1e-12
    heavier = prepared.vary({"link_2": {"mass": 2.0}})
    np.testing.assert_array_equal(heavier.model.mass_matrix(q), known.varied(heavier.robot).mass_matrix(q))


def test_a_link_that_the_equations_make_light_is_resolved_and_gains_no_energy(engine):
    """Its file states a hundredfold inertia, whose energy at the same speeds would seem to come from nowhere."""
    light = {"engine": "own", "duration": 0.3, "expect": [], "references.joint_1.equilibrium_position": 0.3}
    engine(lambda known, q: 0.01 * known.mass_matrix(q), lambda known, q, v: 0.01 * of_file(known, q, v))
    own, file = (prepare(SOFT, variant="soft", overrides={**light, "engine": name}) for name in ("own", "mujoco"))
    assert own.resolution.substeps / file.resolution.substeps == pytest.approx(10.0, rel=0.05)
    assert simulate(own).status == "complete"


def test_equations_that_create_energy_are_found(engine):
    """The bias of this engine drives the links instead of balancing a force."""
    engine(lambda known, q: known.mass_matrix(q), lambda known, q, v: -3.0 * np.sign(v))
    falling = asrsim.make_scenario(
        EXAMPLES / "urdf" / "plain_arm.urdf", engine="own", duration=1.0, initial={"shoulder": {"velocity": 0.5}}
    )
    with pytest.raises(DivergenceError, match=r"the links have gained .* J without a source"):
        asrsim.run(falling)


def test_a_planned_motion_needs_the_torques_of_the_equations(engine):
    """The references of a spring of constant stiffness rise in proportion to the masses."""
    motion = {"equilibrium_position": {"minimum_jerk": {"to": 0.5, "duration": 0.2}}}
    planned = []
    for factor in (1.0, 2.0, 3.0):
        engine(lambda known, q, f=factor: f * known.mass_matrix(q), lambda known, q, v, f=factor: f * of_file(known, q, v))
        keys = {"engine": "own", "duration": 0.2, "expect": [], "inverse_dynamics": True, "references": {"joint_1": motion}}
        prepared = prepare(SOFT, variant="soft", overrides=keys)
        planned.append(prepared.scenario.references_of("joint_1")["equilibrium_position"].values(np.linspace(0.0, 0.2, 41)))
    assert np.ptp(planned[1] - planned[0]) > 1e-5
    np.testing.assert_allclose(planned[2] - planned[1], planned[1] - planned[0], rtol=1e-6, atol=1e-12)
