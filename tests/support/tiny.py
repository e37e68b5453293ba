"""Pendulum with one SEA, and a scenario with a step."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

PENDULUM = """<?xml version="1.0"?>
<robot name="pendulum">
  <link name="world"/>
  <joint name="elbow" type="revolute">
    <parent link="world"/>
    <child link="arm"/>
    <axis xyz="0 1 0"/>
    <limit effort="50" velocity="100" lower="-3" upper="3"/>
    <dynamics damping="0.2" friction="0"/>
  </joint>
  <link name="arm">
    <inertial>
      <origin xyz="0 0 -0.1"/>
      <mass value="0.5"/>
      <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial>
  </link>
  <gazebo>
    <plugin name="elbow_drive" filename="libsea_plugin.so">
      <joint>elbow</joint>
      <operation_mode>3</operation_mode>
      <pub_eltau>true</pub_eltau>
      <pub_state>true</pub_state>
      <sub_ext_tau>false</sub_ext_tau>
      <spring_k>10</spring_k>
    </plugin>
  </gazebo>
</robot>
"""
"""URDF of one joint with an SEA of 10 N m/rad: I = 6e-3 kg m^2, 0.5 kg at 0.1 m; at zero, the link hangs down."""

SCENARIO = """\
robot: pendulum.urdf
duration: 1.5
references:
  elbow:
    equilibrium_position: {step: {at: 0.1, to: 0.5}}
"""


@dataclass(frozen=True)
class Tiny:
    """Folder with a robot and a scenario."""

    folder: Path
    robot: Path
    scenario: Path
