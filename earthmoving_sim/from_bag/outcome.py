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

from earthmoving_sim.from_bag.machine import lip_path, machine_of_config, shoe_poses
from earthmoving_sim.from_bag.run import RunTold, read_run
from earthmoving_sim.from_bag.terrain import RecordedTerrain
from earthmoving_sim.from_bag.words import (
    MACHINE_CONFIG,
    PHASE,
    BagOutcomeError,
    Place,
    words_of_run,
)
from earthmoving_sim.machine_shape import machine_faces, machine_outline
from earthmoving_sim.outcome import Outcome
from machine_sim.machine import rotation_matrix
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.chunks import from_chunk_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract.messages import Stream
from msg_bridge.nodes.topics import MAP_TOPIC, STREAM_TOPIC

__all__ = ["outcome_of_bag"]

_CLOUD = "sensor_msgs/msg/PointCloud2"
_TERRAIN = {MAP_TOPIC: _CLOUD, STREAM_TOPIC[Stream.CHANGED]: _CLOUD}
_MARKERS = "/markers"  # below the machine's namespace
_MARKER_TYPE = "visualization_msgs/msg/MarkerArray"


def outcome_of_bag(path: str | Path, progress: bool = False) -> Outcome:
    """What the last run in a bag did.

    The machine is drawn from its file, whose name is in the bag; its tracks without shoes if the
    bag has no markers.

    Args:
        path: a bag's folder, or an .mcap file.
        progress: print how far it is read.

    Raises:
        BagReadError: it cannot be read as a bag.
        BagOutcomeError: a topic or a message is missing or wrong; says which.
    """
    reader = BagReader(path)
    place = _place(reader)
    types = {**{name: word.type for name, word in words_of_run(place).items()}, **_TERRAIN}
    _check_topics(reader, types)
    went_on = _progress(reader, types) if progress else lambda: None
    run = read_run(reader, place, went_on)
    terrain, markers = _terrain_and_markers(reader, run, place.machine + _MARKERS, went_on)
    return _outcome(run, place, terrain, markers)


def _outcome(run: RunTold, place: Place, terrain: RecordedTerrain, markers: Any) -> Outcome:
    site, after, loose_depth = terrain.end()
    description = machine_of_config(run.machine_config, place)
    path = lip_path(description, run.states, run.phases)
    end = run.states[-1]
    turn = rotation_matrix(end.base.quaternion)
    pose = (description, end.base.position, turn, end.joints)
    shoes = None if markers is None else shoe_poses(markers, description.tracks.shoe_count)
    x, y, _ = np.asarray(end.base.position).tolist()
    state_tick, state_hash = run.state
    names = ", ".join(name.rpartition("/")[2] for name in run.nodes)
    return Outcome(
        site=site,
        grid=site.grid,
        after=after,
        loose_depth=loose_depth,
        cycles=run.cycles,
        ledger=run.ledger,
        worst_imbalance=run.worst_imbalance,
        moved=sum(cycle.moved for cycle in run.cycles),
        simulated=run.header.tick * run.facts.tick,
        wall=run.wall,
        most_particles=run.most_particles,
        tunnelled=run.tunnelled,
        given_up=run.given_up,
        state_hash=state_hash,
        state_tick=state_tick,
        ran_as=f"nodes {names}",
        path=path.points,
        path_cycle=path.cycle,
        path_phase=path.phase,
        machine_faces=machine_faces(*pose, shoes),
        machine_outline=machine_outline(*pose),
        machine_position=(x, y),
    )


def _place(reader: BagReader) -> Place:
    """The one machine with an operator."""
    operators = [name for name in reader.topics if name.endswith(PHASE)]
    if len(operators) != 1:
        found = ", ".join(operators) or "none"
        raise BagOutcomeError(
            f"{reader.path} must have one topic <machine>{PHASE}, and has {found}; record a run"
            " with one operator"
        )
    machine = operators[0].removesuffix(PHASE)
    above = machine.rpartition("/")[0]  # of a node of several
    own = machine + MACHINE_CONFIG in reader.topics or above + MACHINE_CONFIG not in reader.topics
    return Place(machine, machine if own else above)


def _check_topics(reader: BagReader, types: dict[str, str]) -> None:
    missing = [name for name in types if name not in reader.topics]
    if missing:
        raise BagOutcomeError(
            f"{reader.path} lacks {', '.join(missing)}; record all topics from the start of the run"
        )
    for name, kind in types.items():
        found = reader.topics[name].type
        if found != kind:
            raise BagOutcomeError(f"{name} is {found} in {reader.path}; it must be {kind}")


def _terrain_and_markers(
    reader: BagReader, run: RunTold, marker_topic: str, went_on: Callable[[], None]
) -> tuple[RecordedTerrain, Any]:
    """The terrain of a run, and how the machine looked as it ended, None if that is not told."""
    terrain = RecordedTerrain(run.header)
    shown = marker_topic in reader.topics and reader.topics[marker_topic].type == _MARKER_TYPE
    look: bytes | None = None
    # Maps and markers are large, and of each but one is needed: so they come as they are stored.
    for topic, time, data in reader.raw_messages([*_TERRAIN, *([marker_topic] * shown)]):
        if topic == marker_topic:
            look = data if look is None or time <= run.last_time else look
        else:
            went_on()
            try:
                _take_terrain(terrain, topic, data, run.facts.cell)
            except BagOutcomeError:
                raise
            except Exception as error:  # of rclpy's, by kind of damage
                what = f"a message on {topic}, logged at {time} ns"
                raise BagOutcomeError(f"{what}, cannot be read: {error}") from error
    return terrain, None if look is None else deserialize_message(look, MarkerArray)


def _take_terrain(terrain: RecordedTerrain, topic: str, data: bytes, cell: float) -> None:
    if topic != MAP_TOPIC:
        cloud = deserialize_message(data, PointCloud2)
        terrain.receive_rows(from_chunk_cloud(cloud, Stream.CHANGED))
    elif terrain.first is None:
        terrain.receive_map(from_terrain_cloud(deserialize_message(data, PointCloud2), cell=cell))


def _progress(reader: BagReader, topics: dict[str, str]) -> Callable[[], None]:
    """Prints the part that is read, called once for each message."""
    total = max(1, sum(reader.topics[name].count for name in topics))
    read = 0

    def went_on() -> None:
        nonlocal read
        read += 1
        if read == total or read % max(1, total // 100) == 0:
            end = "\n" if read == total else "\r"
            print(f"  reading   {100 * read // total:3d} %", end=end, flush=True)

    if not sys.stdout.isatty():
        print(f"  reading   {reader.path}", flush=True)
        return lambda: None
    return went_on
