"""A peer on Cyclone DDS receives the topics of the nodes and drives a machine.

The peer is `cyclone_peer.py`, a process without rclpy and without code of this package.
"""

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from machine_sim.node.machine_node import MachineNode
from msg_bridge.contract.grid import Grid
from soil_sim.node.soil_node import SoilNode
from soil_sim.terrain import HeightMap, save_terrain

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None,
    reason="cyclonedds is not installed (it has wheels for x86_64 only)",
)

PEER = Path(__file__).with_name("cyclone_peer.py")
TIMEOUT = 240.0  # s; the peer waits up to 30 s for each condition, and prints which was not met
SPEED, TRAVEL = 0.2, 0.1  # velocity [rad/s] and travel [rad] of the boom, as in the peer

# Packages that the peer must not import.
OWN = {"earthmoving_sim", "machine_sim", "msg_bridge", "soil_sim"}
ROS = {"builtin_interfaces", "rclpy", "rosidl_runtime_py", "sensor_msgs", "std_msgs"}

UINT32, FLOAT32, FLOAT64 = 6, 7, 8  # values of PointField.datatype


@pytest.fixture
def site() -> HeightMap:
    """Return nearly flat ground on which every cell has a different height.

    Its map message is more than twice as large as the largest UDP packet.
    """
    grid = Grid(65, 67, 0.4)
    number = np.arange(grid.rows * grid.cols).reshape(grid.shape)
    return HeightMap(grid, 0.25 + 1e-5 * number)


def test_peer_on_another_dds_receives_topics_and_drives_the_machine(
    ros, ros_process, site, tmp_path
) -> None:
    save_terrain(tmp_path / "site.npz", site)
    soil = ros.add(
        SoilNode,
        parameters={"site.terrain": str(tmp_path / "site.npz"), "machine_timeout": 30.0},
    )
    ros.add(MachineNode)
    ros.spin_until(lambda: soil.run.tick >= 10)  # the map was published before the first
    peer = ros_process([sys.executable, "-I", PEER, str(ros.domain)])
    ros.spin_until(lambda: re.search(r"^REPORT .*\n", peer.output, re.MULTILINE), TIMEOUT)
    peer.stop()
    report = json.loads(peer.output.partition("REPORT ")[2])

    assert not {*report["modules"]} & (OWN | ROS)
    check_time(report)
    check_joints(report)
    check_ledger(report, soil.run.endpoint.soil.columns.total_mm3)
    check_map(report["map"], site, soil.run.endpoint.soil.columns.total_mm3)
    check_motion(report["front"], SPEED)
    check_motion(report["joints"], -SPEED)
    check_rejection(report)


def check_time(report) -> None:
    clock = report["clock"]
    assert clock[0] > 0.0
    assert clock[-1] > clock[0]
    # A tick may be published twice while time stands still.
    assert (np.diff(clock) >= 0.0).all()


def check_joints(report) -> None:
    states = report["joint_states"]
    virtual = [f"base_{name}" for name in ("x", "y", "z", "yaw", "pitch", "roll")]
    assert states["names"][:4] == ["swing", "boom", "arm", "bucket"]
    assert states["names"][-6:] == virtual
    assert states["sizes"] == 3 * [len(states["names"])]
    assert report["finite"]


def check_ledger(report, terrain_mm3: int) -> None:
    ledger = report["ledger"]
    accounts = ["terrain", "in_flight", "pending", "particles", "absent", "outside"]
    stamp = ["stamp_sec", "stamp_nanosec"]
    assert list(ledger) == ["kind", "run_id", "tick", *accounts, "start", *stamp, "imbalance"]
    assert ledger["terrain"] == terrain_mm3
    assert sum(ledger[account] for account in accounts) == ledger["start"]
    assert report["imbalances"] == [0]  # in every ledger received
    ticks = report["ledger_ticks"]
    assert ledger["tick"] > ticks[0] >= 0
    assert ticks == sorted(ticks)


def check_map(found, site: HeightMap, terrain_mm3: int) -> None:
    """Assert that the map that the peer decoded is the site, with the soil volume of the ledger."""
    rows, cols = site.grid.shape
    assert found["shape"] == [rows, cols]
    assert found["frame_id"] == "map"
    assert found["stamp"] == [0, 0]  # published before the first tick
    assert found["fields"] == [
        ["x", 0, FLOAT32, 1],
        ["y", 4, FLOAT32, 1],
        ["z", 8, FLOAT32, 1],
        ["loose_depth", 12, FLOAT32, 1],
        ["surface_material", 16, FLOAT32, 1],
        ["moisture", 20, FLOAT32, 1],
        ["soil", 24, FLOAT32, 1],
        ["design_difference", 28, FLOAT32, 1],
        ["volume_mm3", 32, FLOAT64, 1],
        ["rut_depth", 40, FLOAT32, 1],
        ["revision", 44, UINT32, 1],
        ["run_id", 48, UINT32, 1],
    ]
    assert found["bytes"] == [52, 52 * cols, 52 * cols * rows]  # of a point, a row, all
    assert len(found["sample"]) > 40
    # Index (0, 0) is the +x, +y corner.
    expected = [
        [row, col, 0.4 * (32 - row), 0.4 * (33 - col), site.heights[row, col]]
        for row, col, *_ in found["sample"]
    ]
    np.testing.assert_allclose(found["sample"], expected, rtol=0.0, atol=1e-6)
    assert found["mm3"] == terrain_mm3


def boom_at(speed: float) -> list[float]:
    """Return an applied command: joints, then tracks."""
    return [0.0, speed, 0.0, 0.0, 0.0, 0.0]


def check_motion(found, speed: float) -> None:
    """Assert that the boom moved as commanded, and nothing else."""
    assert found["applied_names"] == ["swing", "boom", "arm", "bucket", "left_track", "right_track"]
    assert boom_at(speed) in found["applied"]
    # The previous command applies until the new one arrives.
    expected = [boom_at(each) for each in (0.0, SPEED, -SPEED)]
    assert [each for each in found["applied"] if each not in expected] == []
    assert np.sign(speed) * found["moved"]["boom"] >= TRAVEL
    assert found["speed"] == pytest.approx(speed, rel=0.02)
    others = [found["moved"][joint] for joint in ("swing", "arm", "bucket", "base_x", "base_y")]
    assert np.abs(others).max() < 0.01


def check_rejection(report) -> None:
    """Assert that the command with NaN was rejected as a whole, with its reason in diagnostics."""
    assert report["rejection_before"] is None
    rejection = report["rejection"]
    assert rejection["name"] == "excavator/machine_sim: machine_sim"
    assert rejection["level"] == 1  # WARN
    assert rejection["message"] == "messages rejected on front_velocity_controller/commands"
    key = "rejected front_velocity_controller/commands"
    assert int(rejection["values"][key]) >= 1
    assert "not finite" in rejection["values"][f"last {key}"]
    # The last valid command applies until its timeout.
    expected = [boom_at(-SPEED), boom_at(0.0)]
    assert [each for each in report["applied_after_nan"] if each not in expected] == []
