"""Derive the outcome of an operator's run from its recording alone.

The result equals that of a run in one process to the precision of messages: heights and depths are
float32 there. Only the last run of a bag counts. It ends with the tick at which the operator
finished, or else with the last one that was recorded completely.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dig_operator.bed import has_bed
from earthmoving_sim.coloured_mesh import merge_meshes
from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.machine_mesh import machine_mesh
from earthmoving_sim.machine_outline import machine_outline
from earthmoving_sim.recorded_run.recorded_machine import (
    lip_path,
    load_recorded_machine,
    shoe_poses,
)
from earthmoving_sim.recorded_run.recorded_terrain import RecordedTerrain
from earthmoving_sim.recorded_run.run_record import RunRecord, read_run
from earthmoving_sim.recorded_run.topic_decoders import (
    MACHINE_CONFIG_SUFFIX,
    MAP_UPDATES_TOPIC,
    PHASE_SUFFIX,
    TERRAIN_MAP_TOPIC,
    Namespaces,
    RecordedRunError,
    run_topic_decoders,
)
from machine_sim.machine import MachineSpec, rotation_matrix
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Stream

__all__ = ["outcome_from_bag"]

MachinePose = tuple[MachineSpec, ArrayLike, NDArray[np.float64], ArrayLike]
"""Specification of a machine, position and rotation of its base, and its joint angles."""

_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
_TERRAIN_TOPICS = {
    TERRAIN_MAP_TOPIC: _CLOUD_TYPE,
    MAP_UPDATES_TOPIC: _CLOUD_TYPE,
}
_MARKERS_SUFFIX = "/markers"  # in the machine's namespace
_MARKER_TYPE = "visualization_msgs/msg/MarkerArray"


def outcome_from_bag(
    path: str | Path, progress: bool = False, *, namespace: str | None = None
) -> DigOutcome:
    """Return the outcome of the last run in a bag.

    The machine is drawn from its file, whose name is in the bag; without shoes if the bag has no
    markers.

    Args:
        path: a bag's folder, or an .mcap file.
        progress: whether to print how much of the bag has been read.
        namespace: that of the simulation; needed if the bag has several.

    Raises:
        BagReadError: it cannot be read as a bag, or has several simulations.
        RecordedRunError: a topic or a message is missing or wrong.
    """
    reader = BagReader(path, namespace=namespace)
    namespaces = _find_namespaces(reader)
    types = {
        **{name: decoder.type for name, decoder in run_topic_decoders(namespaces).items()},
        **_TERRAIN_TOPICS,
    }
    _check_topics(reader, types)
    on_message = _progress_printer(reader, types) if progress else lambda: None
    run = read_run(reader, namespaces, on_message)
    machines = [namespaces.machine, *([namespaces.truck] if namespaces.truck else [])]
    terrain, markers = _read_terrain_and_markers(
        reader, run, [machine + _MARKERS_SUFFIX for machine in machines], on_message
    )
    return _build_outcome(run, namespaces, terrain, markers)


def _build_outcome(
    run: RunRecord, namespaces: Namespaces, terrain: RecordedTerrain, markers: list[Any]
) -> DigOutcome:
    site, after, loose_depth = terrain.result()
    spec = load_recorded_machine(run.machine_config, namespaces)
    path = lip_path(spec, run.states, run.phases)
    end = run.states[-1]
    poses: list[MachinePose] = [
        (spec, end.base.position, rotation_matrix(end.base.quaternion), end.joints)
    ]
    if run.truck is not None:
        own = namespaces._replace(machine=namespaces.truck)
        truck = load_recorded_machine(run.machine_config, own)
        base, joints = run.truck.base, [run.truck.joints[name] for name in truck.joint_names]
        poses.append((truck, base.position, rotation_matrix(base.quaternion), joints))
    meshes, outlines = [], []
    for pose, message in zip(poses, markers, strict=True):
        count = pose[0].tracks.shoe_count
        shoes = None if message is None else shoe_poses(message, count)
        meshes.append(machine_mesh(*pose, shoes))
        outlines += machine_outline(*pose)
    x, y, _ = np.asarray(end.base.position).tolist()
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
        state_hash=run.state_hash.sha256,
        state_tick=run.state_hash.tick,
        run_mode=f"nodes {names}",
        lip_path=path.points,
        lip_cycle=path.cycle,
        lip_phase=path.phase,
        machine_mesh=merge_meshes(*meshes),
        machine_outline=outlines,
        machine_position=(x, y),
        loads=run.truck.loads if run.truck else [],
    )


def _find_namespaces(reader: BagReader) -> Namespaces:
    """Return the namespaces of the machine with an operator, and of a truck in the same node."""
    operated = [
        name.removesuffix(PHASE_SUFFIX)
        for name in reader.topics
        if name.endswith(PHASE_SUFFIX) and reader.is_of_simulation(name)
    ]
    by_task: dict[str, list[str]] = {"dig": [], "haul": []}
    for machine in operated:
        by_task["haul" if _is_truck(reader, machine) else "dig"].append(machine)
    if len(by_task["dig"]) != 1 or len(by_task["haul"]) > 1:
        topics = ", ".join(machine + PHASE_SUFFIX for machine in operated)
        raise RecordedRunError(
            f"{reader.path} must have one topic <machine>{PHASE_SUFFIX} of an excavator, and at"
            f" most one of a dumper; it has {topics or 'none'}; record a run with one operator each"
        )
    (machine,) = by_task["dig"]
    return Namespaces(machine, _node_of(reader, machine), "".join(by_task["haul"]))


def _node_of(reader: BagReader, machine: str) -> str:
    """Return the namespace of the node that simulates a machine."""
    parent = machine.rpartition("/")[0]  # namespace of a node that simulates several machines
    has_own_node = (
        machine + MACHINE_CONFIG_SUFFIX in reader.topics
        or parent + MACHINE_CONFIG_SUFFIX not in reader.topics
    )
    return machine if has_own_node else parent


def _is_truck(reader: BagReader, machine: str) -> bool:
    """Return whether a machine beside others of its node is one with a bed."""
    node = _node_of(reader, machine)
    if node == machine:
        return False
    topic = node + MACHINE_CONFIG_SUFFIX
    for _, _, message in reader.messages([topic]):
        return has_bed(load_recorded_machine(str(message.data), Namespaces(machine, node)))
    return False


def _check_topics(reader: BagReader, types: dict[str, str]) -> None:
    """Raise RecordedRunError if a topic is missing or of another type."""
    missing = [name for name in types if name not in reader.topics]
    if missing:
        raise RecordedRunError(
            f"{reader.path} lacks {', '.join(missing)}; record all topics from the start of the run"
        )
    for name, expected in types.items():
        actual = reader.topics[name].type
        if actual != expected:
            raise RecordedRunError(f"{name} is {actual} in {reader.path}; it must be {expected}")


def _read_terrain_and_markers(
    reader: BagReader,
    run: RunRecord,
    marker_topics: Sequence[str],
    on_message: Callable[[], None],
) -> tuple[RecordedTerrain, list[Any]]:
    """Return the terrain of a run, and each machine's markers at its end; None if it has none."""
    terrain = RecordedTerrain(run.header)
    with_markers = [
        topic
        for topic in marker_topics
        if topic in reader.topics and reader.topics[topic].type == _MARKER_TYPE
    ]
    last_markers: dict[str, bytes] = {}
    # Only one of the maps and of the markers is needed, and they are large: decode only those.
    for topic, time, data in reader.raw_messages([*_TERRAIN_TOPICS, *with_markers]):
        if topic in with_markers:
            if topic not in last_markers or time <= run.last_log_time:
                last_markers[topic] = data
            continue
        on_message()
        try:
            _add_terrain_message(reader, terrain, topic, data, run.facts.cell)
        except RecordedRunError:
            raise
        except EarthmovingError as error:
            raise RecordedRunError(
                f"a message on {topic}, logged at {time} ns, cannot be read: {error}"
            ) from error
    markers = [
        reader.decode(topic, last_markers[topic]) if topic in last_markers else None
        for topic in marker_topics
    ]
    return terrain, markers


def _add_terrain_message(
    reader: BagReader, terrain: RecordedTerrain, topic: str, data: bytes, cell: float
) -> None:
    if topic != TERRAIN_MAP_TOPIC:
        terrain.add_rows(from_chunk_cloud(reader.decode(topic, data), Stream.MAP_UPDATE))
    elif terrain.first is None:
        terrain.add_map(from_terrain_cloud(reader.decode(topic, data), cell=cell))


def _progress_printer(reader: BagReader, topics: dict[str, str]) -> Callable[[], None]:
    """Return a function that prints the percentage read; call it once for each message."""
    total = max(1, sum(reader.topics[name].count for name in topics))
    num_read = 0

    def on_message() -> None:
        nonlocal num_read
        num_read += 1
        if num_read == total or num_read % max(1, total // 100) == 0:
            end = "\n" if num_read == total else "\r"
            print(f"  reading   {100 * num_read // total:3d} %", end=end, flush=True)

    if not sys.stdout.isatty():
        print(f"  reading   {reader.path}", flush=True)
        return lambda: None
    return on_message
