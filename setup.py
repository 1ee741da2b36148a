"""Install `earthmoving_sim`, with colcon as an ament_python package or with pip as a plain one."""

import os
import runpy
import sys
from pathlib import Path

from setuptools import Command, find_packages, setup
from setuptools.command.build import build

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


class BuildWithPage(build):
    """Build the live page before the Python packages, which contain it as data."""

    sub_commands = [("build_page", None), *build.sub_commands]  # noqa: RUF012


class BuildPage(Command):
    """Build the live page with npm.

    Without npm the package is installed without the page, and the viewer reports how to build it;
    with EARTHMOVING_REQUIRE_PAGE set that is an error.
    """

    user_options = []  # noqa: RUF012
    editable_mode = False  # set by setuptools

    def initialize_options(self) -> None:
        """Do nothing: there are no options."""

    def finalize_options(self) -> None:
        """Do nothing: there are no options."""

    def run(self) -> None:
        """Build the page if it is out of date."""
        script = runpy.run_path(str(ROOT / "viewer/page/build_page.py"))
        try:
            script["build_page"]()
        except script["PageBuildError"] as error:
            if os.environ.get("EARTHMOVING_REQUIRE_PAGE"):
                sys.exit(f"setup.py: {error}")
            self.warn(f"the live page is not built: {error}")

    def get_outputs(self) -> list[str]:
        """Return nothing: the page's files are data of the package `viewer`."""
        return []

    def get_output_mapping(self) -> dict[str, str]:
        """Return nothing, as `get_outputs`."""
        return {}

    def get_source_files(self) -> list[str]:
        """Return what the page is made from."""
        page = Path("viewer/page")
        fixed = ("package.json", "package-lock.json", "build.mjs", "tsconfig.json", "index.html")
        sources = [*(page / name for name in fixed), page / "build_page.py"]
        sources += [*page.glob("styles/*.css"), *page.glob("src/**/*.ts")]
        return [str(path) for path in sources]


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
                "viewer",
                "earthmoving_sim",
            )
            for inside in ("", ".*")
        ]
    ),
    package_data={"viewer": ["page/dist/*"]},
    cmdclass={"build": BuildWithPage, "build_page": BuildPage},
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
        "aiohttp",
        "msgpack",
        # pip only:
        "pybullet",
        "numba",
        "mcap",
        "rosbags",
        "rasterio",
        "mapbox_earcut",
        "pyarrow",
    ],
    extras_require={"foxglove": ["foxglove-sdk"]},  # for foxglove_server; make setup installs it
    zip_safe=False,
    # The nodes' names are those of `ros2 run earthmoving_sim <name>`.
    entry_points={
        "console_scripts": [
            "earthmoving = earthmoving_sim.cli:main",
            "soil_sim = soil_sim.node.soil_node:main",
            "machine_sim = machine_sim.node.machine_node:main",
            "exchange_recorder = msg_bridge.recorder.recorder_node:main",
            "foxglove_server = msg_bridge.foxglove_server.node:main",
            "dig_operator = dig_operator.node:main",
            "viewer = viewer.node:main",
            "camera = viewer.cameras.node:main",
        ]
    },
)
