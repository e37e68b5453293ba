"""Starts a live run with robot_state_publisher and RViz. Use this file in a shell with ROS 2:

    ros2 launch ros/live.launch.py scenario:=arm.yaml robot:=arm.urdf asrsim:=/path/to/venv/bin/asrsim

asrsim runs in its own environment, without the sourced ROS. robot_state_publisher computes /tf from /joint_states.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import Command, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "scenario": ("scenario file", None),
    "robot": ("URDF or xacro file of the scenario's robot", None),
    "asrsim": ("the command of asrsim's environment", "asrsim"),
    "speed": ("simulated seconds per second of wall time", "1"),
    "rviz": ("start RViz", "true"),
}
FOREIGN = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "RMW_IMPLEMENTATION")


def generate_launch_description():
    """Called by `ros2 launch`."""
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    clean = [word for name in FOREIGN for word in ("-u", name)]
    live = [value["asrsim"], "live", value["scenario"], "--on", "ros", "--speed", value["speed"]]
    description = ParameterValue(Command(["xacro ", value["robot"]]), value_type=str)
    return LaunchDescription([
        *(DeclareLaunchArgument(name, description=text, default_value=default) for name, (text, default) in ARGUMENTS.items()),
        ExecuteProcess(cmd=["env", *clean, *live], output="screen", sigterm_timeout="10"),
        Node(
            package="robot_state_publisher", executable="robot_state_publisher",
            parameters=[{"robot_description": description}], remappings=[("robot_description", "robot_description_tf")],
        ),
        Node(package="rviz2", executable="rviz2", condition=IfCondition(value["rviz"])),
    ])  # fmt: skip
