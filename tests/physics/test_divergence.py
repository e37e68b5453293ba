"""Divergence: unstable runs stop with an error that names the cause; stable runs never stop."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.engines import ENGINES
from asrsim.engines.base import DAMPING, TORQUE, EngineEntry
from asrsim.engines.mujoco import MujocoEngine
from asrsim.errors import DivergenceError, UnresolvedSpringError
from asrsim.signals import Constant, PulseTrain, Ramp, Sinusoid, Step
from asrsim.simulation.run import Run
from validation.contacts import push, slide
from validation.models import INSTALLED, LOAD, SETTINGS, Body, chain, run

STIFF = {"equilibrium_position": 0.8, "stiffness_preset": 0.04}
AWAS = replace(LOAD, actuator="awas_ii", damping=0.065)
LIMITS = '<limit lower="-3" upper="3" effort="{effort}" velocity="100"/>'
STOPS = '<limit lower="-0.2" upper="0.3" effort="100" velocity="100"/>'


def test_a_spring_that_one_step_cannot_resolve_is_refused():
    with pytest.raises(UnresolvedSpringError, match=r"joint 'joint_1'.*omega h = 3\.33.*at least 17 substeps"):
        run(chain(AWAS), mode=3, references=STIFF, duration=0.1, substeps=1)


@pytest.mark.parametrize("omega_h", [1.98, 2.02])
def test_springs_with_omega_h_above_two_are_refused(omega_h):
    step, probe = 0.001, {"spring_stiffness": 100.0}
    body = replace(LOAD, actuator="sea")
    options = {"mode": 3, "references": {"equilibrium_position": 0.1}, "duration": 0.01, "step": step, "substeps": 1}
    soft = run(chain(body), parameters=probe, **options).resolution.omega_h
    stiff = {"spring_stiffness": 100.0 * (omega_h / soft) ** 2}
    if omega_h < 2.0:
        assert run(chain(body), parameters=stiff, **options).resolution.omega_h == pytest.approx(omega_h)
    else:
        with pytest.raises(UnresolvedSpringError, match=r"omega h = 2\.02, the limit is 2"):
            run(chain(body), parameters=stiff, **options)


def test_springs_that_exceed_the_substep_cap_are_refused():
    with pytest.raises(UnresolvedSpringError, match="the cap is 10"):
        run(chain(AWAS), mode=3, references=STIFF, duration=0.1, substep_cap=10)
    resolved = run(chain(AWAS), mode=3, references=STIFF, duration=0.1, substep_cap=17)
    assert resolved.resolution.substeps == 17


@pytest.fixture
def softer_than_it_is(monkeypatch):
    """Actuator with a wrong stiffness law, as in a faulty plugin: asrsim chooses too few substeps."""
    monkeypatch.setattr(ACTUATORS.get("awas_ii"), "stiffness", staticmethod(lambda *_: 1.0))


@pytest.mark.usefixtures("softer_than_it_is")
@pytest.mark.parametrize("engine", INSTALLED)
@pytest.mark.parametrize("effort", ["1e6", "300"], ids=["no limit", "effort limit"])
@pytest.mark.parametrize("friction", [0.0, 0.025])
def test_a_spring_that_is_not_resolved_diverges_in_energy(effort, friction, engine):
    """All values stay finite, since the deflection saturates. Only the energy reveals the divergence."""
    robot = chain(replace(AWAS, friction=friction, limits=LIMITS.format(effort=effort)))
    with pytest.raises(DivergenceError, match=r"joint 'joint_1' diverged.* J ") as caught:
        run(robot, mode=3, references=STIFF, duration=2.0, substeps=1, engine=engine)
    error = caught.value
    assert error.joint == "joint_1"
    assert 0.0 < error.time <= 2.0
    stopped = error.run
    assert isinstance(stopped, Run)
    assert stopped.status == "diverged"
    assert stopped.samples is not None
    assert len(stopped.samples.time) > 10
    assert np.all(np.isfinite(stopped.samples.values["link_position"]))


@pytest.mark.usefixtures("softer_than_it_is")
def test_divergence_error_names_the_unstable_joint():
    robot = chain(Body(actuator="sea", mass=1.0, reach=0.05, inertia=0.05), replace(AWAS, mass=0.2))
    with pytest.raises(DivergenceError) as caught:
        run(robot, mode=3, duration=1.0, substeps=1, joints={"joint_1": {"equilibrium_position": 0.1}, "joint_2": STIFF})
    assert caught.value.joint == "joint_2"


class Undamped(MujocoEngine):
    """Faulty engine that ignores the damping of the joints."""

    native = None

    def step(self, exchange, wrenches, lengths):
        """Step without damping."""
        free = exchange.copy()
        free[..., DAMPING] = 0.0
        super().step(free, wrenches, lengths)
        exchange[..., :TORQUE] = free[..., :TORQUE]


def test_a_link_that_damping_does_not_slow_is_stopped(monkeypatch):
    """A link of 0.125 J coasts. The damping has to take this energy in 0.1 s, but the link keeps it."""
    robot = chain(Body(mass=1e-9, reach=0.0, inertia=0.01, damping=0.1))
    options = {"gravity": 0.0, "duration": 1.0, "engine": "mujoco", "initial_velocities": {"joint_1": 5.0}}
    assert run(robot, **options).status == "complete"
    entry = EngineEntry(make=lambda *given: (Undamped(*given), ()), doc="wrong", module="mujoco")
    monkeypatch.setitem(ENGINES._entries, "mujoco", entry)
    with pytest.raises(DivergenceError, match="that nothing gave them"):
        run(robot, **options)


def test_excessive_input_is_distinguished_from_an_unstable_spring():
    """A constant torque on a free link is simulated correctly, but no robot is so fast."""
    with pytest.raises(DivergenceError, match=r"no longer finite or sane.*input or gain"):
        run(chain(LOAD), duration=1.0, gravity=0.0, external={"joint_1": Constant(value=10.0)})


# -- what is fine ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stepping", ["euler", "toolbox"])
@pytest.mark.parametrize("name", [name for name in SETTINGS if name != "AwAS-II .04"])
def test_the_papers_settings_run_in_every_stepping(name, stepping):
    actuator, preset, parameters = SETTINGS[name]
    result = run(
        chain(replace(LOAD, actuator=actuator, damping=0.065, friction=0.025, limits=LIMITS.format(effort="300"))), mode=3,
        references={"equilibrium_position": 0.8, "stiffness_preset": preset}, parameters=parameters, duration=0.5,
        stepping=stepping,
    )  # fmt: skip
    assert result.status == "complete"


ARM = Body(actuator="qbmove", mass=0.5, reach=0.08, inertia=6e-4)
WAVE = {"equilibrium_position": Sinusoid(amplitude=0.5, frequency=1.0), "stiffness_preset": 0.2}
FINE = {
    "joint stops hit at speed": {"bodies": [replace(ARM, limits=STOPS)], "mode": 3, "references": WAVE},
    "strong dry friction": {"bodies": [replace(ARM, friction=0.3)] * 2, "mode": 6, "references": WAVE},
    "strong damping": {"bodies": [replace(ARM, damping=5.0)], "mode": 6, "references": WAVE},
    "motors at torque and speed limits": {
        "bodies": [ARM], "mode": 6, "parameters": {"motor_1_max_torque": 0.3, "motor_2_max_velocity": 0.5},
        "references": WAVE,
    },
    "motors at their stops": {
        "bodies": [ARM], "mode": 6, "parameters": {"motor_1_max_position": 0.2, "motor_2_min_position": -0.2},
        "references": WAVE,
    },
    "springs far beyond their deflection limit": {
        "bodies": [ARM], "mode": 3, "parameters": {"max_deflection": 0.05},
        "references": {"equilibrium_position": Step(at=0.1, after=3.0), "stiffness_preset": 0.2},
    },
    "references that jump often": {
        "bodies": [ARM] * 2, "mode": 3,
        "references": {
            "equilibrium_position": PulseTrain(high=1.0, width=0.0313, period=0.0717), "stiffness_preset": 0.3,
        },
    },
    "an adjuster that moves fast": {
        "bodies": [replace(ARM, actuator="awas_ii")], "mode": 6,
        "references": {
            "equilibrium_position": 0.5, "stiffness_preset": Sinusoid(amplitude=0.01, frequency=5.0, offset=0.02),
        },
    },
}  # fmt: skip


@pytest.mark.parametrize("name", FINE)
def test_demanding_but_stable_runs_are_not_stopped(name):
    options = dict(FINE[name])
    bodies = options.pop("bodies")
    parameters = options.pop("parameters", {})
    result = run(chain(*bodies), duration=1.0, parameters=parameters, **options)
    assert result.status == "complete"
    assert result.samples is not None
    assert np.all(np.isfinite(result.samples.values["link_position"]))


def test_long_swings_are_not_stopped():
    """Kinetic and gravitational energy change quickly, and the engine's velocity is half a step late."""
    assert run(chain(*[replace(ARM, actuator=None)] * 2), duration=20.0, initial=[1.5, 0.5]).status == "complete"


def test_contacts_do_not_stop_a_run():
    assert push(Ramp(final=20.0, start=0.1, duration=0.5), duration=0.8).status == "complete"
    assert slide(0.5, duration=0.5).status == "complete"
