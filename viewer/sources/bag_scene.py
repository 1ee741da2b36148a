"""BagScene: the scene of a bag at any message, by playing on or by restoring.

Most topics need only their newest message; `bag_terrain` restores the terrain.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from machine_sim.machine.description import description_text
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.run_config import parse_run_facts
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.topics import resolve
from viewer.scene.machine_model import MachineModel
from viewer.scene.scene import Scene
from viewer.scene.urdf import parse_urdf
from viewer.sources.bag_terrain import MAP_TOPIC, UPDATES_TOPIC, BagTerrain
from viewer.sources.bag_timeline import BagTimeline
from viewer.sources.machine_files import spec_in_config
from viewer.sources.machine_topics import machine_namespaces, machine_node_of
from viewer.sources.scene_writer import SceneWriter, node_of_status

__all__ = ["BagScene"]

_CONFIG, _LEDGER = f"/{topics.SIM_CONFIG}", f"/{topics.SOIL_LEDGER}"
_DIAGNOSTICS, _RECORDER = f"/{topics.DIAGNOSTICS}", f"/{topics.RECORDER_STATUS}"

_HISTORY = (_CONFIG, MAP_TOPIC, UPDATES_TOPIC)
"""Topics of which each message is needed."""

_RECORDER_NODE = "exchange_recorder"


class BagScene:
    """A bag and the scene at one of its messages; used by one thread, but for the scene.

    Attributes:
        scene: the scene.
        size: number of messages.
        position: number of messages that the scene contains.
        timeline: simulated time over log time.
        rejected: number of messages that could not be used.
    """

    def __init__(self, path: Path, *, namespace: str | None = None) -> None:
        """Index a bag.

        Args:
            path: the bag.
            namespace: of the simulation in it; None: the only one.

        Raises:
            BagReadError: it cannot be read, or has nothing that can be shown.
        """
        self.scene = Scene()
        self.rejected = 0
        self.position = 0
        self._reader = BagReader(path, namespace=namespace)
        self._writer = SceneWriter(self.scene, self._reader.namespace)
        names = [name for name in self._reader.topics if self._reader.is_of_simulation(name)]
        self._first_of_machine: dict[str, int] = {}
        self._lasting: dict[str, Callable[[Any], None]] = {}  # newest message, of any run
        self._of_run: dict[str, Callable[[Any], None]] = {}  # newest message of the run
        self._lasting[_RECORDER] = self._writer.on_recorder_status
        self._machines = self._assign_handlers(names)
        self._index = self._reader.index(
            [_CONFIG, MAP_TOPIC, UPDATES_TOPIC, _DIAGNOSTICS, *self._lasting, *self._of_run]
        )
        self.size = self._index.size
        for machine, own in self._machines.items():
            first = [int(found[0]) for name in own if (found := self._index.of_topic(name)).size]
            self._first_of_machine[machine] = min(first, default=self.size)
        self._reporting: set[str] = set()  # machines that report their emergency stop
        self._status_numbers = self._find_statuses()
        if any(name.rpartition("/")[2] == _RECORDER_NODE for name in self._status_numbers):
            del self._lasting[_RECORDER]  # its diagnostics state the same
        self._models = self._missing_models(names)
        self._run_starts, self._run_ids = self._find_runs()
        self._terrain = BagTerrain(
            self.scene, self._index, self._decode, self._writer.decode_map, self._count_rejected
        )
        self.timeline = self._make_timeline()

    @property
    def machines(self) -> tuple[str, ...]:
        """Namespaces of all machines in the bag, sorted."""
        return tuple(sorted(self._machines))

    def number_at(self, position: float) -> int:
        """Return the number of messages up to a position [s]."""
        log_time = self.timeline.log_time(position)
        return int(np.searchsorted(self._index.times, log_time, side="right"))

    def reached(self) -> float:
        """Return the position of the last message that the scene contains [s]."""
        if self.position == 0:
            return 0.0
        return self.timeline.position(int(self._index.times[self.position - 1]))

    def close(self) -> None:
        """Close the files."""
        self._index.close()

    def advance(self, end: int) -> None:
        """Play on until `end` messages are contained.

        Of messages of which only the newest is shown, only the newest is decoded.
        """
        while self.position < end:
            run = bisect_right(self._run_starts, self.position)
            next_start = self._run_starts[run] if run < len(self._run_starts) else self.size
            part_end = min(end, max(next_start, self.position + 1))
            newest: dict[str, int] = {}
            for number in range(self.position, part_end):
                topic = self._index.topics[self._index.topic_numbers[number]]
                if topic in self._lasting or topic in self._of_run:
                    newest[topic] = number
                elif topic == _DIAGNOSTICS:  # each node has its own newest status
                    newest[f"{topic} {number}"] = number
                elif topic in _HISTORY:
                    self._apply(topic, number)
            self._apply_in_order(newest.values())
            self.position = part_end

    def restore(self, end: int) -> None:
        """Go to the state after the first `end` messages, without playing them."""
        with self.scene.lock:
            self.scene.begin_restore()
            for machine, first in self._first_of_machine.items():
                if first >= end:
                    self.scene.remove_machine(machine)
        run = bisect_right(self._run_starts, end - 1) - 1
        start = self._run_starts[run] if run >= 0 else 0
        config = self._index.latest(_CONFIG, end)
        if config is None:
            self._writer.discard_config()
        else:
            self._apply(_CONFIG, config)
        self._terrain.restore(end)
        newest = [number for topic in self._lasting for number in self._latest(topic, 0, end)]
        newest += [number for topic in self._of_run for number in self._latest(topic, start, end)]
        for numbers in self._status_numbers.values():
            newest += numbers[: bisect_left(numbers, end)][-1:]
        self._apply_in_order(newest)
        self.position = end
        with self.scene.lock:
            self.scene.end_restore()

    def _latest(self, topic: str, first: int, end: int) -> list[int]:
        """Return the number of the newest message from `first` to before `end`; empty: none."""
        number = self._index.latest(topic, end)
        return [] if number is None or number < first else [number]

    def _apply_in_order(self, numbers: Iterable[int]) -> None:
        """Process messages in the order of the bag, so that the last of several topics counts."""
        for number in sorted(set(numbers)):
            self._apply(self._index.topics[self._index.topic_numbers[number]], number)

    def _assign_handlers(self, names: list[str]) -> dict[str, list[str]]:
        """Set the function that takes the messages of each topic; return topics by machine."""
        writer, present = self._writer, set(names)
        self._of_run[_LEDGER] = lambda msg: writer.on_ledger(from_multi_array(msg))
        self._lasting[f"/{topics.SIM_PAUSED}"] = writer.on_paused
        machines: dict[str, list[str]] = {}
        described = machine_namespaces(names)
        moving = machine_namespaces(names, marker=topics.JOINT_STATES)
        for machine in sorted({*described, *moving}):
            node = machine_node_of(machine, present)
            config, particles = (
                resolve(name, node) for name in (topics.MACHINE_CONFIG, topics.PARTICLES)
            )
            self._lasting[config] = partial(writer.on_machine_config, node)
            self._of_run[particles] = partial(writer.on_particles, node)
            lasting = {
                topics.ROBOT_DESCRIPTION: writer.on_description,
                topics.EMERGENCY_STOP: self._on_emergency_stop,
            }
            of_run = {
                topics.JOINT_STATES: self._on_joints,
                topics.ODOM: writer.on_odometry,
                topics.PAYLOAD: writer.on_payload,
                topics.CYLINDERS: writer.on_cylinders,
                topics.APPLIED_COMMANDS: writer.on_applied,
                topics.OPERATOR_PHASE: writer.on_phase,
            }
            for handlers, functions in ((self._lasting, lasting), (self._of_run, of_run)):
                for name, function in functions.items():
                    handlers[resolve(name, machine)] = partial(function, machine)
            machines[machine] = [resolve(name, machine) for name in (*lasting, *of_run)]
        return machines

    def _on_emergency_stop(self, machine: str, msg: Any) -> None:
        """Process a published stop; it is shown if the bag has no report of the machine."""
        if machine not in self._reporting:
            self._writer.on_unreported_stop(machine, msg)

    def _on_joints(self, machine: str, msg: Any) -> None:
        """Process joint values; a machine without a description gets its model now."""
        model = self._models.get(machine)
        if model is not None:
            self._writer.set_model(machine, model)
        self._writer.on_joints(machine, msg)

    def _apply(self, topic: str, number: int) -> None:
        """Process a message; one that cannot be used is counted and left out."""
        try:
            if topic == UPDATES_TOPIC:
                self._writer.on_map_updates(self._terrain.chunk(number))
                return
            message = self._decode(topic, number)
            if topic == _CONFIG:
                self._writer.on_config(message)
            elif topic == MAP_TOPIC:
                self._writer.on_map(message)
            elif topic == _DIAGNOSTICS:
                self._writer.on_diagnostics(message)
            else:
                (self._lasting.get(topic) or self._of_run[topic])(message)
        except Exception:  # any: a malformed message must not end the player
            self.rejected += 1

    def _count_rejected(self) -> None:
        self.rejected += 1

    def _decode(self, topic: str, number: int) -> Any:
        log_time = int(self._index.times[number])
        return self._reader.decode(topic, self._index.read(number), log_time)

    def _find_runs(self) -> tuple[list[int], list[int]]:
        """Return the number of the first configuration of each run, and its id."""
        starts: list[int] = []
        run_ids: list[int] = []
        parsed: dict[str, int] = {}
        for number in self._index.of_topic(_CONFIG):
            text = self._decode(_CONFIG, int(number)).data
            if text not in parsed:
                try:
                    parsed[text] = parse_run_facts(text).run_id
                except CodecError:
                    continue
            if not run_ids or run_ids[-1] != parsed[text]:
                starts.append(int(number))
                run_ids.append(parsed[text])
        return starts, run_ids

    def _find_statuses(self) -> dict[str, list[int]]:
        """Return the numbers of the diagnostics of each node; find machines that report a stop."""
        found: dict[str, list[int]] = {}
        for number in self._index.of_topic(_DIAGNOSTICS):
            try:
                message = self._decode(_DIAGNOSTICS, int(number))
            except EarthmovingError:
                self.rejected += 1
                continue
            for name in {node_of_status(status) for status in message.status}:
                found.setdefault(name, []).append(int(number))
            for status in message.status:
                self._reporting |= {machine for machine, _ in self._writer.reported_stops(status)}
        return found

    def _missing_models(self, names: list[str]) -> dict[str, MachineModel]:
        """Return models of machines without a robot description, by their machine files.

        Recordings of earlier versions have none. The configuration of the machine node names the
        file; only shipped ones are read.
        """
        models = {}
        for machine in self._machines:
            if self._index.of_topic(resolve(topics.ROBOT_DESCRIPTION, machine)).size:
                continue
            config = resolve(topics.MACHINE_CONFIG, machine_node_of(machine, set(names)))
            numbers = self._index.of_topic(config)
            if numbers.size:
                text = self._decode(config, int(numbers[-1])).data
                spec = spec_in_config(text, machine)
                if spec is not None:
                    models[machine] = parse_urdf(description_text(spec))
        return models

    def _make_timeline(self) -> BagTimeline:
        """Return simulated time over log time, from the ledgers."""
        log_times, sim_times = [], []
        for number in self._index.of_topic(_LEDGER):
            try:
                ledger = from_multi_array(self._decode(_LEDGER, int(number)))
            except EarthmovingError:
                self.rejected += 1
                continue
            if isinstance(ledger, Ledger):
                log_times.append(int(self._index.times[number]))
                sim_times.append(ledger.stamp_sec + 1e-9 * ledger.stamp_nanosec)
        if log_times:
            return BagTimeline(np.array(log_times, dtype=np.int64), np.array(sim_times))
        times = self._index.times
        return BagTimeline.of_log_times(*(int(times[k]) if times.size else 0 for k in (0, -1)))
