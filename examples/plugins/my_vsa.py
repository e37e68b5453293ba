"""A plugin with a variable-stiffness actuator: two antagonistic motors with cubic springs.

tau_i = k d_i + c d_i^3, d_i = sat(theta_i - q). The preset is half of the angle between the motors. It stiffens the joint:
at the equilibrium, the stiffness is 2 k + 6 c preset^2.

Use the actuator:    asrsim run scenario.yaml --plugin my_vsa.py
Check the actuator:  asrsim check --actuator my_vsa --plugin my_vsa.py
"""

from __future__ import annotations

from asrsim.actuators import Antagonistic, Parameter, max_deflection, saturate


class MyVsa(Antagonistic):
    """Actuator with antagonistic cubic springs."""

    name = "my_vsa"  # in a URDF: filename="libmy_vsa_plugin.so"
    title = "My variable-stiffness actuator"
    source = "an example of the asrsim documentation"
    law = "d_i = sat(theta_i - q); tau_i = k d_i + c d_i^3; stiffness = sum (k + 3 c d_i^2)"
    motors = 2
    typical_preset = 0.2
    parameters = (
        Parameter(name="linear", default=2.0, unit="N m/rad", doc="linear part k", source="example", minimum=0.0),
        Parameter(name="cubic", default=30.0, unit="N m/rad^3", doc="cubic part c", source="example", minimum=0.0),
        max_deflection(0.6),
    )

    @staticmethod
    def elastic_torques(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> tuple[float, float]:
        """Torques of both springs on the link, N m."""
        k, c, limit = parameters
        d_1, d_2 = saturate(theta_1 - q, limit), saturate(theta_2 - q, limit)
        return k * d_1 + c * d_1 * d_1 * d_1, k * d_2 + c * d_2 * d_2 * d_2

    @staticmethod
    def stiffness(q: float, theta_1: float, theta_2: float, parameters: tuple[float, ...]) -> float:
        """Stiffness, N m/rad: minus the derivative of the total torque with respect to q."""
        k, c, limit = parameters
        d_1, d_2 = saturate(theta_1 - q, limit), saturate(theta_2 - q, limit)
        return 2.0 * k + 3.0 * c * (d_1 * d_1 + d_2 * d_2)
