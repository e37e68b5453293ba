"""Plugin of an actuator with three motors."""

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
