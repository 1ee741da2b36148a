"""Install `earthmoving_sim`, with colcon as an ament_python package or with pip as a plain one."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "earthmoving_sim"
ROOT = Path(__file__).resolve().parent
SHARE = f"share/{NAME}"


def shared_files(folder: str) -> list[tuple[str, list[str]]]:
    """Every file under a folder, installed in the same subfolder of share/earthmoving_sim."""
    folders: dict[str, list[str]] = {}
    for path in sorted((ROOT / folder).rglob("*")):
        if path.is_file() and not path.name.startswith(".") and path.suffix != ".pyc":
            relative = path.relative_to(ROOT)
            folders.setdefault(f"{SHARE}/{relative.parent.as_posix()}", []).append(
                relative.as_posix()
            )
    return list(folders.items())


setup(
    name=NAME,
    version="0.1.0",
    description="A simulator of construction machines moving soil, for ROS 2",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(
        include=[
            f"{package}{inside}"
            for package in (
                "soil_sim",
                "machine_sim",
                "msg_bridge",
                "dig_operator",
                "teleop",
                "earthmoving_sim",
            )
            for inside in ("", ".*")
        ]
    ),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        *shared_files("config"),
        *shared_files("launch"),
        *shared_files("examples"),
    ],
    # rclpy and the message packages are not listed: they come from a sourced ROS, or else from the
    # ros-jazzy-* wheels in requirements.txt. The second group is from pip only, so package.xml has
    # no rosdep key for it. Exact versions of everything are in constraints.txt.
    install_requires=[
        "numpy",
        "PyYAML",
        "matplotlib",
        "pillow",
        # pip only:
        "pybullet",
        "numba",
        "mcap",
        "rosbags",
        "rasterio",
    ],
    zip_safe=False,
    # The nodes' names are those of `ros2 run earthmoving_sim <name>`.
    entry_points={
        "console_scripts": [
            "earthmoving = earthmoving_sim.cli:main",
            "soil_sim = soil_sim.node.soil_node:main",
            "machine_sim = machine_sim.node.machine_node:main",
            "exchange_recorder = msg_bridge.recorder.recorder_node:main",
            "dig_operator = dig_operator.node:main",
        ]
    },
)
