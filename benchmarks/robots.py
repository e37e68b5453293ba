"""Robots and scenarios that the benchmarks run, written as files: chains, and humanoids of AlterEgo's size."""

from __future__ import annotations

from pathlib import Path

_BASE = """<link name="base"><inertial><mass value="1"/>
<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_LINK = """<link name="{name}"><inertial><origin xyz="0 0 {centre}"/><mass value="{mass}"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
_JOINT = """<joint name="{name}" type="{kind}"><origin xyz="{origin}"/><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/>
<limit lower="-{reach}" upper="{reach}" effort="100" velocity="100"/><dynamics friction="{friction}"/></joint>
"""
_PLUGIN = """<gazebo><plugin name="plugin_{i}" filename="libqbmove_plugin.so"><joint>joint_{i}</joint>
<operation_mode>6</operation_mode><pub_eltau>true</pub_eltau><pub_state>true</pub_state><sub_ext_tau>false</sub_ext_tau>
</plugin></gazebo>
"""


def chain(folder: Path, joints: int, *, friction: float = 0.0) -> Path:
    """Write a chain of `joints` links with qbMoves in mode 6; the axes alternate between bending and twisting."""
    # Links of long chains are lighter, so that the springs can carry the chain.
    share = min(1.0, 5.0 / joints)
    parts = [_BASE]
    for i in range(joints):
        parts.append(_LINK.format(name=f"link_{i}", centre=0.08 * share, mass=0.5 * share, inertia=1e-3))
        parts.append(_joint(i, f"0 0 {0.1 * share}", i - 1, "0 0 1" if i % 2 else "0 1 0", 3.0, friction))
    return _write(folder / f"chain_{joints}_{friction:g}.urdf", parts)


def humanoid(folder: Path, joints: int, links: int, *, reach: float = 2.0) -> Path:
    """Write a torso with two arms. Extra links are fixed to the moving links as shells.

    joints: number of joints, all with friction; links: total number of links; reach: position limit of the joints in both
    directions, rad.
    """
    parts = [_BASE]
    for i in range(joints):
        parts.append(_LINK.format(name=f"link_{i}", centre=-0.05, mass=0.4, inertia=1e-3))
        side = (-0.15, 0.15)[i % 2] if i < 2 else 0
        parts.append(_joint(i, f"0 {side} -0.08", i - 2, ("0 1 0", "1 0 0", "0 0 1")[i // 2 % 3], reach, 0.05))
    for k in range(links - joints - 1):
        parts.append(_LINK.format(name=f"shell_{k}", centre=0.0, mass=0.05, inertia=1e-5))
        ends = {"parent": f"link_{k % joints}", "child": f"shell_{k}", "origin": "0 0.02 -0.03", "axis": "0 0 1"}
        parts.append(_JOINT.format(name=f"fixed_{k}", kind="fixed", reach=0, friction=0, **ends))
    return _write(folder / f"humanoid_{joints}_{reach:g}.urdf", parts)


def _joint(i: int, origin: str, parent: int, axis: str, reach: float, friction: float) -> str:
    ends = {"parent": f"link_{parent}" if parent >= 0 else "base", "child": f"link_{i}", "origin": origin, "axis": axis}
    return _JOINT.format(name=f"joint_{i}", kind="revolute", reach=reach, friction=friction, **ends) + _PLUGIN.format(i=i)


def _write(path: Path, parts: list[str]) -> Path:
    path.write_text(f'<robot name="benchmark">{"".join(parts)}</robot>', encoding="utf-8")
    return path


def scenario(
    robot: Path,
    *,
    engine: str = "mujoco",
    duration: float = 10.0,
    substeps: int | None = 1,
    amplitude: float = 0.3,
    extra: str = "",
) -> str:
    """Write a scenario next to the robot file, in which every motor follows a sine. substeps: None: as many as
    the springs need; extra: additional lines of YAML."""
    text = f"""robot: {robot}
duration: {duration}
step: 0.001
engine: {engine}
substeps: {"auto" if substeps is None else substeps}
motor_substeps: 1
references:
  "*":
    equilibrium_position: {{sinusoid: {{amplitude: {amplitude}, frequency: 0.5}}}}
    stiffness_preset: 0.2
{extra}"""
    path = robot.with_name(f"{robot.stem}_{abs(hash(text))}.yaml")
    path.write_text(text, encoding="utf-8")
    return str(path)
