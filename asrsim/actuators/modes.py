"""The seven operation modes of the paper's section 3.1 as a table; what a mode does follows from its columns."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Mode:
    """One operation mode."""

    number: int
    name: str
    references: tuple[str, ...]
    """Names of the references in scenarios and logs, one or two."""
    units: tuple[str, ...]
    spring: bool
    """The link is driven through the spring (else by the reference or the link's PID directly)."""
    motor: bool
    """The motors have dynamics (else their positions follow the references at once)."""
    controller: bool
    """A PID makes the torque (of the motors; in mode 1 of the link)."""
    mapped: bool
    """References are equilibrium and preset and go through the actuator's reference map."""
    doc: str


MODES: dict[int, Mode] = {
    mode.number: mode
    for mode in (
        Mode(number=0, name="LinkTorque", references=("link_torque",), units=("N m",),
             spring=False, motor=False, controller=False, mapped=False, doc="the reference is the torque on the link"),
        Mode(number=1, name="LinkPID", references=("link_position",), units=("rad",),
             spring=False, motor=False, controller=True, mapped=False, doc="a PID controller acts on the rigid link"),
        Mode(number=2, name="SpringRefs", references=("reference_1", "reference_2"), units=("rad", "rad"),
             spring=True, motor=False, controller=False, mapped=False, doc="ideal motors stand at the references"),
        Mode(number=3, name="SpringEqPres", references=("equilibrium_position", "stiffness_preset"), units=("rad", "rad"),
             spring=True, motor=False, controller=False, mapped=True, doc="ideal motors, through the reference map"),
        Mode(number=4, name="MotorTorques", references=("motor_1_torque", "motor_2_torque"), units=("N m", "N m"),
             spring=True, motor=True, controller=False, mapped=False, doc="the references are the motors' torques"),
        Mode(number=5, name="PIDRefs", references=("reference_1", "reference_2"), units=("rad", "rad"),
             spring=True, motor=True, controller=True, mapped=False, doc="PID controllers bring the motors to the references"),
        Mode(number=6, name="PIDEqPres", references=("equilibrium_position", "stiffness_preset"), units=("rad", "rad"),
             spring=True, motor=True, controller=True, mapped=True, doc="as 5, through the reference map"),
    )
}  # fmt: skip
