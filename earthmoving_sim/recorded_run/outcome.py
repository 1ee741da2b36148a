"""What a run of the operator did, from its recording alone.

The same as a run in one process tells of itself, to the precision of messages: heights and depths
are float32 there. Only the last run of a bag counts. It ends with the tick at which the operator
left the levers, or else with the last one of which all was recorded.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import (  # type: ignore[import-untyped, import-not-found, unused-ignore]
    MarkerArray,
)

from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.machine_polygons import machine_faces, machine_outline
from earthmoving_sim.recorded_run.recorded_machine import (
    lip_path,
    load_recorded_machine,
    shoe_poses,
)
from earthmoving_sim.recorded_run.recorded_terrain import RecordedTerrain
from earthmoving_sim.recorded_run.run_record import RunRecord, read_run
from earthmoving_sim.recorded_run.topic_decoders import (
    MACHINE_CONFIG_SUFFIX,
    PHASE_SUFFIX,
    Namespaces,
    RecordedRunError,
    run_topic_decoders,
)
from machine_sim.machine import rotation_matrix
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.topics import STREAM_TOPICS, TERRAIN_MAP_TOPIC

__all__ = ["outcome_from_bag"]

_CLOUD = "sensor_msgs/msg/PointCloud2"
_TERRAIN_TOPICS = {TERRAIN_MAP_TOPIC: _CLOUD, STREAM_TOPICS[Stream.MAP_UPDATE]: _CLOUD}
_MARKERS_SUFFIX = "/markers"  # below the machine's namespace
_MARKER_TYPE = "visualization_msgs/msg/MarkerArray"


def outcome_from_bag(path: str | Path, progress: bool = False) -> DigOutcome:
    """What the last run in a bag did.

    The machine is drawn from its file, whose name is in the bag; its tracks without shoes if the
    bag has no markers.

    Args:
        path: a bag's folder, or an .mcap file.
        progress: print how far it is read.

    Raises:
        BagReadError: it cannot be read as a bag.
        RecordedRunError: a topic or a message is missing or wrong; says which.
    """
    reader = BagReader(path)
    namespaces = _find_namespaces(reader)
    types = {
        **{name: word.type for name, word in run_topic_decoders(namespaces).items()},
        **_TERRAIN_TOPICS,
    }
    _check_topics(reader, types)
    on_message = _progress(reader, types) if progress else lambda: None
    run = read_run(reader, namespaces, on_message)
    terrain, markers = _read_terrain_and_markers(
        reader, run, namespaces.machine + _MARKERS_SUFFIX, on_message
    )
    return _build_outcome(run, namespaces, terrain, markers)


def _build_outcome(
    run: RunRecord, namespaces: Namespaces, terrain: RecordedTerrain, markers: Any
) -> DigOutcome:
    site, after, loose_depth = terrain.end()
    spec = load_recorded_machine(run.machine_config, namespaces)
    path = lip_path(spec, run.states, run.phases)
    end = run.states[-1]
    turn = rotation_matrix(end.base.quaternion)
    pose = (spec, end.base.position, turn, end.joints)
    shoes = None if markers is None else shoe_poses(markers, spec.tracks.shoe_count)
    x, y, _ = np.asarray(end.base.position).tolist()
    state_tick, state_hash = run.state
    names = ", ".join(name.rpartition("/")[2] for name in run.nodes)
    return DigOutcome(
        site=site,
        grid=site.grid,
        after=after,
        loose_depth=loose_depth,
        cycles=run.cycles,
        ledger=run.ledger,
        max_imbalance=run.max_imbalance,
        moved_volume=sum(cycle.moved_volume for cycle in run.cycles),
        simulated_time=run.header.tick * run.facts.tick_period,
        wall_time=run.wall_time,
        max_particles=run.max_particles,
        tunnelled=run.tunnelled,
        abort_reason=run.abort_reason,
        state_hash=state_hash,
        state_tick=state_tick,
        run_mode=f"nodes {names}",
        lip_path=path.points,
        lip_cycle=path.cycle,
        lip_phase=path.phase,
        machine_faces=machine_faces(*pose, shoes),
        machine_outline=machine_outline(*pose),
        machine_position=(x, y),
    )


def _find_namespaces(reader: BagReader) -> Namespaces:
    """The one machine with an operator."""
    operators = [name for name in reader.topics if name.endswith(PHASE_SUFFIX)]
    if len(operators) != 1:
        found = ", ".join(operators) or "none"
        raise RecordedRunError(
            f"{reader.path} must have one topic <machine>{PHASE_SUFFIX}, and has {found}; record a run"
            " with one operator"
        )
    machine = operators[0].removesuffix(PHASE_SUFFIX)
    above = machine.rpartition("/")[0]  # of a node of several
    own = (
        machine + MACHINE_CONFIG_SUFFIX in reader.topics
        or above + MACHINE_CONFIG_SUFFIX not in reader.topics
    )
    return Namespaces(machine, machine if own else above)


def _check_topics(reader: BagReader, types: dict[str, str]) -> None:
    missing = [name for name in types if name not in reader.topics]
    if missing:
        raise RecordedRunError(
            f"{reader.path} lacks {', '.join(missing)}; record all topics from the start of the run"
        )
    for name, kind in types.items():
        found = reader.topics[name].type
        if found != kind:
            raise RecordedRunError(f"{name} is {found} in {reader.path}; it must be {kind}")


def _read_terrain_and_markers(
    reader: BagReader, run: RunRecord, marker_topic: str, on_message: Callable[[], None]
) -> tuple[RecordedTerrain, Any]:
    """The terrain of a run, and how the machine looked as it ended, None if that is not told."""
    terrain = RecordedTerrain(run.header)
    shown = marker_topic in reader.topics and reader.topics[marker_topic].type == _MARKER_TYPE
    look: bytes | None = None
    # Maps and markers are large, and of each but one is needed: so they come as they are stored.
    for topic, time, data in reader.raw_messages([*_TERRAIN_TOPICS, *([marker_topic] * shown)]):
        if topic == marker_topic:
            look = data if look is None or time <= run.last_log_time else look
        else:
            on_message()
            try:
                _apply_terrain_message(terrain, topic, data, run.facts.cell)
            except RecordedRunError:
                raise
            except Exception as error:  # of rclpy's, by kind of damage
                what = f"a message on {topic}, logged at {time} ns"
                raise RecordedRunError(f"{what}, cannot be read: {error}") from error
    return terrain, None if look is None else deserialize_message(look, MarkerArray)


def _apply_terrain_message(terrain: RecordedTerrain, topic: str, data: bytes, cell: float) -> None:
    if topic != TERRAIN_MAP_TOPIC:
        cloud = deserialize_message(data, PointCloud2)
        terrain.receive_rows(from_chunk_cloud(cloud, Stream.MAP_UPDATE))
    elif terrain.first is None:
        terrain.receive_map(from_terrain_cloud(deserialize_message(data, PointCloud2), cell=cell))


def _progress(reader: BagReader, topics: dict[str, str]) -> Callable[[], None]:
    """Prints the part that is read, called once for each message."""
    total = max(1, sum(reader.topics[name].count for name in topics))
    read = 0

    def on_message() -> None:
        nonlocal read
        read += 1
        if read == total or read % max(1, total // 100) == 0:
            end = "\n" if read == total else "\r"
            print(f"  reading   {100 * read // total:3d} %", end=end, flush=True)

    if not sys.stdout.isatty():
        print(f"  reading   {reader.path}", flush=True)
        return lambda: None
    return on_message
