"""LiveSource: keeps a scene equal to the public topics of a running simulation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, Int64MultiArray, String

from msg_bridge.codec import qos
from msg_bridge.codec.cdr import cdr_to_rows
from msg_bridge.codec.particles import PARTICLE
from msg_bridge.contract import topics
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.topics import STREAM_TOPICS, resolve
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk
from msg_bridge.nodes.sim_node import SimNode
from viewer.scene.scene import Scene
from viewer.sources.machine_topics import machine_namespaces, machine_node_of
from viewer.sources.polled_subscriptions import ANY_PUBLISHER, NEWEST, PolledSubscriptions
from viewer.sources.scene_writer import SceneWriter

__all__ = ["LiveSource"]

_POLL_PERIOD = 0.01
"""Wall time between two polls of all subscriptions [s]."""

_SCAN_PERIOD = 0.5
"""Wall time between two searches for machines in the graph [s]."""

_MAX_CONDITION_AGE = 10.0
"""Wall time without diagnostics after which the condition of a node is removed [s]; nodes publish
theirs once a second."""

_MAX_MISSED_SCANS = 3
"""Number of searches without a publisher after which a machine is removed."""


class LiveSource:
    """Subscriptions of a node to the topics of one simulation.

    Attributes:
        writer: sets the scene.
        machines: machine node by the namespace of each machine.
    """

    def __init__(
        self,
        node: SimNode,
        scene: Scene,
        reject: Callable[[str, str], None],
        *,
        simulation_namespace: str,
        on_machine: Callable[[str], None] = lambda machine: None,
    ) -> None:
        """
        Args:
            node: node of the subscriptions.
            scene: the scene.
            reject: called with topic and reason of a message that cannot be used.
            simulation_namespace: namespace of the soil node.
            on_machine: called with the namespace of each machine that is found.
        """
        self.writer = SceneWriter(scene)
        self.machines: dict[str, str] = {}
        self._node, self._scene, self._on_machine = node, scene, on_machine
        self._simulation = simulation_namespace
        self._subscriptions = PolledSubscriptions(node, reject)
        self._missed: Counter[str] = Counter()  # scans without the publisher of a machine
        self._subscribe_simulation()
        node.create_timer(_POLL_PERIOD, self._subscriptions.take_all)
        node.create_timer(_SCAN_PERIOD, self.scan)
        self.scan()

    def scan(self) -> None:
        """Search the graph for machines that have come or gone; drop nodes that have ended."""
        names = {
            name
            for name, types in self._node.get_topic_names_and_types()
            if "std_msgs/msg/String" in types or name.endswith(topics.SOIL_TICK)
        }
        found = machine_namespaces(names, self._simulation)
        for machine in found:
            node = machine_node_of(machine, names)
            if self._node.count_publishers(resolve(topics.ROBOT_DESCRIPTION, machine)):
                self._missed[machine] = 0
                if self.machines.get(machine) != node:
                    self._remove(machine)
                    self._add(machine, node)
        for machine in list(self.machines):
            is_present = machine in found and self._node.count_publishers(
                resolve(topics.ROBOT_DESCRIPTION, machine)
            )
            self._missed[machine] = 0 if is_present else self._missed[machine] + 1
            if self._missed[machine] >= _MAX_MISSED_SCANS:
                self._remove(machine)
        with self._scene.lock:
            self._scene.remove_old_conditions(_MAX_CONDITION_AGE)

    def _subscribe_simulation(self) -> None:
        """Subscribe to the topics of the soil node, rows before maps: most maps bring no news."""
        writer, add = self.writer, self._add_topic
        add(String, topics.SIM_CONFIG, qos.TRANSIENT_LOCAL, writer.on_config)
        add(
            PointCloud2,
            STREAM_TOPICS[Stream.MAP_UPDATE],
            qos.ROWS,
            lambda data: writer.on_map_updates(decode_chunk(data, Stream.MAP_UPDATE)),
            raw=True,
        )
        add(PointCloud2, topics.TERRAIN_MAP, qos.TRANSIENT_LOCAL, writer.on_map)
        add(PointCloud2, topics.TERRAIN_TILES, qos.TILES, writer.on_tile, raw=True)
        add(
            Int64MultiArray,
            topics.SOIL_LEDGER,
            NEWEST,
            lambda data: writer.on_ledger(decode_array(data)),
            raw=True,
        )
        add(Bool, topics.SIM_PAUSED, qos.TRANSIENT_LOCAL, writer.on_paused)
        add(DiagnosticArray, topics.DIAGNOSTICS, qos.STATE, writer.on_diagnostics)

    def _add_topic(
        self, kind: Any, name: str, profile: Any, take: Callable[[Any], None], *, raw: bool = False
    ) -> None:
        topic = resolve(name, self._simulation)
        self._subscriptions.add(kind, topic, profile, take, raw=raw)

    def _add(self, machine: str, node: str) -> None:
        if node not in self.machines.values():
            self._add_node(node)
        self.machines[machine] = node
        self._node.get_logger().info(f"machine {machine} found")
        with self._scene.lock:
            self._scene.machine(machine)
        writer = self.writer
        for kind, name, profile, take in (
            (String, topics.ROBOT_DESCRIPTION, qos.TRANSIENT_LOCAL, writer.on_description),
            (JointState, topics.JOINT_STATES, NEWEST, writer.on_joints),
            (Odometry, topics.ODOM, NEWEST, writer.on_odometry),
            (Float64MultiArray, topics.PAYLOAD, NEWEST, writer.on_payload),
            (Float64MultiArray, topics.CYLINDERS, NEWEST, writer.on_cylinders),
            (JointState, topics.APPLIED_COMMANDS, NEWEST, writer.on_applied),
            (String, topics.OPERATOR_PHASE, qos.ROWS, writer.on_phase),
            (Bool, topics.EMERGENCY_STOP, ANY_PUBLISHER, writer.on_emergency_stop),
            (Bool, topics.EMERGENCY_STOP, qos.TRANSIENT_LOCAL, writer.on_emergency_stop),
        ):
            self._subscriptions.add(kind, resolve(name, machine), profile, partial(take, machine))
        self._on_machine(machine)

    def _add_node(self, node: str) -> None:
        self._subscriptions.add(
            String,
            resolve(topics.MACHINE_CONFIG, node),
            qos.TRANSIENT_LOCAL,
            partial(self.writer.on_machine_config, node),
        )
        self._subscriptions.add(
            PointCloud2,
            resolve(topics.PARTICLES, node),
            NEWEST,
            partial(self._on_particles, node),
            raw=True,
        )

    def _on_particles(self, node: str, data: bytes) -> None:
        rows = cdr_to_rows(data, PARTICLE)
        if rows is None:
            self.writer.on_particles(node, deserialize_message(data, PointCloud2))
        else:
            self.writer.set_particles(node, rows)

    def _remove(self, machine: str) -> None:
        node = self.machines.pop(machine, None)
        if node is None:
            return
        self._node.get_logger().info(f"machine {machine} is gone")
        for name in (
            *(topics.ROBOT_DESCRIPTION, topics.JOINT_STATES, topics.ODOM, topics.PAYLOAD),
            *(topics.CYLINDERS, topics.APPLIED_COMMANDS, topics.OPERATOR_PHASE),
            topics.EMERGENCY_STOP,
        ):
            self._subscriptions.drop(resolve(name, machine))
        is_node_gone = node not in self.machines.values()
        if is_node_gone:
            for name in (topics.MACHINE_CONFIG, topics.PARTICLES):
                self._subscriptions.drop(resolve(name, node))
        with self._scene.lock:
            self._scene.remove_machine(machine)
            if is_node_gone:
                self._scene.remove_particles(node)
