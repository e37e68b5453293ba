"""Divergence: unstable runs stop with an error that names the cause."""

from dataclasses import replace

import numpy as np
import pytest

from asrsim.actuators import ACTUATORS
from asrsim.engines import ENGINES, EngineEntry
from asrsim.engines.base import DAMPING, TORQUE
from asrsim.engines.mujoco import MujocoEngine
from asrsim.errors import DivergenceError, UnresolvedSpringError
from asrsim.signals import Constant
from asrsim.simulation.run import Run
from validation.models import INSTALLED, LOAD, Body, chain, run

STIFF = {"equilibrium_position": 0.8, "stiffness_preset": 0.04}
AWAS = replace(LOAD, actuator="awas_ii", damping=0.065)
LIMITS = '<limit lower="-3" upper="3" effort="{effort}" velocity="100"/>'


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


def test_springs_that_need_more_than_max_substeps_are_refused():
    with pytest.raises(UnresolvedSpringError, match="`max_substeps` is 10"):
        run(chain(AWAS), mode=3, references=STIFF, duration=0.1, max_substeps=10)
    resolved = run(chain(AWAS), mode=3, references=STIFF, duration=0.1, max_substeps=17)
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
    entry = EngineEntry(make=lambda *given: (Undamped(*given), ()), doc="wrong", module="mujoco", masses_of_file=True)
    monkeypatch.setitem(ENGINES._entries, "mujoco", entry)
    with pytest.raises(DivergenceError, match="J without a source"):
        run(robot, **options)


def test_excessive_input_is_distinguished_from_an_unstable_spring():
    """A constant torque on a free link is simulated correctly, but no robot is so fast."""
    with pytest.raises(DivergenceError, match=r"no longer finite, or impossibly fast.*input or gain"):
        run(chain(LOAD), duration=1.0, gravity=0.0, external={"joint_1": Constant(value=10.0)})
