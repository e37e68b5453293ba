"""BAVS: bidirectional antagonism with variable stiffness, cam springs on both sides (Petit et al. 2015)."""

from __future__ import annotations

from math import exp

from asrsim.actuators.base import Antagonistic, max_deflection, saturate
from asrsim.actuators.parameters import Parameter


class Bavs(Antagonistic):
    """tau_1 = k (b exp(k_e d_1) - a exp(-k_e d_1)), tau_2 = k (a exp(k_e d_2) - b exp(-k_e d_2)).

    d_i = sat(theta_i - q) is the deflection of spring i.
    """

    name = "bavs"
    title = "BAVS (bidirectional antagonistic VSA)"
    source = "Petit et al. (2015); released toolbox, bavs_plugin"
    law = (
        "d_i = sat(theta_i - q); tau_1 = k (b exp(k_e d_1) - a exp(-k_e d_1)); tau_2 = k (a exp(k_e d_2) - b exp(-k_e d_2)); "
        "stiffness = k k_e (b exp(k_e d_1) + a exp(-k_e d_1) + a exp(k_e d_2) + b exp(-k_e d_2))"
    )
    typical_preset = 0.1
    parameters = (
        Parameter(name="spring_a", default=1.21e-6, unit="1", doc="weight a of the spring's weak side", minimum=0.0),
        Parameter(name="spring_b", default=2.38e-6, unit="1", doc="weight b of the spring's strong side", minimum=0.0),
        Parameter(name="spring_k", default=1.6e5, unit="N m", doc="torque scale k", minimum=0.0),
        Parameter(name="spring_exponent", default=8.71, unit="1/rad", doc="exponent k_e of the cam", minimum=0.0),
        max_deflection(0.27),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        a, b, k, k_e, limit = parameters
        d_1 = saturate(theta_1 - q, limit)
        d_2 = saturate(theta_2 - q, limit)
        return k * (b * exp(k_e * d_1) - a * exp(-k_e * d_1)), k * (a * exp(k_e * d_2) - b * exp(-k_e * d_2))

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        a, b, k, k_e, limit = parameters
        d_1 = saturate(theta_1 - q, limit)
        d_2 = saturate(theta_2 - q, limit)
        return k * k_e * (b * exp(k_e * d_1) + a * exp(-k_e * d_1) + a * exp(k_e * d_2) + b * exp(-k_e * d_2))

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        a, b, k, k_e, limit = parameters
        d_1, d_2 = theta_1 - q, theta_2 - q
        s_1, s_2 = saturate(d_1, limit), saturate(d_2, limit)
        curved = b * exp(k_e * s_1) + a * exp(-k_e * s_1) + a * exp(k_e * s_2) + b * exp(-k_e * s_2) - 2.0 * (a + b)
        flat_1 = (b * exp(k_e * s_1) - a * exp(-k_e * s_1)) * (d_1 - s_1)
        flat_2 = (a * exp(k_e * s_2) - b * exp(-k_e * s_2)) * (d_2 - s_2)
        return k * (curved / k_e + flat_1 + flat_2)
