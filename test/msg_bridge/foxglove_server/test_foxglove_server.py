"""A client of the Foxglove server sees all topics, also what was published before it connected."""

import sys

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped, Twist, TwistStamped, Vector3
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, Joy, PointCloud2
from std_msgs.msg import Bool, Header, String
from std_srvs.srv import SetBool, Trigger
from support.foxglove_client import FoxgloveClient

from msg_bridge.bag.bundled_types import TF_TYPE
from msg_bridge.codec import qos
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.codec.terrain import TerrainMap, from_terrain_cloud, to_terrain_cloud
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.foxglove_server.node import FoxgloveServerNode
from msg_bridge.foxglove_server.sdk import FoxgloveServerError

STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture
def server(ros):
    """Return a function that starts a server on a free port."""
    nodes = []

    def make(**parameters) -> FoxgloveServerNode:
        given = {"port": 0, "scan_period": 0.02}
        nodes.append(ros.add(FoxgloveServerNode, parameters={**given, **parameters}))
        return nodes[-1]

    yield make
    for node in nodes:
        node.stop()


@pytest.fixture
def connect():
    """Return a function that connects a client."""
    clients = []

    def make(node: FoxgloveServerNode) -> FoxgloveClient:
        clients.append(FoxgloveClient(node.port))
        return clients[-1]

    yield make
    for client in clients:
        client.close()


def first_message(ros, client: FoxgloveClient, topic: str) -> bytes:
    """Subscribe to a topic and return the first message that arrives."""
    ros.spin_until(lambda: topic in client.channels)
    client.subscribe(topic)
    ros.spin_until(lambda: topic in client.messages)
    return client.messages[topic][0][1]


def flat_terrain(height: float) -> PointCloud2:
    grid = Grid(4, 6, 0.5)
    elevation = np.full(grid.shape, height)
    volume = np.full(grid.shape, 10**9, dtype=np.int64)
    layer = np.zeros(grid.shape, dtype=np.uint8)
    keyframe = Keyframe(7, 1, grid, elevation, volume, layer, layer)
    terrain = TerrainMap(keyframe, np.zeros(grid.shape))
    return to_terrain_cloud(terrain, "map", stamp_from_seconds(0.0))


def test_all_topics_are_advertised_with_their_definitions(ros, server, connect):
    ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
    ros.publisher("/excavator/joint_states", JointState, qos.STATE)
    node = server()
    client = connect(node)
    wanted = {"/terrain/map", "/excavator/joint_states", "/rosout"}
    ros.spin_until(lambda: wanted <= set(client.channels))
    for channel in client.channels.values():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        name = channel["schemaName"]
        assert name in get_types_from_msg(channel["schema"], name)
    assert client.channels["/terrain/map"]["schemaName"] == "sensor_msgs/msg/PointCloud2"


def test_late_client_receives_the_newest_map(ros, server, connect):
    node = server()
    publisher = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    for height in (1.0, 2.0):
        publisher.publish(flat_terrain(height))
    for _ in range(2):  # the second client connects when the map was sent to the first
        data = first_message(ros, connect(node), "/terrain/map")
    keyframe = from_terrain_cloud(deserialize_message(data, PointCloud2)).keyframe
    assert keyframe.elevation.max() == keyframe.elevation.min() == 2.0
    assert keyframe.grid == Grid(4, 6, 0.5)


def test_messages_and_time_have_the_simulation_time(ros, server, connect):
    clock = ros.publisher("/clock", Clock, qos.STATE)
    states = ros.publisher("/excavator/joint_states", JointState, qos.STATE)
    node = server()
    client = connect(node)
    ros.spin_until(lambda: "/excavator/joint_states" in client.channels)
    client.subscribe("/excavator/joint_states")
    ros.spin_until(lambda: clock.get_subscription_count() and states.get_subscription_count())
    clock.publish(Clock(clock=stamp_from_seconds(2.5)))
    ros.spin_until(lambda: 2_500_000_000 in client.times)
    states.publish(JointState(name=["boom"], position=[0.5]))
    ros.spin_until(lambda: "/excavator/joint_states" in client.messages)
    ((time, data),) = client.messages["/excavator/joint_states"]
    assert time == 2_500_000_000
    assert deserialize_message(data, JointState).name == ["boom"]


def test_late_client_receives_tf_of_every_link(ros, server, connect):
    node = server()
    publisher = ros.publisher("/excavator/transforms", TransformStamped, qos.ROWS, subscriptions=1)
    for child in ("excavator/base_link", "excavator/boom", "excavator/base_link"):
        publisher.publish(TransformStamped(header=Header(frame_id="map"), child_frame_id=child))
    client = connect(node)
    message = STORE.deserialize_cdr(first_message(ros, client, "/tf"), TF_TYPE)
    assert client.channels["/tf"]["schemaName"] == TF_TYPE
    frames = {each.child_frame_id for each in message.transforms}
    assert frames == {"excavator/base_link", "excavator/boom"}
    num_received = len(client.messages["/tf"])
    ros.spin_until(lambda: len(client.messages["/tf"]) > num_received, what="/tf to be repeated")


def machine_with_commands(ros, of: type, topic: str) -> list:
    """Publish joint states of the machine /excavator; return the list of its received commands."""
    ros.publisher("/excavator/joint_states", JointState, qos.STATE)
    return ros.collect(topic, of, qos.COMMANDS)


@pytest.mark.parametrize(
    ("topic", "type_name", "sent", "received"),
    [
        ("cmd_vel", "geometry_msgs/Twist", Twist(linear=Vector3(x=0.5)), TwistStamped),
        ("joint_commands", "sensor_msgs/msg/JointState", JointState(name=["boom"]), JointState),
        ("joy", "sensor_msgs/Joy", Joy(axes=[0.5, 0.0]), Joy),
        ("emergency_stop", "std_msgs/msg/Bool", Bool(data=True), Bool),
    ],
)
def test_client_drives_a_machine_if_it_is_allowed(
    ros, server, connect, topic, type_name, sent, received
):
    commands = machine_with_commands(ros, received, f"/excavator/{topic}")
    node = server(allow_commands=True)
    client = connect(node)
    ros.spin_until(lambda: "/excavator/joint_states" in client.channels)
    client.advertise(1, f"/excavator/{topic}", type_name)

    def publish_until_received() -> bool:
        client.publish(1, serialize_message(sent))
        return bool(commands)

    ros.spin_until(publish_until_received)
    assert commands[0] == (TwistStamped(twist=sent) if received is TwistStamped else sent)


@pytest.mark.parametrize(
    ("topic", "of", "type_name", "data"),
    [
        ("/soil/conversions", String, "std_msgs/String", serialize_message(String(data="x"))),
        ("/elsewhere/joy", Joy, "sensor_msgs/Joy", serialize_message(Joy())),
        ("/excavator/joy", Joy, "std_msgs/String", serialize_message(String(data="x"))),
        ("/excavator/joy", Joy, "sensor_msgs/Joy", b"\x00\x01\x00\x00\xff\xff"),
    ],
)
def test_other_messages_of_clients_are_rejected(
    ros, server, connect, capfd, topic, of, type_name, data
):
    commands = machine_with_commands(ros, of, topic)
    node = server(allow_commands=True)
    client = connect(node)
    ros.spin_until(lambda: "/excavator/joint_states" in client.channels)
    client.advertise(1, topic, type_name)
    client.publish(1, data)
    logged: list[str] = []

    def is_logged() -> bool:
        output = capfd.readouterr()
        logged.append(output.out + output.err)
        return topic in "".join(logged)

    ros.spin_until(is_logged)
    ros.spin_for(0.2)
    assert commands == []


def test_clients_neither_publish_nor_call_services_by_default(ros, server, connect):
    commands = machine_with_commands(ros, Bool, "/excavator/emergency_stop")
    client = connect(server())
    ros.spin_until(lambda: "/excavator/joint_states" in client.channels)
    client.advertise(1, "/excavator/emergency_stop", "std_msgs/Bool")
    ros.spin_until(lambda: any("clientPublish" in str(each) for each in client.infos[1:]))
    client.publish(1, serialize_message(Bool(data=True)))
    ros.spin_for(0.2)
    assert (commands, client.services) == ([], {})
    assert client.infos[0]["capabilities"] == ["time"]


def test_client_calls_services_if_it_is_allowed(ros, server, connect):
    received = []

    def pause(request, response):
        received.append(request.data)
        response.success, response.message = True, "paused"
        return response

    ros.helper.create_service(SetBool, "/sim/pause", pause)
    node = server(allow_services=True)
    client = connect(node)
    ros.spin_until(lambda: {"/sim/pause", "/sim/reset", "/soil/verify"} <= set(client.services))
    ros.spin_until(lambda: node.count_services("/sim/pause"))
    schema = client.services["/sim/pause"]["request"]
    assert (schema["schemaEncoding"], schema["schema"].split()[:2]) == ("ros2msg", ["bool", "data"])

    def call_until_answered() -> bool:
        client.call("/sim/pause", 5, serialize_message(SetBool.Request(data=True)))
        return 5 in client.responses

    ros.spin_until(call_until_answered)
    response = deserialize_message(client.responses[5], SetBool.Response)
    assert (response.success, response.message, received[0]) == (True, "paused", True)


def test_call_of_a_service_that_is_missing_fails(ros, server, connect):
    client = connect(server(allow_services=True))
    ros.spin_until(lambda: "/sim/reset" in client.services)
    client.call("/sim/reset", 3, serialize_message(Trigger.Request()))
    ros.spin_until(lambda: any("not available" in str(each) for each in client.infos))
    assert client.responses == {}


def test_commands_and_services_need_a_loopback_address(ros, server):
    for option in ("allow_commands", "allow_services"):
        with pytest.raises(ParameterError, match="no token"):
            server(address="0.0.0.0", **{option: True})


def test_port_in_use_and_missing_sdk_are_errors(ros, server, monkeypatch):
    node = server()
    with pytest.raises(FoxgloveServerError, match="choose another port"):
        server(port=node.port)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(FoxgloveServerError, match="pip install foxglove-sdk"):
        server()
