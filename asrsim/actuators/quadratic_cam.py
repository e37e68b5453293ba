"""Antagonistic cables over cams that make quadratic springs (Migliore, Brown, DeWeerth 2005)."""

from __future__ import annotations

from asrsim.actuators.base import Antagonistic, max_deflection, saturate
from asrsim.actuators.parameters import Parameter

OURS = "chosen by asrsim for a joint with torques of some N m; the paper's law holds for any values"


class QuadraticCam(Antagonistic):
    """tau_1 = r F(r d_1), tau_2 = -r F(-r d_2), F(x) = a x^2 + b x for x > 0, else 0; d_i = sat(theta_i - q).

    Each motor winds a cable on a pulley of radius r. The cable pulls rollers over a cam, whose contour makes the force
    quadratic in the stretch x. Since cables only pull, motor 1 turns the link up, and motor 2 turns the link down. While the
    two cables are tense, the stiffness
    2 b r^2 + 4 a r^3 preset is linear in the preset and does not depend on the deflection.
    """

    name = "quadratic_cam"
    title = "Quadratic cam springs (agonistic-antagonistic VSA)"
    source = "Migliore, Brown, DeWeerth (2005), Biologically inspired joint stiffness control, ICRA, 4508-4513"
    law = (
        "x_1 = r max(d_1, 0), x_2 = r max(-d_2, 0), d_i = sat(theta_i - q); tau_1 = r (a x_1^2 + b x_1), "
        "tau_2 = -r (a x_2^2 + b x_2); stiffness = r^2 (2 a x_1 + b) where d_1 > 0, plus r^2 (2 a x_2 + b) where d_2 < 0"
    )
    typical_preset = 0.3
    preset_range = (0.1, 0.6)
    parameters = (
        Parameter(name="spring_quadratic", default=2e5, unit="N/m^2", doc="quadratic part a", minimum=0.0, source=OURS),
        Parameter(name="spring_linear", default=500.0, unit="N/m", doc="linear part b", minimum=0.0, source=OURS),
        Parameter(
            name="pulley_radius",
            default=0.025,
            unit="m",
            doc="radius r",
            minimum=0.0,
            exclusive_minimum=True,
            source=OURS,
        ),
        max_deflection(0.8),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        a, b, radius, limit = parameters
        d_1, d_2 = saturate(theta_1 - q, limit), saturate(theta_2 - q, limit)
        x_1, x_2 = 0.5 * radius * (d_1 + abs(d_1)), 0.5 * radius * (abs(d_2) - d_2)
        return radius * x_1 * (a * x_1 + b), -radius * x_2 * (a * x_2 + b)

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        a, b, radius, limit = parameters
        d_1, d_2 = saturate(theta_1 - q, limit), saturate(theta_2 - q, limit)
        x_1, x_2 = 0.5 * radius * (d_1 + abs(d_1)), 0.5 * radius * (abs(d_2) - d_2)
        tense = (x_1 > 0.0) * 1.0 + (x_2 > 0.0) * 1.0
        return radius * radius * (2.0 * a * (x_1 + x_2) + b * tense)

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        a, b, radius, limit = parameters
        d_1, d_2 = theta_1 - q, theta_2 - q
        s_1, s_2 = saturate(d_1, limit), saturate(d_2, limit)
        x_1, x_2 = 0.5 * radius * (s_1 + abs(s_1)), 0.5 * radius * (abs(s_2) - s_2)
        flat = radius * (x_1 * (a * x_1 + b) * (d_1 - s_1) - x_2 * (a * x_2 + b) * (d_2 - s_2))
        return x_1 * x_1 * (a * x_1 / 3.0 + 0.5 * b) + x_2 * x_2 * (a * x_2 / 3.0 + 0.5 * b) + flat
