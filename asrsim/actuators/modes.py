"""Table of the operation modes: seven from section 3.1 of the paper, and two for motors driven by voltage or current."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Mode:
    """Operation mode of an actuator."""

    number: int
    name: str
    references: tuple[str, ...]
    """Names of the one or two references in scenarios and logs."""
    doc: str
    units: tuple[str, ...] = ("rad", "rad")
    """Units of the references."""
    spring: bool = False
    """Whether springs drive the link; if not, the reference or the PID controller of the link drives the link directly."""
    motor: bool = False
    """Whether the motors have dynamics; without dynamics, their positions equal the references at once."""
    controller: bool = False
    """Whether PID controllers command the motors; in mode 1, the PID controller commands the torque on the link."""
    mapped: bool = False
    """Whether the references are equilibrium and preset, which the actuator's reference map turns into motor positions."""
    command: str = "torque"
    """Quantity that a reference sets if it drives a motor directly: torque, voltage or current."""

    @property
    def direct(self) -> bool:
        """Whether the references drive the motors without a controller."""
        return self.motor and not self.controller

    def references_of(self, motors: int) -> tuple[str, ...]:
        """Names of the references for an actuator with this number of motors; `references` lists them for two motors."""
        if self.mapped or len(self.references) < 2:
            return self.references
        return (*self.references, *(self.references[0].replace("1", str(i)) for i in range(3, motors + 1)))


MODES: dict[int, Mode] = {
    mode.number: mode
    for mode in (
        Mode(number=0, name="LinkTorque", references=("link_torque",), units=("N m",),
             doc="the reference is the torque on the link"),
        Mode(number=1, name="LinkPID", references=("link_position",), units=("rad",),
             controller=True, doc="a PID controller acts on the rigid link"),
        Mode(number=2, name="SpringRefs", references=("reference_1", "reference_2"),
             spring=True, doc="ideal motors stand at the references"),
        Mode(number=3, name="SpringEqPres", references=("equilibrium_position", "stiffness_preset"),
             spring=True, mapped=True, doc="ideal motors stand at the positions from the reference map"),
        Mode(number=4, name="MotorTorques", references=("motor_1_torque", "motor_2_torque"), units=("N m", "N m"),
             spring=True, motor=True, doc="the references are the motors' torques"),
        Mode(number=5, name="PIDRefs", references=("reference_1", "reference_2"),
             spring=True, motor=True, controller=True, doc="PID controllers bring the motors to the references"),
        Mode(number=6, name="PIDEqPres", references=("equilibrium_position", "stiffness_preset"),
             spring=True, motor=True, controller=True, mapped=True,
             doc="PID controllers bring the motors to the positions from the reference map"),
        Mode(number=7, name="MotorVoltages", references=("motor_1_voltage", "motor_2_voltage"), units=("V", "V"),
             spring=True, motor=True, command="voltage",
             doc="the references are the motors' voltages (not in the toolbox)"),
        Mode(number=8, name="MotorCurrents", references=("motor_1_current", "motor_2_current"), units=("A", "A"),
             spring=True, motor=True, command="current",
             doc="the references are the motors' currents (not in the toolbox)"),
    )
}  # fmt: skip
