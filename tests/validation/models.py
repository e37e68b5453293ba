"""Robots and scenarios of the checks: serial chains of simple bodies with any actuator in the joints."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asrsim.engines import ENGINES
from asrsim.robot import Robot, load_robot
from asrsim.scenario import Scenario
from asrsim.signals import Constant
from asrsim.signals.base import Signal
from asrsim.simulation.run import Run, simulate
from validation.check import engine

GRAVITY = 9.81
"""Gravitational acceleration, m/s^2."""
MOTOR_INERTIA = 0.0233
"""Inertia of a motor, kg m^2 (default of the released toolbox). Written here so that checks do not depend on asrsim."""
PROPORTIONAL = 125.0
"""Proportional gain of the motor controllers, N m/rad (default of the released toolbox)."""
FRICTION_STIFFNESS = 1000.0
"""Stiffness of the Dahl friction, N m/rad (paper eq. 8)."""
"""Vector of gravity, m/s^2."""

INSTALLED = [name for name in ("mujoco", "bullet") if ENGINES.get(name).available]
"""Installed engines."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """A link and its joint. The joint is `length` m of the previous body below the previous joint, the first in the world."""

    actuator: str | None = None
    """Registered name of the actuator; None: the joint is passive."""
    mass: float = 0.2
    """Mass, kg."""
    reach: float = 0.04
    """Distance of the centre of mass below the joint axis, m."""
    inertia: float = 1e-6
    """Inertia about the centre of mass, equal for all axes, kg m^2."""
    length: float = 0.1
    """Distance to the next joint, m."""
    axis: str = "0 1 0"
    damping: float = 0.0
    """Damping of the joint, N m s/rad."""
    friction: float = 0.0
    """Coulomb friction of the joint, N m."""
    limits: str = ""
    """Element `<limit>`. If it is empty, the joint is continuous."""
    prismatic: bool = False
    collision: str = ""
    """Further XML elements of the link."""


def chain(*bodies: Body) -> Robot:
    """Robot that hangs in -z at zero, with the joints `joint_1`, `joint_2`, ..."""
    parts = ['<robot name="chain"><link name="world"/>']
    parent, offset = "world", 0.0
    for index, body in enumerate(bodies, 1):
        kind = "prismatic" if body.prismatic else ("revolute" if body.limits else "continuous")
        spread = f'ixx="{body.inertia!r}" iyy="{body.inertia!r}" izz="{body.inertia!r}" ixy="0" ixz="0" iyz="0"'
        parts.append(
            f'<joint name="joint_{index}" type="{kind}"><origin xyz="0 0 {offset!r}"/><parent link="{parent}"/>'
            f'<child link="link_{index}"/><axis xyz="{body.axis}"/>{body.limits}'
            f'<dynamics damping="{body.damping!r}" friction="{body.friction!r}"/></joint>'
            f'<link name="link_{index}"><inertial><origin xyz="0 0 {-body.reach!r}"/><mass value="{body.mass!r}"/>'
            f"<inertia {spread}/></inertial>{body.collision}</link>"
        )
        if body.actuator:
            parts.append(
                f'<gazebo><plugin name="p{index}" filename="lib{body.actuator}_plugin.so"><joint>joint_{index}</joint>'
                "<operation_mode>3</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state>"
                "<sub_ext_tau>false</sub_ext_tau></plugin></gazebo>"
            )
        parent, offset = f"link_{index}", -body.length
    return read("".join(parts) + "</robot>")


def read(text: str) -> Robot:
    """Robot read from URDF text."""
    with tempfile.TemporaryDirectory(prefix="asrsim-") as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(text, encoding="utf-8")
        return load_robot(path)


def run(
    robot: Robot,
    *,
    mode: int | None = None,
    references: Mapping[str, Any] | None = None,
    joints: Mapping[str, Mapping[str, Any]] | None = None,
    parameters: Mapping[str, float] | None = None,
    external: Mapping[str, Signal] | None = None,
    initial: Sequence[float] = (),
    gravity: float = GRAVITY,
    **fields: Any,
) -> Run:
    """Simulate `robot` through the public interface.

    references: signals or numbers for all joints; joints: signals or numbers by joint; parameters: for all actuators;
    initial: joint positions, rad; gravity: downwards, m/s^2; other keywords: fields of the scenario.
    """
    names = [joint.name for joint in robot.moving_joints]
    signals = {joint: _signals(values) for joint, values in {"*": references or {}, **(joints or {})}.items()}
    if mode is not None:
        fields["modes"] = {"*": mode}
    if parameters:
        fields["parameters"] = {"*": dict(parameters)}
    scenario = Scenario(
        name="check",
        engine=fields.pop("engine", engine()),
        robot=robot.path,
        gravity=(0.0, 0.0, -gravity),
        references=signals,
        external_torques=dict(external or {}),
        initial_positions=dict(zip(names, initial, strict=False)),
        **fields,
    )
    return simulate(scenario, robot)


def _signals(values: Mapping[str, Any]) -> dict[str, Signal]:
    return {name: value if isinstance(value, Signal) else Constant(value=float(value)) for name, value in values.items()}


def column(result: Run, quantity: str, joint: int = 0) -> Any:
    """Values (n,) of a quantity of a joint during a run."""
    if result.samples is None:
        raise ValueError("the run kept no samples")
    return result.samples.values[quantity][:, joint]


LOAD = Body(mass=0.2, reach=0.04, inertia=1e-6)
"""Load of the paper (section 4.1), with a small inertia about its centre of mass, since engines need one."""

SETTINGS: dict[str, tuple[str, float, dict[str, float]]] = {
    "SEA 200": ("sea", 0.0, {"spring_stiffness": 200.0}),
    "SEA 400": ("sea", 0.0, {"spring_stiffness": 400.0}),
    "AwAS-II .005": ("awas_ii", 0.005, {}),
    "AwAS-II .04": ("awas_ii", 0.04, {}),
    "BAVS .001": ("bavs", 0.001, {}),
    "BAVS .22": ("bavs", 0.22, {}),
    "qbMove .2": ("qbmove", 0.2, {}),
    "qbMove .6": ("qbmove", 0.6, {}),
}
"""Eight settings of the paper's figure 8: actuator, stiffness preset, parameters."""
