"""Engines from a user's equations: asrsim uses their masses and forces, not those of the robot's file."""

import numpy as np
import pytest

import asrsim
from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines.equations import EquationEngine
from asrsim.errors import DivergenceError, RobotError, SimulationError
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
    light = {"engine": "own", "duration": 0.1, "expect": [], "references.joint_1.equilibrium_position": 0.3}
    engine(lambda known, q: 0.01 * known.mass_matrix(q), lambda known, q, v: 0.01 * of_file(known, q, v))
    own, file = (prepare(SOFT, variant="soft", overrides={**light, "engine": name}) for name in ("own", "mujoco"))
    assert own.resolution.substeps / file.resolution.substeps == pytest.approx(10.0, rel=0.05)
    assert simulate(own).status == "complete"


def falling(**keys):
    keys = {"engine": "own", "duration": 0.1, "initial": {"shoulder": {"velocity": 0.5}}} | keys
    return asrsim.make_scenario(EXAMPLES / "urdf" / "plain_arm.urdf", **keys)


SECOND = np.array([0.0, 1.0])
"""Entries of the joint 'elbow' only."""


@pytest.mark.parametrize(
    ("bias", "said"),
    [
        (
            lambda rest, moving, v: rest + 3.0 * moving,
            r"does not belong to its mass matrix: .* joint '(shoulder|elbow)' by .* Coriolis",
        ),
        (
            lambda rest, moving, v: rest + (1.0 + 0.1 * SECOND) * moving,
            "does not belong to its mass matrix: .* joint 'elbow' by",
        ),
        (lambda rest, moving, v: rest + 9.0 * v, "does not belong to its mass matrix"),
        (lambda rest, moving, v: rest + moving - 3.0 * np.sign(v) * SECOND, "drives the joint 'elbow'"),
        (lambda rest, moving, v: rest * (1.0 - 2.0 * SECOND) + moving, "entry of joint '(shoulder|elbow)' by the position of"),
    ],
    ids=["all terms", "one term", "a drag instead", "negative friction", "sign of a weight"],
)
def test_a_bias_that_contradicts_the_mass_matrix_is_refused_with_its_joint(bias, said, engine):
    def wrong(known, q, v):
        rest = of_file(known, q, np.zeros_like(q))
        return bias(rest, of_file(known, q, v) - rest, v)

    engine(lambda known, q: known.mass_matrix(q), wrong)
    with pytest.raises(RobotError, match=r"engine 'own' \(Own\): .*" + said):
        prepare(falling())


def test_springs_and_drag_may_stand_in_the_bias(engine):
    def held(known, q, v):
        return of_file(known, q, v) + 5.0 * q**3 + 0.3 * v + 0.1 * np.abs(v) * v + 0.2 * np.tanh(v / 0.01)

    engine(lambda known, q: known.mass_matrix(q), held)
    assert asrsim.run(falling()).run.status == "complete"


def test_energy_that_the_links_gain_is_blamed_on_the_equations_and_not_on_a_joint(engine):
    """The step does not resolve the spring in this bias, which no law of a joint contains."""
    engine(lambda known, q: known.mass_matrix(q), lambda known, q, v: of_file(known, q, v) + 5e6 * q)
    with pytest.raises(
        DivergenceError, match=r"the run diverged .* the links have gained .* bias of the engine 'own'"
    ) as caught:
        asrsim.run(falling())
    assert caught.value.joint == ""


def test_a_weightless_link_needs_an_engine_that_states_it(engine):
    engine(lambda known, q: known.mass_matrix(q), of_file)
    with pytest.raises(SimulationError, match=r"'own' does not state `takes_weightless = True`.* links forearm"):
        prepare(falling(weightless=["forearm"]))


def test_a_certificate_says_that_an_engine_of_ones_own_was_not_compared(engine, capsys):
    from asrsim.cli.report import print_run

    engine(lambda known, q: known.mass_matrix(q), of_file)
    for compared in (False, True):
        result = asrsim.run(falling(duration=0.03), certify=True, cross_check=compared)
        print_run(result.summary, quiet=False)
        assert ("was not compared with another engine: --cross-check" in capsys.readouterr().out) is not compared


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
