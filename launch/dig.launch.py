"""Launch the soil, one excavator or the machines of a file, the scripted operator and a recorder.

    ros2 launch earthmoving_sim dig.launch.py

Arguments: those of `soil.launch.py`, and `operator:=false` (drive yourself); with another machine
file also the namespace of its node, and that of the operated machine:

    ros2 launch earthmoving_sim dig.launch.py \\
        machines:=config/site_machines.yaml namespace:=/site operated_machine:=/site/digger
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "earthmoving_sim"
SIMULATION_NAMESPACE = "/"
"""Namespace of the soil node; machine nodes are one level below it."""


def parameters(name: str) -> PathJoinSubstitution:
    """Return the shipped parameter file of a node."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), "config", f"{name}.yaml"])


def include(name: str) -> IncludeLaunchDescription:
    """Return the action that includes a shipped launch file, with the arguments given to this."""
    path = PathJoinSubstitution([FindPackageShare(PACKAGE), "launch", f"{name}.launch.py"])
    return IncludeLaunchDescription(PythonLaunchDescriptionSource([path]))


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    arguments = {
        "operator": "true",
        "machines": parameters("machine_sim"),
        "namespace": "/excavator",
        "operated_machine": LaunchConfiguration("namespace"),
    }
    # An operator looks for the soil one level above its machine, which for a machine of a node with
    # several, such as /site/digger, is the namespace of the node.
    operator = {"simulation_namespace": SIMULATION_NAMESPACE}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value)
                for name, value in arguments.items()
            ),
            include("soil"),
            Node(
                package=PACKAGE,
                executable="machine_sim",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("machines")],
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="dig_operator",
                namespace=LaunchConfiguration("operated_machine"),
                parameters=[parameters("dig_operator"), operator],
                condition=IfCondition(LaunchConfiguration("operator")),
                output="screen",
            ),
        ]
    )
