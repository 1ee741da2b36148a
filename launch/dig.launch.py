"""Soil, one excavator, the scripted operator and a recorder.

    ros2 launch earthmoving_sim dig.launch.py

Arguments: `sync:=lockstep`, `operator:=false` (you drive), `record:=false`, `terrain:=FILE`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "earthmoving_sim"


def parameters(name: str) -> PathJoinSubstitution:
    """The shipped parameter file of a node."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), "config", f"{name}.yaml"])


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    arguments = {"sync": "realtime", "operator": "true", "record": "true", "terrain": "rough"}
    soil = {"sync": LaunchConfiguration("sync"), "site.terrain": LaunchConfiguration("terrain")}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value)
                for name, value in arguments.items()
            ),
            Node(
                package=PACKAGE,
                executable="recorder",
                parameters=[parameters("recorder")],
                condition=IfCondition(LaunchConfiguration("record")),
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="soil_sim",
                parameters=[parameters("soil_sim"), soil],
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="machine_sim",
                namespace="/excavator",
                parameters=[parameters("machine_sim")],
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="operator",
                namespace="/excavator",
                parameters=[parameters("operator")],
                condition=IfCondition(LaunchConfiguration("operator")),
                output="screen",
            ),
        ]
    )
