"""Plain URDFs without plugin blocks, as a new user has them."""

from asrsim.actuators import MODES
from asrsim.actuators.drive import Drive

PLAIN_ARM = {"lower": -2.0, "upper": 2.0}
"""Position limits of every joint, rad."""


def write_plain_arm(folder, lengths=(0.3, 0.25), masses=(0.8, 0.5), effort=20.0):
    """Write an upright chain of rods with joints `joint_1`, `joint_2`, ... about y, and return its path.

    Lengths in m, masses in kg, effort limit in N m.
    """
    inertia = " ".join(f'{name}="0.01"' for name in ("ixx", "iyy", "izz")) + ' ixy="0" ixz="0" iyz="0"'
    parts = [f'<robot name="plain"><link name="base"><inertial><mass value="2"/><inertia {inertia}/></inertial></link>']
    parent, height = "base", 0.1
    for number, (length, mass) in enumerate(zip(lengths, masses, strict=True), start=1):
        moment = mass * length**2 / 12.0
        parts.append(
            f'<joint name="joint_{number}" type="revolute"><parent link="{parent}"/><child link="link_{number}"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/>'
            f'<limit lower="{PLAIN_ARM["lower"]}" upper="{PLAIN_ARM["upper"]}" effort="{effort}" velocity="10"/></joint>'
            f'<link name="link_{number}"><inertial><origin xyz="0 0 {length / 2}"/><mass value="{mass}"/>'
            f'<inertia ixx="{moment}" iyy="{moment}" izz="{moment / 50}" ixy="0" ixz="0" iyz="0"/></inertial>'
            f'<visual><origin xyz="0 0 {length / 2}"/><geometry><cylinder radius="0.025" length="{length}"/></geometry>'
            "</visual></link>"
        )
        parent, height = f"link_{number}", length
    path = folder / "arm.urdf"
    path.write_text("\n".join([*parts, "</robot>"]), encoding="utf-8")
    return path


def drive_with(actuator, spring, mode=3, joint="j", **motors):
    """Actuator on a joint. Spring parameters are given in order, without optional ones; motor parameters by name, as
    `proportional=(...)`."""
    values = {parameter.name: parameter.default for parameter in actuator.all_parameters()}
    values |= dict(zip((one.name for one in actuator.parameters if not one.optional), spring, strict=True))
    for name, numbers in motors.items():
        part = "controller" if name in ("proportional", "integral", "derivative") else "motor"
        values |= {f"{part}_{i}_{name}": number for i, number in enumerate(numbers, start=1)}
    return Drive(joint=joint, actuator=actuator, mode=MODES[mode], values=values)
