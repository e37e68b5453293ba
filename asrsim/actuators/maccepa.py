"""MACCEPA: a spring between link and lever, whose pretension sets the stiffness (Van Ham et al. 2007)."""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Any

from asrsim.actuators.base import Actuator, max_deflection, saturate
from asrsim.actuators.parameters import Parameter

_POSITIVE: dict[str, Any] = {
    "minimum": 0.0,
    "exclusive_minimum": True,
    "source": "chosen by asrsim for an arm with torques of some N m; the paper's law holds for any values",
}


class Maccepa(Actuator):
    """tau = k B C sin(d) (1 + (P - |C - B|) / A), A = sqrt(B^2 + C^2 - 2 B C cos(d)), d = sat(theta - q).

    The motor turns a lever of length B. A is the length of the cable between the tip of the lever and a hole in the link, which
    is at the distance C from the axis. The cable pulls a spring that is tensed by P at d = 0. The second reference is P, in m.
    The motor that sets P has no dynamics in this model, since no joint torque acts on it.
    """

    name = "maccepa"
    title = "MACCEPA (VSA with adjuster)"
    source = "Van Ham, Vanderborght, Van Damme, Verrelst, Lefeber (2007), Robotics and Autonomous Systems 55(10), 761-768"
    law = (
        "A = sqrt(B^2 + C^2 - 2 B C cos(d)), x = A - abs(C - B) + P, d = sat(theta - q); tau = k x B C sin(d) / A; "
        "stiffness = k B C (cos(d) x / A + B C sin(d)^2 (A - x) / A^3)"
    )
    motors = 1
    adjuster = True
    reference_2_unit = "m"
    typical_preset = 0.01
    preset_range = (0.005, 0.04)
    parameters = (
        Parameter(name="spring_stiffness", default=5000.0, unit="N/m", doc="stiffness k of the spring", **_POSITIVE),
        Parameter(name="lever", default=0.04, unit="m", doc="length B of the lever", **_POSITIVE),
        Parameter(
            name="hole_distance", default=0.1, unit="m", doc="distance C of the cable's hole; differs from B", **_POSITIVE
        ),
        max_deflection(1.0),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        k, lever, hole, limit = parameters
        d = saturate(theta_1 - q, limit)
        cable = sqrt(lever * lever + hole * hole - 2.0 * lever * hole * cos(d))
        return k * (cable - abs(hole - lever) + theta_2) * lever * hole * sin(d) / cable, 0.0

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, lever, hole, limit = parameters
        d = saturate(theta_1 - q, limit)
        cable = sqrt(lever * lever + hole * hole - 2.0 * lever * hole * cos(d))
        stretch = cable - abs(hole - lever) + theta_2
        arm = lever * hole * sin(d) / cable  # derivative of the distance A with respect to d
        return k * (arm * arm + stretch * (lever * hole * cos(d) - arm * arm) / cable)

    @staticmethod
    def elastic_energy(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        k, lever, hole, limit = parameters
        d = theta_1 - q
        s = saturate(d, limit)
        cable = sqrt(lever * lever + hole * hole - 2.0 * lever * hole * cos(s))
        stretch = cable - abs(hole - lever) + theta_2
        stored = 0.5 * k * (stretch * stretch - theta_2 * theta_2)  # energy above the energy of the pretension
        return stored + k * stretch * lever * hole * sin(s) / cable * (d - s)
