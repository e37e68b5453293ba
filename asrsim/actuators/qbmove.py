"""qbMove Advanced: two antagonistic motors with hyperbolic springs (datasheet; Mengacci et al. 2021a)."""

from __future__ import annotations

from asrsim.actuators.base import Antagonistic, cosh, max_deflection, saturate, sinh
from asrsim.actuators.parameters import Parameter


class QbMove(Antagonistic):
    """tau_i = k_i sinh(a_i sat(theta_i - q))."""

    name = "qbmove"
    title = "qbMove Advanced (agonistic-antagonistic VSA)"
    source = "Mengacci et al. (2021), eqs. 5, 6; qbMove Advanced datasheet; released toolbox, qbmove_plugin"
    law = "tau_i = k_i sinh(a_i sat(theta_i - q)); stiffness = sum a_i k_i cosh(a_i sat(theta_i - q))"
    typical_preset = 0.2
    parameters = (
        Parameter(name="spring_a_1", default=8.9992, unit="1/rad", doc="exponent a_1 of spring 1", minimum=0.0),
        Parameter(name="spring_k_1", default=0.0019, unit="N m", doc="torque scale k_1 of spring 1", minimum=0.0),
        Parameter(name="spring_a_2", default=8.9992, unit="1/rad", doc="exponent a_2 of spring 2", minimum=0.0),
        Parameter(name="spring_k_2", default=0.0019, unit="N m", doc="torque scale k_2 of spring 2", minimum=0.0),
        max_deflection(0.8),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        a_1, k_1, a_2, k_2, limit = parameters
        return k_1 * sinh(a_1 * saturate(theta_1 - q, limit)), k_2 * sinh(a_2 * saturate(theta_2 - q, limit))

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        a_1, k_1, a_2, k_2, limit = parameters
        return a_1 * k_1 * cosh(a_1 * saturate(theta_1 - q, limit)) + a_2 * k_2 * cosh(a_2 * saturate(theta_2 - q, limit))

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        a_1, k_1, a_2, k_2, limit = parameters
        d_1, d_2 = theta_1 - q, theta_2 - q
        s_1, s_2 = saturate(d_1, limit), saturate(d_2, limit)
        flat = k_1 * sinh(a_1 * s_1) * (d_1 - s_1) + k_2 * sinh(a_2 * s_2) * (d_2 - s_2)
        return k_1 / a_1 * (cosh(a_1 * s_1) - 1.0) + k_2 / a_2 * (cosh(a_2 * s_2) - 1.0) + flat
