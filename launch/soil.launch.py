"""Launch the soil and a recorder; other launch files include this one.

    ros2 launch earthmoving_sim soil.launch.py

Arguments: `sync:=lockstep`, `record:=false`, `terrain:=FILE`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "earthmoving_sim"


def parameters(name: str) -> PathJoinSubstitution:
    """Return the shipped parameter file of a node."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), "config", f"{name}.yaml"])


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    arguments = {"sync": "realtime", "record": "true", "terrain": "rough"}
    soil = {"sync": LaunchConfiguration("sync"), "site.terrain": LaunchConfiguration("terrain")}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value)
                for name, value in arguments.items()
            ),
            Node(
                package=PACKAGE,
                executable="exchange_recorder",
                parameters=[parameters("exchange_recorder")],
                condition=IfCondition(LaunchConfiguration("record")),
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="soil_sim",
                namespace="/",
                parameters=[parameters("soil_sim"), soil],
                output="screen",
            ),
        ]
    )
