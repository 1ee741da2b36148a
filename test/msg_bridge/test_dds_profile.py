"""Messages cross DDS between two participants, and a shipped profile is the one in effect."""

import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray, String

from msg_bridge import dds_profile
from msg_bridge.codec import qos
from msg_bridge.codec.row_chunks import from_chunk_cloud, to_chunk_cloud
from msg_bridge.codec.terrain import TerrainMap, from_terrain_cloud, to_terrain_cloud
from msg_bridge.codec.tick_headers import (
    from_join_rejected_string,
    from_multi_array,
    to_join_rejected_string,
    to_multi_array,
)
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    MachineHeader,
    MachineReceipt,
    RetransmitRequest,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import CONVERSION
from msg_bridge.dds_profile import (
    PROFILE_VARIABLE,
    keep_discovery_on_this_host,
    use_shipped_profile,
)
from msg_bridge.exchange.chunks import split_into_chunks
from msg_bridge.testing.fixtures import limit_discovery_to_this_host

DOMAIN = 1 + os.getpid() % 101  # differs between processes; its ports are below the ephemeral ones
TIMEOUT = 20.0  # [s]
STAMP = Time(sec=1)

# Limits discovery to this host after a participant existed; prints the profile and the range.
LATE = """\
import os, sys
from msg_bridge.dds_profile import keep_discovery_on_this_host, use_shipped_profile
if sys.argv[1] == "shipped":
    use_shipped_profile()
import rclpy
rclpy.init(domain_id=int(sys.argv[2]))
rclpy.create_node("former").destroy_node()
rclpy.shutdown()
os.environ.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
keep_discovery_on_this_host()
print(use_shipped_profile(), os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"])
"""

# Creates a participant; prints its shared memory files and the addresses of its UDP sockets.
PARTICIPANT = """\
import os, socket, sys
from pathlib import Path
from msg_bridge.dds_profile import use_shipped_profile
if sys.argv[1] == "shipped":
    use_shipped_profile()
import rclpy
rclpy.init(domain_id=int(sys.argv[2]))
node = rclpy.create_node("participant")
mapped = {line.split()[-1] for line in Path("/proc/self/maps").read_text().splitlines()}
print("shared_memory", *(path for path in mapped if path.startswith("/dev/shm/fastrtps_")))
own = {os.readlink(f"/proc/self/fd/{fd}") for fd in os.listdir("/proc/self/fd")
       if os.path.islink(f"/proc/self/fd/{fd}")}
rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
addresses = {bytes.fromhex(row[1][:8])[::-1] for row in rows if f"socket:[{row[9]}]" in own}
print("udp", *(socket.inet_ntoa(address) for address in sorted(addresses)))
rclpy.shutdown()
"""


@pytest.fixture
def no_profile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove the choice of a DDS profile for the test, as in a new process."""
    monkeypatch.setenv(PROFILE_VARIABLE, "")
    monkeypatch.delenv(PROFILE_VARIABLE)
    monkeypatch.setattr(dds_profile, "_profile_in_use", None)


@pytest.fixture
def no_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove the choice of a range of discovery for the test."""
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS"):
        monkeypatch.setenv(name, "")  # so that the test's changes are undone
        monkeypatch.delenv(name)


class Participant:
    """Node in a separate DDS participant."""

    def __init__(self, name: str) -> None:
        self._context = Context()
        rclpy.init(
            context=self._context,
            domain_id=DOMAIN,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.node = Node(name, context=self._context, namespace=f"test_{os.getpid()}")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin_until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + TIMEOUT
        while not condition():
            assert time.monotonic() < deadline, "the messages were not received"
            self._executor.spin_once(timeout_sec=0.05)

    def subscribe(self, of: type, topic: str, profile: Any) -> list[Any]:
        """Return a list to which received messages are appended."""
        received: list[Any] = []
        self.node.create_subscription(of, topic, received.append, profile)
        return received

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def participants() -> Iterator[tuple[Participant, Participant]]:
    with pytest.MonkeyPatch.context() as patch:
        limit_discovery_to_this_host(patch)
        yield from _participants()


def _participants() -> Iterator[tuple[Participant, Participant]]:
    sender, receiver = Participant("sender"), Participant("receiver")
    yield sender, receiver
    sender.close()
    receiver.close()


def send(sender: Participant, topic: str, messages: list[Any], profile: Any) -> None:
    """Publish messages once there is a subscription."""
    publisher = sender.node.create_publisher(type(messages[0]), topic, profile)
    sender.spin_until(lambda: publisher.get_subscription_count() > 0)
    for message in messages:
        publisher.publish(message)


def test_rows_are_transmitted_unchanged(participants: tuple[Participant, Participant]) -> None:
    sender, receiver = participants
    raw = np.random.default_rng(1).integers(0, 256, 50_000 * CONVERSION.itemsize, dtype=np.uint8)
    rows = raw.view(CONVERSION)
    clouds = [
        to_chunk_cloud(c, "map", STAMP) for c in split_into_chunks(3, Stream.CONVERSION, rows)
    ]
    received = receiver.subscribe(PointCloud2, "conversions", qos.ROWS)
    send(sender, "conversions", clouds, qos.ROWS)
    receiver.spin_until(lambda: len(received) == len(clouds))
    chunks = [from_chunk_cloud(msg, Stream.CONVERSION) for msg in received]
    assert np.concatenate([chunk.rows for chunk in chunks]).tobytes() == rows.tobytes()
    assert {chunk.run_id for chunk in chunks} == {3}
    assert {msg.header.frame_id for msg in received} == {"map"}


def test_one_topic_carries_headers_requests_and_ledger(
    participants: tuple[Participant, Participant],
) -> None:
    sender, receiver = participants
    span = RowRange(2**62, 3)
    words = [
        MachineHeader(1, 2, 3, 4, Verb.STEP, span, span, -1, 2**63 - 1, -(2**63), 5),
        SoilHeader(1, 4, 9, span, span, span, (MachineReceipt(2, 3, 4, 5, 6),) * 2),
        RetransmitRequest(1, 2, 3, Stream.DEPOSIT_REQUEST, 7, 8),
        Ledger(1, 4, 10, -20, 30, 40, 50, 60, 170),
    ]
    received = receiver.subscribe(Int64MultiArray, "tick", qos.ROWS)
    send(sender, "tick", [to_multi_array(word) for word in words], qos.ROWS)
    receiver.spin_until(lambda: len(received) == len(words))
    assert [from_multi_array(msg) for msg in received] == words


def test_rejection_is_transmitted(participants: tuple[Participant, Participant]) -> None:
    sender, receiver = participants
    rejection = JoinRejected(1, 2, 3, "5 mm³ too many; join empty")
    received = receiver.subscribe(String, "join_rejections", qos.ROWS)
    send(sender, "join_rejections", [to_join_rejected_string(rejection)], qos.ROWS)
    receiver.spin_until(lambda: bool(received))
    assert from_join_rejected_string(received[0]) == rejection


def test_late_subscriber_gets_the_latest_terrain(
    participants: tuple[Participant, Participant],
) -> None:
    sender, receiver = participants
    grid = Grid(129, 65, 0.2)
    heights = np.arange(129.0 * 65).reshape(grid.shape)
    volume = np.arange(129 * 65).reshape(grid.shape)
    publisher = sender.node.create_publisher(PointCloud2, "map", qos.TRANSIENT_LOCAL)
    for revision in (6, 7):
        terrain = TerrainMap(Keyframe(1, revision, grid, heights, volume), 0.5 * heights)
        publisher.publish(to_terrain_cloud(terrain, "map", STAMP))
    received = receiver.subscribe(PointCloud2, "map", qos.TRANSIENT_LOCAL)
    receiver.spin_until(lambda: bool(received))
    back = from_terrain_cloud(received[0])
    assert (back.keyframe.revision, back.keyframe.grid) == (7, grid)
    assert np.array_equal(back.keyframe.elevation, heights)
    assert np.array_equal(back.volume_mm3, volume)


def test_commands_are_received_from_any_publisher(
    participants: tuple[Participant, Participant],
) -> None:
    sender, receiver = participants
    for name, profile in (("reliable", qos.STATE), ("best_effort", qos.COMMANDS)):
        received = receiver.subscribe(String, name, qos.COMMANDS)
        publisher = sender.node.create_publisher(String, name, profile)

        def came(publisher: Any = publisher, received: list[Any] = received) -> bool:
            publisher.publish(String(data="renewed"))
            return bool(received)

        receiver.spin_until(came)


@pytest.mark.parametrize(
    ("chosen", "profile", "range_after"),
    [
        ({}, "fastdds.xml", None),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "fastdds.xml", "SUBNET"),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
            "fastdds_localhost.xml",
            "SYSTEM_DEFAULT",
        ),
        ({"ROS_LOCALHOST_ONLY": "1"}, "fastdds_localhost.xml", "SYSTEM_DEFAULT"),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.7"},
            "fastdds.xml",
            "LOCALHOST",
        ),
    ],
)
def test_shipped_profile_follows_the_range_of_discovery(
    no_profile: None,
    no_range: None,
    monkeypatch: pytest.MonkeyPatch,
    chosen: dict[str, str],
    profile: str,
    range_after: str | None,
) -> None:
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    assert use_shipped_profile() == find_config(profile).resolve()
    assert Path(os.environ[PROFILE_VARIABLE]) == find_config(profile).resolve()
    assert os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == range_after
    assert "ROS_LOCALHOST_ONLY" not in os.environ


@pytest.mark.parametrize("own", ["/home/me/own.xml", ""])
def test_profile_of_the_user_is_kept(monkeypatch: pytest.MonkeyPatch, own: str) -> None:
    monkeypatch.setenv(PROFILE_VARIABLE, own)
    assert use_shipped_profile() is None
    assert os.environ[PROFILE_VARIABLE] == own


def test_shipped_profiles_differ_only_in_what_limits_discovery_to_this_host() -> None:
    everywhere, localhost = (
        ET.parse(find_config(name)).getroot() for name in ("fastdds.xml", "fastdds_localhost.xml")
    )
    only_localhost = {
        "transport_descriptor": ("maxInitialPeersRange", "interfaceWhiteList"),
        "builtin": ("metatrafficUnicastLocatorList", "initialPeersList"),
    }
    for parent, children in only_localhost.items():
        (element,) = localhost.iterfind(f".//{{*}}{parent}")
        for child in children:
            (added,) = element.findall(f"{{*}}{child}")
            element.remove(added)
    texts = [ET.canonicalize(ET.tostring(e), strip_text=True) for e in (everywhere, localhost)]
    assert texts[0] == texts[1]
    (participant,) = everywhere.findall("{*}participant")
    assert participant.get("is_default_profile") == "true"


@pytest.mark.skipif("fastrtps" not in get_rmw_implementation_identifier(), reason="for Fast DDS")
@pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="looks at sockets and memory map")
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
@pytest.mark.parametrize("profile", ["shipped", "none"])
def test_participant_uses_no_shared_memory_and_the_chosen_range(
    no_profile: None,
    no_range: None,
    monkeypatch: pytest.MonkeyPatch,
    profile: str,
    discovery: str,
) -> None:
    """A suspended reader in shared memory stalls its publishers for 2 s (Fast DDS 2.14)."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", discovery)
    command = [sys.executable, "-c", PARTICIPANT, profile, str(DOMAIN)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "XMLPARSER" not in done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    values = {words[0]: words[1:] for words in lines if words}
    assert bool(values["shared_memory"]) is (profile == "none")
    is_on_this_host = set(values["udp"]) == {"127.0.0.1"}
    assert is_on_this_host is (profile == "shipped" and discovery == "LOCALHOST")


@pytest.mark.skipif("fastrtps" not in get_rmw_implementation_identifier(), reason="for Fast DDS")
@pytest.mark.parametrize("former", ["shipped", "none"])
def test_process_that_has_used_another_profile_stays_limited_to_this_host_by_its_range(
    no_profile: None, no_range: None, former: str
) -> None:
    """Fast DDS reads a profile once, so the one for this host would not limit anything."""
    command = [sys.executable, "-c", LATE, former, str(DOMAIN)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["None", "LOCALHOST"], done.stderr


@pytest.mark.parametrize(
    ("chosen", "expected"),
    [
        ({}, "LOCALHOST"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "SUBNET"),
        ({"ROS_LOCALHOST_ONLY": "0"}, None),
    ],
)
def test_discovery_stays_on_this_host_unless_a_range_is_chosen(
    no_range: None, monkeypatch: pytest.MonkeyPatch, chosen: dict[str, str], expected: str | None
) -> None:
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    keep_discovery_on_this_host()
    assert os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == expected
