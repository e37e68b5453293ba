"""AwAS-II: one motor acts through a lever, and an adjuster moves the pivot of the lever (Jafari et al. 2011)."""

from __future__ import annotations

from math import cos, sin

from asrsim.actuators.base import Actuator, max_deflection, saturate
from asrsim.actuators.parameters import Parameter


class AwasII(Actuator):
    """tau = g(sigma) sin(d) cos(d), d = sat(theta - q), g = 2 Ks ((L / r_t) sigma / (L - sigma))^2.

    The second reference is sigma, the position of the adjuster in m. The adjuster has no dynamics (section 2.3 of the paper).
    """

    name = "awas_ii"
    title = "AwAS-II (VSA with adjuster)"
    source = "Jafari et al. (2011); Mengacci et al. (2021), eq. 4; released toolbox, awas_ii_plugin"
    law = "g = 2 Ks ((L / r_t) sigma / (L - sigma))^2, d = sat(theta - q); tau = g sin(d) cos(d); stiffness = g cos(2 d)"
    motors = 1
    adjuster = True
    reference_2_unit = "m"
    typical_preset = 0.01
    preset_range = (0.005, 0.04)  # range of the settings in figure 8 of the source
    parameters = (
        Parameter(name="spring_stiffness", default=10.0, unit="N m/rad", doc="scale Ks of the law", minimum=0.0),
        Parameter(
            name="lever_length", default=0.05, unit="m", doc="length L of the lever; larger than sigma",
            minimum=0.0, exclusive_minimum=True,
        ),
        Parameter(
            name="pulley_radius", default=0.015, unit="m", doc="radius r_t", minimum=0.0, exclusive_minimum=True,
        ),
        Parameter(
            name="spring_rest_length", default=1.0, unit="m", doc="rest length l_0",
            unused="no term of the law contains this length; the released code reads the length without using it",
        ),
        max_deflection(0.3),
    )  # fmt: skip

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        k_s, length, radius, _, limit = parameters
        lever = length / radius * theta_2 / (length - theta_2)
        d = saturate(theta_1 - q, limit)
        return 2.0 * k_s * (lever * lever) * sin(d) * cos(d), 0.0

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k_s, length, radius, _, limit = parameters
        lever = length / radius * theta_2 / (length - theta_2)
        return 2.0 * k_s * (lever * lever) * cos(2.0 * saturate(theta_1 - q, limit))

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k_s, length, radius, _, limit = parameters
        lever = length / radius * theta_2 / (length - theta_2)
        d = theta_1 - q
        s = saturate(d, limit)
        return k_s * (lever * lever) * (sin(s) * sin(s) + 2.0 * sin(s) * cos(s) * (d - s))
