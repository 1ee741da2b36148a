"""Record a replay into a bag, with the topics and rates of the nodes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from earthmoving_sim.replay.bag_node import BagNode, TimedBag
from earthmoving_sim.replay.node_parameters import MachineNodeSetup
from earthmoving_sim.replay.recorded.recorded_node import NodeAction
from earthmoving_sim.replay.replayed_machines import ReplayedMachines
from earthmoving_sim.replay.replayed_soil import ReplayedSoil
from machine_sim.node.machine_instance import find_input_files
from machine_sim.node.node_publishers import NodePublishers
from machine_sim.node.run_config import run_config
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec import qos
from msg_bridge.codec.cut_fill import CutFillState
from msg_bridge.codec.row_chunks import chunk_to_cdr
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.state_hash import StateHash
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.codec.tick_headers import message_to_cdr
from msg_bridge.contract import topics
from msg_bridge.contract.input_files import InputFile
from msg_bridge.contract.messages import (
    MachineHeader,
    Message,
    RetransmitRequest,
    RowChunk,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.topics import MAP_FRAME, STREAM_TOPICS, resolve
from msg_bridge.exchange.session_key import MAX_SESSION_ID
from msg_bridge.raw_topics.map_from_tiles import min_map_period
from msg_bridge.recorder.input_files import media_type
from msg_bridge.recorder.recording import FORMAT_VERSION
from soil_sim.endpoint import SoilTickResult
from soil_sim.node.map_publication import MapPublishers
from soil_sim.node.soil_publishers import SoilPublishers
from soil_sim.slope_failure import surface_tilt

__all__ = ["ReplayRecording"]


class ReplayRecording:
    """The bag of one replay, in simulation time."""

    def __init__(self, folder: Path, namespace: str = "/") -> None:
        """
        Args:
            folder: folder of the bag, empty or missing.
            namespace: namespace of the simulation.

        Raises:
            BagError: the folder is not empty, or it cannot be written.
        """
        self._bag = TimedBag(BagWriter(folder))
        self._namespace = namespace or "/"
        self._node = self._bag_node(self._namespace)
        self._tick = self._node.create_publisher(Int64MultiArray, topics.SOIL_TICK, qos.ROWS)
        self._rows = {
            stream: self._node.create_publisher(PointCloud2, topic, qos.ROWS)
            for stream, topic in STREAM_TOPICS.items()
        }
        self._nodes: dict[int, _RecordedMachines] = {}
        self._attached: set[str] = set()

    def close(self) -> None:
        """Finish the bag.

        Raises:
            BagError: it cannot be written.
        """
        self._bag.writer.close({"format_version": FORMAT_VERSION, "lost": "{}"})

    def start_soil(self, soil: ReplayedSoil) -> None:
        """Record the configuration of the soil node, and its terrain when the recording begins."""
        self._soil, self._params = soil, soil.setup.node
        self._period = soil.setup.node.tick_period
        # In the middle of a run, also the terrain after its first tick: that tick lacks the rows on
        # which it depends, so that the map before it is of no use to an audit.
        self._map_revision: int | None = soil.soil.revision if soil.endpoint.tick < 0 else None
        self._next_map_tick = 0
        params = soil.setup.soil
        tilt = surface_tilt(params, soil.site.grid) if params.surface_tilt_noise > 0.0 else None
        self._soil_publishers = SoilPublishers(
            self._node, design=soil.site.design is not None, tilt=tilt
        )
        self._attach(soil.input_files)
        tick = max(soil.endpoint.tick, 0)
        stamp = stamp_from_tick(tick, self._period)
        self._bag.time = _nanoseconds(stamp)
        self._maps = MapPublishers(self._node)
        self._soil_publishers.begin(soil.site.grid, soil.config(), stamp)
        self._maps.publish(self._terrain(), stamp)
        self._publish_cut_fill(tick)

    def start_machines(
        self, machines: ReplayedMachines, setup: MachineNodeSetup, first_session: int
    ) -> None:
        """Record the configuration of a machine node that enters the run in a session."""
        files = find_input_files(machines.instances)
        self._attach(files)
        config = run_config(
            machines.run,
            (first_session - 2) % MAX_SESSION_ID + 1,
            node=setup.node,
            machines=setup.machines,
            bins=setup.bins,
            particles=setup.particles,
            sensors=setup.sensors,
            commands=setup.commands,
            input_files=files,
        )
        namespace = resolve(machines.namespace.lstrip("/"), self._namespace)
        recorded = _RecordedMachines(self._bag_node(namespace), machines, setup)
        recorded.publishers.start_run(config, setup.node.seed)
        self._nodes[setup.node.machine_id] = recorded

    def on_action(
        self, machines: ReplayedMachines, action: NodeAction, messages: Sequence[Message]
    ) -> None:
        """Record a join request or a tick of a machine node, and what it sends."""
        recorded, run = self._nodes[action.header.machine_id], machines.run
        stamp = stamp_from_tick(max(run.tick, 0), self._period)
        if action.header.is_tick:  # a join request is of the present tick of the soil
            self._bag.time = _nanoseconds(stamp)
        for message in messages:
            if isinstance(message, RowChunk):
                self._rows[message.stream].publish(chunk_to_cdr(message, MAP_FRAME, stamp))
            elif isinstance(message, (MachineHeader, RetransmitRequest)):
                recorded.tick.publish(message_to_cdr(message))
        if action.header.is_tick:
            recorded.publishers.publish_applied_commands(machines.applied_commands(action), stamp)
            recorded.publishers.publish_contacts(run)
            recorded.publishers.publish_state(run, recorded.setup.node)

    def on_state(self, machines: ReplayedMachines) -> None:
        """Record the state hash of machines, if it is due."""
        for recorded in self._nodes.values():
            if recorded.machines is machines:
                run = machines.run
                self._bag.time = _nanoseconds(stamp_from_tick(run.tick, self._period))
                if run.tick > 0 and run.is_due(run.tick, recorded.setup.node.hash_rate):
                    recorded.publishers.publish_state_hash(run)

    def on_soil_tick(
        self, header: SoilHeader, done: SoilTickResult, messages: Sequence[Message]
    ) -> None:
        """Record a tick of the soil and what the soil sends in it."""
        tick, stamp = header.tick, stamp_from_tick(header.tick, self._period)
        self._bag.time = _nanoseconds(stamp)
        for message in messages:
            if isinstance(message, RowChunk) and message.stream is Stream.BACKLOG:
                self._nodes[message.machine_id].backlog.publish(
                    chunk_to_cdr(message, MAP_FRAME, stamp)
                )
            elif isinstance(message, RowChunk):
                self._rows[message.stream].publish(chunk_to_cdr(message, MAP_FRAME, stamp))
            elif isinstance(message, SoilHeader):
                self._tick.publish(message_to_cdr(message))
        self._soil_publishers.tick(done.ledger, stamp)
        soil = self._soil.soil
        if tick >= self._next_map_tick:
            period = min_map_period(soil.grid.rows * soil.grid.cols)
            self._next_map_tick = tick + self._interval(min(self._params.map_rate, 1.0 / period))
            if soil.revision != self._map_revision:
                self._map_revision = soil.revision
                self._maps.publish(self._terrain(), stamp)
                self._publish_cut_fill(tick)
        if tick % self._interval(self._params.hash_rate) == 0:
            self._soil_publishers.state_hash(
                StateHash(header.run_id, tick, stamp, soil.state_hash())
            )

    def _publish_cut_fill(self, tick: int) -> None:
        now = self._soil.cut_fill
        if now is not None:
            volumes = (now.cut, now.fill, now.remaining, now.within_tolerance)
            self._soil_publishers.cut_fill(CutFillState(tick * self._period, *volumes))

    def _interval(self, rate: float) -> int:
        """Return the ticks between messages of a rate [Hz]."""
        return max(1, round(1.0 / (rate * self._period)))

    def _terrain(self) -> TerrainMap:
        columns, cut_fill = self._soil.soil.columns, self._soil.cut_fill
        layers = {} if cut_fill is None else {"design_difference": cut_fill.difference}
        return TerrainMap(self._soil.keyframe(), columns.loose_depth, columns.material, **layers)

    def _bag_node(self, namespace: str) -> BagNode:
        return BagNode(self._bag, namespace)

    def _attach(self, files: Iterable[InputFile]) -> None:
        for file in files:
            if file.attachment_name not in self._attached:
                self._attached.add(file.attachment_name)
                content = Path(file.path).read_bytes()
                self._bag.writer.attach(
                    file.attachment_name, media_type(file.path), content, self._bag.time
                )


def _nanoseconds(stamp: Time) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


class _RecordedMachines:
    """Publishers of one machine node.

    Attributes:
        machines: its machines.
        setup: its parameters.
        publishers: those of its state.
        tick, backlog: those of its headers, and of its conversion backlog.
    """

    def __init__(self, node: BagNode, machines: ReplayedMachines, setup: MachineNodeSetup) -> None:
        self.machines, self.setup = machines, setup
        self.publishers = NodePublishers(
            node, machines.instances, setup.bins, setup.node, setup.sensors
        )
        self.tick = node.create_publisher(Int64MultiArray, topics.MACHINE_TICK, qos.ROWS)
        self.backlog = node.create_publisher(PointCloud2, topics.CONVERSION_BACKLOG, qos.ROWS)
