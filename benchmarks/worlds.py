"""Robots and scenarios that the benchmarks run, as files that every version reads: chains, and humanoids of AlterEgo's size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_BASE = """<link name="base"><inertial><mass value="1"/>
<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_LINK = """<link name="{name}"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
_JOINT = """<joint name="{name}" type="{kind}"><origin xyz="{origin}"/><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/>
<limit lower="{lower}" upper="{upper}" effort="100" velocity="100"/><dynamics friction="{friction}"/></joint>
"""
_PLUGIN = """<gazebo><plugin name="plugin_{i}" filename="lib{actuator}_plugin.so"><joint>joint_{i}</joint>
<operation_mode>6</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>
</plugin></gazebo>
"""


def chain(folder: Path, joints: int, *, actuator: str = "qbmove", friction: float = 0.0) -> Path:
    """A chain of `joints` links that bend and turn in turns, every joint in mode 6."""
    # Long chains are lighter, so that their springs carry them.
    share = min(1.0, 5.0 / joints)
    parts = [_BASE]
    for i in range(joints):
        parts.append(_LINK.format(name=f"link_{i}", centre=0.08 * share, mass=0.5 * share, inertia=1e-3))
        parts.append(
            _JOINT.format(
                name=f"joint_{i}",
                kind="revolute",
                origin=f"0 0 {0.1 * share}",
                parent=f"link_{i - 1}" if i else "base",
                child=f"link_{i}",
                axis="0 0 1" if i % 2 else "0 1 0",
                lower=-3,
                upper=3,
                friction=friction,
            )
        )
        parts.append(_PLUGIN.format(i=i, actuator=actuator))
    return _write(folder / f"chain_{joints}_{actuator}_{friction:g}.urdf", parts)


def humanoid(folder: Path, joints: int, links: int, *, reach: float = 2.0) -> Path:
    """Two arms on a torso with `joints` joints and, with shells fixed to their links, `links` links; friction in every joint.

    reach: rad, of the joints' limits.
    """
    parts, made = [_BASE], 1
    for i in range(joints):
        side = 1 if i % 2 else -1
        parent = f"link_{i - 2}" if i > 1 else "base"
        parts.append(_LINK.format(name=f"link_{i}", centre=-0.05, mass=0.4, inertia=1e-3))
        axis = ("0 1 0", "1 0 0", "0 0 1")[i // 2 % 3]
        parts.append(
            _JOINT.format(
                name=f"joint_{i}",
                kind="revolute",
                origin=f"0 {0.15 * side if i < 2 else 0} -0.08",
                parent=parent,
                child=f"link_{i}",
                axis=axis,
                lower=-reach,
                upper=reach,
                friction=0.05,
            )
        )
        parts.append(_PLUGIN.format(i=i, actuator="qbmove"))
        made += 1
    for k in range(links - made):
        parts.append(_LINK.format(name=f"shell_{k}", centre=0.0, mass=0.05, inertia=1e-5))
        parts.append(
            _JOINT.format(
                name=f"fixed_{k}",
                kind="fixed",
                origin="0 0.02 -0.03",
                parent=f"link_{k % joints}",
                child=f"shell_{k}",
                axis="0 0 1",
                lower=0,
                upper=0,
                friction=0,
            )
        )
    return _write(folder / f"humanoid_{joints}_{reach:g}.urdf", parts)


def _write(path: Path, parts: list[str]) -> Path:
    path.write_text(f'<robot name="benchmark">{"".join(parts)}</robot>', encoding="utf-8")
    return path


def scenario(
    robot: Path,
    *,
    engine: str | None = None,
    compiled: bool | None = True,
    duration: float = 10.0,
    substeps: int | None = 1,
    preset: float | None = 0.2,
    amplitude: float = 0.3,
    offset: float = 0.0,
    gravity: bool = True,
    extra: str = "",
) -> str:
    """A scenario file beside the robot: every motor follows a sine; returns its path. engine: None where 0.1 is to read it."""
    # Angles add up along a chain.
    text = f"""robot: {robot}
duration: {duration}
step: 0.001
gravity: [0, 0, {-9.81 if gravity else 0}]
references:
  "*":
    equilibrium_position: {{sinusoid: {{amplitude: {amplitude}, frequency: 0.5, offset: {offset}}}}}
"""
    text += "" if preset is None else f"    stiffness_preset: {preset}\n"
    text += "" if substeps is None else f"substeps: {substeps}\nmotor_substeps: 1\n"
    text += "" if compiled is None else f"compiled: {str(compiled).lower()}\n"
    text += f"engine: {engine}\n" if engine else ""
    path = robot.with_name(f"{robot.stem}_{abs(hash((text, extra)))}.yaml")
    path.write_text(text + extra, encoding="utf-8")
    return str(path)


class BareBullet:
    """PyBullet's own step of the robot as it is in the file, its motors off."""

    def __init__(self, path: str) -> None:
        from asrsim.scenario import checked_robot, load_scenario

        (loaded,) = load_scenario(path)
        from asrsim.engines.bullet import BulletEngine

        self._engine = BulletEngine(loaded, checked_robot(loaded, None)[0])
        # Frees the joints of Bullet's own motors.
        self._engine.prepare(loaded.step, staggered=False)
        self.step = self._engine._simulate

    def reset(self) -> None:
        """Back to the start."""
        count = len(self._engine.joints)
        self._engine.set_state([0.3] * count, [0.0] * count)

    def close(self) -> None:
        """Disconnect."""
        self._engine.close()


class BareMujoco:
    """mj_step of the same robot, with its joints' friction and limits in MuJoCo's solver."""

    def __init__(self, path: str) -> None:
        import mujoco

        from asrsim.engines.mujoco import MujocoEngine
        from asrsim.scenario import checked_robot, load_scenario

        (loaded,) = load_scenario(path)
        robot = checked_robot(loaded, None)[0]
        engine = MujocoEngine(loaded, robot)
        model: Any = engine.raw_model
        model.dof_frictionloss[engine.model.at_v] = [joint.friction for joint in robot.moving_joints]
        model.jnt_limited[:] = 1
        model.jnt_range[:] = [(joint.lower, joint.upper) for joint in robot.moving_joints]
        self._mujoco, self._data, self._keep = mujoco, mujoco.MjData(model), engine
        self._model = model

    def step(self) -> None:
        """One."""
        self._mujoco.mj_step(self._model, self._data)

    def reset(self) -> None:
        """Back to the start."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = 0.3

    def close(self) -> None:
        """Nothing to release."""


BARE = {"bullet": BareBullet, "mujoco": BareMujoco}
