"""Robots and scenarios that the benchmarks run: chains of links with qbMove actuators, every motor following a sine."""

from __future__ import annotations

from pathlib import Path

from asrsim.engines.bullet import BulletEngine
from asrsim.robot import engine_urdf, load_robot
from asrsim.robot.model import Robot
from asrsim.scenario import Scenario
from asrsim.signals import Constant, Sinusoid
from asrsim.signals.base import Signal

STEP = 1e-3
"""s."""

_BASE = """<link name="base"><inertial><mass value="1"/>
<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_LINK = """<link name="link_{i}"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint_{i}" type="revolute"><origin xyz="0 0 {length}"/><parent link="{parent}"/><child link="link_{i}"/>
<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="100" velocity="100"/></joint>"""
_PLUGIN = """<gazebo><plugin name="plugin_{i}" filename="lib{actuator}_plugin.so"><joint>joint_{i}</joint>
<operation_mode>6</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>
</plugin></gazebo>"""


def chain(folder: Path, joints: int, actuator: str = "qbmove") -> Robot:
    """A chain of `joints` links that bend and turn in turns, every joint in mode 6; written to and loaded from `folder`."""
    # Long chains are lighter, so that their springs carry them.
    share = min(1.0, 5.0 / joints)
    links = "".join(
        _LINK.format(
            i=i,
            parent=f"link_{i - 1}" if i else "base",
            axis="0 0 1" if i % 2 else "0 1 0",
            length=0.1 * share,
            centre=0.08 * share,
            mass=0.5 * share,
            inertia=1e-3,
        )
        for i in range(joints)
    )
    plugins = "".join(_PLUGIN.format(i=i, actuator=actuator) for i in range(joints))
    path = folder / f"chain_{joints}.urdf"
    path.write_text(f'<robot name="chain">{_BASE}{links}{plugins}</robot>', encoding="utf-8")
    return load_robot(path)


def scenario(
    robot: Robot,
    *,
    duration: float,
    compiled: bool | None = False,
    substeps: int | None = 1,
    motor_substeps: int | None = 1,
    stiffness: float | None = None,
    gravity: bool = True,
) -> Scenario:
    """All joints on a sine, nothing else but the defaults; stiffness: of SEAs' springs, N m/rad (None: qbMoves)."""
    # Angles add up along a chain.
    amplitude = 0.3 * min(1.0, 5.0 / len(robot.moving_joints))
    references: dict[str, Signal] = {"equilibrium_position": Sinusoid(amplitude=amplitude, frequency=0.5)}
    if stiffness is None:
        references["stiffness_preset"] = Constant(value=0.2)
    return Scenario(
        name="benchmark",
        robot=Path(robot.path),
        duration=duration,
        step=STEP,
        substeps=substeps,
        motor_substeps=motor_substeps,
        compiled=compiled,
        references={"*": references},
        gravity=(0.0, 0.0, -9.81 if gravity else 0.0),
        parameters={} if stiffness is None else {"*": {"spring_stiffness": stiffness}},
    )


class BareWorld:
    """The same world without springs: the joints swing free, their own motors off."""

    def __init__(self, robot: Robot, *, step: float = STEP) -> None:
        urdf, _ = engine_urdf(robot, visuals=False, package_paths={})
        self.engine = BulletEngine(robot, urdf, step=step)

    def reset(self) -> None:
        """Back to the start. Now and then: joints that have swung to their limits cost more, which would flatter us."""
        engine = self.engine
        for index in engine._indices:
            engine._p.resetJointState(engine._body, index, 0.3, 0.0, physicsClientId=engine._client)
