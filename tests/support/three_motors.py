"""Plugins of actuators with three motors."""

THREE = """
from asrsim.actuators import Actuator, Parameter, saturate, max_deflection


class Three(Actuator):
    name = "three"
    title = "three springs side by side"
    source = "this test"
    motors = 3
    parameters = (Parameter(name="k", default=5.0, unit="N m/rad", doc="of each spring"), max_deflection(0.6))

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, theta_3, parameters):
        k, most = parameters
        return k * saturate(theta_1 - q, most), k * saturate(theta_2 - q, most), k * saturate(theta_3 - q, most)

    @staticmethod
    def stiffness(q, theta_1, theta_2, theta_3, parameters):
        return 3.0 * parameters[0]

    @staticmethod
    def elastic_energy(q, theta_1, theta_2, theta_3, parameters):
        k, most = parameters
        energy = 0.0
        for x in (theta_1 - q, theta_2 - q, theta_3 - q):
            d = saturate(x, most)
            energy += k * (0.5 * d * d + d * (x - d))
        return energy

    @staticmethod
    def motor_references(equilibrium, preset):
        return equilibrium + preset, equilibrium, equilibrium - preset

    @staticmethod
    def equilibrium_position(theta_1, theta_2, theta_3):
        return (theta_1 + theta_2 + theta_3) / 3.0
"""
"""Python file of three springs side by side."""

PRELOAD = """
from asrsim.actuators import Actuator, Parameter


class Preload(Actuator):
    name = "preload"
    title = "opposing springs whose motor on the housing preloads both"
    source = "this test"
    motors = 3
    housed = 1
    typical_preset = 0.3
    parameters = (
        Parameter(name="linear", default=6.0, unit="N m/rad", doc="linear part k of each spring"),
        Parameter(name="cubic", default=20.0, unit="N m/rad^3", doc="cubic part c of each spring"),
    )

    @staticmethod
    def elastic_torques(q, theta_1, theta_2, theta_3, parameters):
        k, c = parameters
        first, second = theta_1 - q + theta_3, theta_2 - q - theta_3
        torque_1, torque_2 = k * first + c * first**3, k * second + c * second**3
        return torque_1, torque_2, torque_1 - torque_2

    @staticmethod
    def stiffness(q, theta_1, theta_2, theta_3, parameters):
        k, c = parameters
        return 2.0 * k + 3.0 * c * ((theta_1 - q + theta_3) ** 2 + (theta_2 - q - theta_3) ** 2)

    @staticmethod
    def elastic_energy(q, theta_1, theta_2, theta_3, parameters):
        k, c = parameters
        first, second = theta_1 - q + theta_3, theta_2 - q - theta_3
        return 0.5 * k * (first**2 + second**2) + 0.25 * c * (first**4 + second**4)

    @staticmethod
    def motor_references(equilibrium, preset):
        return equilibrium, equilibrium, preset

    @staticmethod
    def equilibrium_position(theta_1, theta_2, theta_3):
        return 0.5 * (theta_1 + theta_2)
"""
"""Python file of two opposing springs with a third motor on the housing."""
