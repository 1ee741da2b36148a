"""Details of a difference, from the rows and joint states in the bag: which cell, tool or joint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from earthmoving_sim.replay.comparison import Difference, describe_rows
from earthmoving_sim.replay.recorded.run_survey import SessionId
from earthmoving_sim.replay.replayed_machines import ReplayedMachines
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.row_chunks import from_chunk_cloud
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.contract import topics
from msg_bridge.contract.messages import Message, RowChunk, RowRange, Stream
from msg_bridge.contract.rows import Rows, empty_rows
from msg_bridge.contract.topics import STREAM_TOPICS, resolve

__all__ = ["DifferenceError", "joint_detail", "row_detail"]


class DifferenceError(Exception):
    """The replay differs from the recording."""

    def __init__(
        self,
        difference: Difference,
        machines: ReplayedMachines | None = None,
        session: SessionId | None = None,
        sent: Sequence[Message] = (),
    ) -> None:
        """
        Args:
            difference: the difference.
            machines, session: the machines that differ and their session; None for the soil.
            sent: messages of the replay in that tick.
        """
        super().__init__(str(difference))
        self.difference, self.machines, self.session = difference, machines, session
        self.sent = sent


def row_detail(
    reader: BagReader,
    run_id: int,
    session: SessionId | None,
    difference: Difference,
    sent: Iterable[Message],
) -> str:
    """Return the first row that differs; empty if the bag does not have the rows.

    Args:
        reader: the bag.
        run_id: number of the run.
        session: the session whose rows differ; None for rows of the soil.
        difference: the difference.
        sent: messages of the replay that carry its rows.
    """
    stream = difference.stream
    if stream is None:
        return ""
    replayed = [m.rows for m in sent if isinstance(m, RowChunk) and m.stream is stream]
    recorded = _recorded_rows(reader, run_id, session, stream, difference.recorded_rows)
    if recorded is None:
        return ""
    return describe_rows(recorded, np.concatenate([*replayed, empty_rows(recorded.dtype)]))


def joint_detail(
    reader: BagReader, machines: ReplayedMachines, tick: int, tick_period: float
) -> str:
    """Return the joint that differs most at the end of a tick; empty if none is known to differ.

    Args:
        reader: the bag.
        machines: the machines of the replay, at the end of the tick.
        tick: the tick.
        tick_period: tick period [s].
    """
    found: list[tuple[float, str]] = []
    for instance, simulated in zip(
        machines.instances, machines.run.sim.simulated_machines, strict=True
    ):
        topic = resolve(instance.topic_prefix + topics.JOINT_STATES, machines.namespace)
        recorded = _recorded_joints(reader, topic, tick, tick_period)
        angles = dict(
            zip(instance.spec.joint_names, simulated.machine.joint_positions.tolist(), strict=True)
        )
        name = f"{instance.name}/" if instance.name else ""
        found += [
            (
                abs(recorded[joint] - angle),
                f"joint {name}{joint} is at {recorded[joint]:.9f} rad recorded, {angle:.9f} rad"
                " replayed",
            )
            for joint, angle in angles.items()
            if recorded.get(joint, angle) != angle
        ]
    return max(found)[1] if found else ""


def _recorded_rows(
    reader: BagReader,
    run_id: int,
    session: SessionId | None,
    stream: Stream,
    wanted: RowRange,
) -> Rows | None:
    """Return the rows with wanted numbers, in order; None if one is missing."""
    topic = f"/{STREAM_TOPICS[stream]}"
    rows_by_number: dict[int, Rows] = {}
    if topic not in reader.topics:
        return None
    for _, _, message in reader.messages([topic]):
        try:
            chunk = from_chunk_cloud(message, stream)
        except CodecError:
            continue
        is_own = session is None or session == (chunk.machine_id, chunk.session_id)
        if chunk.run_id != run_id or not is_own:
            continue
        numbers = chunk.rows["seq"].astype(np.int64)
        for k in np.flatnonzero((numbers >= wanted.first) & (numbers <= wanted.last)):
            rows_by_number[int(numbers[k])] = chunk.rows[k : k + 1]
        if len(rows_by_number) == wanted.count:
            break
    if len(rows_by_number) < wanted.count:
        return None
    found: Sequence[Rows] = [rows_by_number[n] for n in sorted(rows_by_number)]
    return np.concatenate([*found, empty_rows(chunk.rows.dtype)]) if found else None


def _recorded_joints(
    reader: BagReader, topic: str, tick: int, tick_period: float
) -> Mapping[str, float]:
    """Return the joint angles at the end of a tick by name [rad]; empty if the bag lacks them."""
    if topic not in reader.topics:
        return {}
    stamp = stamp_from_tick(tick, tick_period)
    found: Mapping[str, float] = {}
    for _, _, message in reader.messages([topic]):
        if message.header.stamp == stamp:
            found = dict(zip(message.name, message.position, strict=False))
    return found
