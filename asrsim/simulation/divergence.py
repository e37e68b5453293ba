"""Detection of divergence: values that are not finite, and violations of the energy balance.

A check for NaN alone would miss a spring that the step does not resolve, since such a spring saturates, and the motion stays
finite but is wrong.
"""

from __future__ import annotations

from asrsim.errors import DivergenceError
from asrsim.registry.engines import ENGINES
from asrsim.samples import Array
from asrsim.simulation.fields import JOINT
from asrsim.simulation.ledger import SHARE
from asrsim.simulation.prepared import Prepared
from asrsim.simulation.substeps import COARSE

FLOOR = 5e-3
"""Energies below this value, in J, are not checked."""


def runaway(prepared: Prepared, joint: str, time: float, what: str) -> DivergenceError:
    """DivergenceError with the likely cause and a remedy. joint: name of the joint at fault, empty if the fault concerns the
    whole robot; what: description of the fault.
    """
    omega_h, engine = prepared.resolution.omega_h, prepared.scenario.engine
    cause = (
        f"the step is probably too large for the stiffest spring (omega h = {omega_h:.2g}). Lower the step or raise substeps"
        if omega_h > COARSE
        else "probably an input or gain drives the joint away, or a contact cannot be resolved. Look at the last samples of "
        "the log; lower the gains or the step"
    )
    if prepared.model is not None and not prepared.model.of_file:
        own = (
            f"the mass matrix and bias of the engine '{engine}' are wrong for this motion, or its bias contains a spring that "
            "the step does not resolve. Compare the engine by --cross-check, and lower the step"
        )
        cause = f"{cause}. Or {own}" if joint else f"probably {own}"
    where = f"joint '{joint}'" if joint else "the run"
    return DivergenceError(f"{where} diverged at t = {time:.4f} s: {what}; {cause}", joint=joint, time=time)


def _knows_masses(prepared: Prepared) -> bool:
    """Whether the model has the same masses and forces as the engine, from the robot's file or from the engine's equations."""
    model = prepared.model
    return model is not None and (not model.of_file or ENGINES.get(prepared.scenario.engine).masses_of_file)


class EnergyGuard:
    """Checks the energy balances of the links and of each actuator.

    If the step does not resolve a spring, the energy balance of the links still closes, but the energy balance of the actuator
    does not. In stable runs, even in runs with a coarse step, the residual stays far below `SHARE` times the turnover (the sum
    of the magnitudes of all work). In unstable runs the residual exceeds this bound.
    """

    def __init__(self, prepared: Prepared) -> None:
        """prepared: the scenario with the initial state of the run."""
        scenario, model, self._joints = prepared.scenario, prepared.model, prepared.drives
        # Do not check runs with the stepping of the released code. It is not passive, and it simulates springs that the step
        # does not resolve.
        self._active = model is not None and not prepared.stepping.released
        # Check the links only without contacts and wrenches, since the energy balance of the links ignores the work of contacts
        # and wrenches.
        alone = scenario.world.empty and scenario.fixed_base and not scenario.wrenches
        self._model = model if self._active and alone and _knows_masses(prepared) else None
        self._start = self._fastest = 0.0
        if self._model is not None:
            self._start = float(self._model.energy(prepared.initial_positions, prepared.initial_velocities))

    def forget_links(self) -> None:
        """Check only the energy balance of the actuators after this call."""
        self._model = None

    def look(self, state: Array) -> tuple[str, str] | None:
        """Joint with a violated energy balance and a description of the fault; None if no balance is violated. The joint is
        empty for the energy of the links, which no single joint explains. state: state of the joints (joints, columns).
        """
        if not self._active:
            return None
        model = self._model
        given, residual, turnover, excess = (
            state[:, JOINT[name]] for name in ("net_link_work", "residual", "turnover", "excess")
        )
        worst = int(excess.argmax())
        if excess[worst] > FLOOR:
            change = "vanished in" if residual[worst] > 0.0 else "appeared without a source in"
            return self._joints[worst].name, f"{abs(residual[worst]):.3g} J {change} its actuator"
        if model is None:
            return None
        positions, velocities = state[:, JOINT["position"]], state[:, JOINT["engine_velocity"]]
        # Residuals of actuators are reported above. Subtract them, so that they are not reported again as residuals of the
        # links.
        kinetic, potential = model.energies(positions, velocities)
        created = float(kinetic + potential - self._start - given.sum() - residual.sum())
        # The velocities are half a step later than the positions, so that a conversion of potential to kinetic energy appears
        # as a gain. Therefore allow for a fraction of the kinetic energy.
        self._fastest = max(self._fastest, float(kinetic))
        if created > FLOOR + SHARE * (turnover.sum() + self._fastest):
            return "", f"the links have gained {created:.3g} J without a source"
        return None
