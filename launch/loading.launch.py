"""Launch a site on which an excavator loads a dumper, which hauls and tips, and a recorder.

    ros2 launch earthmoving_sim loading.launch.py

Arguments: those of `soil.launch.py`, and `loads:=5`; `digger:=false` or `hauler:=false` leave that
machine to you.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = "earthmoving_sim"


def parameters(name: str) -> PathJoinSubstitution:
    """Return the shipped parameter file of a node."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), "config", f"{name}.yaml"])


def operator(machine: str, task: str, condition: str) -> Node:
    """Return the operator of a machine of the site.

    Args:
        machine: name of the machine.
        task: prefix of the parameters of its task.
        condition: launch argument that switches it on.
    """
    loads = ParameterValue(LaunchConfiguration("loads"), value_type=int)
    return Node(
        package=PACKAGE,
        executable="dig_operator",
        namespace=f"/site/{machine}",
        parameters=[parameters("site_operators"), {f"{task}.loads": loads}],
        condition=IfCondition(LaunchConfiguration(condition)),
        output="screen",
    )


def include(name: str) -> IncludeLaunchDescription:
    """Return the action that includes a shipped launch file, with the arguments given to this."""
    path = PathJoinSubstitution([FindPackageShare(PACKAGE), "launch", f"{name}.launch.py"])
    return IncludeLaunchDescription(PythonLaunchDescriptionSource([path]))


def generate_launch_description() -> LaunchDescription:
    """Return the launch description for `ros2 launch`."""
    arguments = {
        "loads": "2",
        "digger": "true",
        "hauler": "true",
    }
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
                namespace="/site",
                parameters=[parameters("site_machines")],
                output="screen",
            ),
            operator("digger", "task", "digger"),
            operator("truck", "haul", "hauler"),
        ]
    )
