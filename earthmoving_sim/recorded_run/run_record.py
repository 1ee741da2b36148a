"""Sort the small messages of a bag's last run by tick, and find its last tick."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from dig_operator import CycleReport, LoadReport
from earthmoving_sim.recorded_run.topic_decoders import (
    CYCLES_SUFFIX,
    DIAGNOSTICS_TOPIC,
    JOINT_STATES_SUFFIX,
    LEDGER_TOPIC,
    MACHINE_CONFIG_SUFFIX,
    ODOM_SUFFIX,
    PARTICLES_SUFFIX,
    PHASE_FIELDS,
    PHASE_SUFFIX,
    SIM_CONFIG_TOPIC,
    SOIL_HEADER_TOPIC,
    STATE_HASH_TOPIC,
    Namespaces,
    RecordedRunError,
    machine_config_section,
    run_topic_decoders,
)
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.machine_state import BaseState
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.codec.state_hash import StateHash
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader

__all__ = ["MachineState", "OperatorPhase", "RunRecord", "TruckRecord", "read_run"]

_TUNNELLED_KEY = "tunnelled"
_UNFINISHED = "the operator did not finish"


class OperatorPhase(NamedTuple):
    """A phase of the operator.

    Attributes:
        tick: the tick at whose end it began.
        cycle: number of the dig cycle.
        phase: name of the phase.
        abort_reason: why the operator stopped before its last cycle; empty if it did not.
    """

    tick: int
    cycle: int
    phase: str
    abort_reason: str


class MachineState(NamedTuple):
    """Pose of the base and joint angles [rad], shape (4,), at the end of a tick."""

    tick: int
    base: BaseState
    joints: NDArray[np.float64]


class TruckRecord(NamedTuple):
    """What a truck did.

    Attributes:
        base: pose of its base at the end.
        joints: its joint angles by name at the end [rad].
        phases: phases of its operator, in order.
        loads: one report per load.
    """

    base: BaseState
    joints: dict[str, float]
    phases: list[OperatorPhase]
    loads: list[LoadReport]


@dataclass
class RunRecord:
    """The last run in a bag.

    Attributes:
        facts: number of the run and tick period.
        machine_config: configuration of the machine node [YAML].
        last_log_time: log time of the last tick [ns]. The last tick is the one at which the
            operator's last command took effect, or else the last that was recorded completely.
        wall_time: log time from the first tick to the last [s].
        header, ledger: of the last tick.
        max_imbalance: the largest of all ticks, those after the last included, signed [mm^3].
        state_hash: the newest hash of the terrain up to the last tick.
        states: the machine's states up to the last tick, in order.
        phases: the operator's phases, in order.
        cycles: one report per cycle.
        max_particles: the largest number of particles in a published message.
        tunnelled: number of tunnelled particles in the last diagnostics of the machine node.
        nodes: names of the nodes that published on /diagnostics, sorted.
        truck: the truck that was loaded; None without one.
    """

    facts: RunFacts
    machine_config: str
    last_log_time: int
    wall_time: float
    header: SoilHeader
    ledger: Ledger
    max_imbalance: int
    state_hash: StateHash
    states: list[MachineState]
    phases: list[OperatorPhase]
    cycles: list[CycleReport]
    max_particles: int
    tunnelled: int
    nodes: list[str]
    truck: TruckRecord | None = None

    @property
    def abort_reason(self) -> str:
        """Why the run ended before its last cycle or load; empty if it did not."""
        ends = [self.phases[-1], *([self.truck.phases[-1]] if self.truck else [])]
        reasons = [end.abort_reason or ("" if end.phase == "done" else _UNFINISHED) for end in ends]
        return next(filter(None, reasons), "")


def read_run(
    reader: BagReader, namespaces: Namespaces, on_message: Callable[[], None]
) -> RunRecord:
    """Read all of the last run in a bag but its terrain.

    Args:
        reader: the bag; it has all topics of `run_topic_decoders`.
        namespaces: those of the machine.
        on_message: called after each message.

    Raises:
        RecordedRunError: a message cannot be read, or is missing.
        BagReadError: the file is damaged.
    """
    decoders = run_topic_decoders(namespaces)
    values: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    for topic, time, message in reader.messages(decoders):
        try:
            value = decoders[topic].decode(message)
        except EarthmovingError as error:
            raise RecordedRunError(f"a message on {topic}, logged at {time} ns: {error}") from error
        if value is not None:
            values[topic].append((time, value))
        on_message()
    return _RunBuilder(reader, namespaces, values).build()


class _RunBuilder:
    """Selects the messages of the last run in a bag and builds its record."""

    def __init__(
        self, reader: BagReader, namespaces: Namespaces, values: dict[str, list[tuple[int, Any]]]
    ) -> None:
        """Find the last run.

        Args:
            reader: the bag.
            namespaces: those of the machine.
            values: log time [ns] and decoded value of each message, by topic.
        """
        self._reader, self._namespaces, self._values = reader, namespaces, values
        headers = values[SOIL_HEADER_TOPIC]
        if not headers:
            raise self._missing_error("a header of the soil", SOIL_HEADER_TOPIC)
        run_id = max(header.run_id for _, header in headers)
        start = min(time for time, header in headers if header.run_id == run_id)
        before = [time for time, header in headers if header.run_id < run_id]
        # Most messages do not have a run id. Nothing is published for a while between two runs,
        # so their messages are separated at half that time.
        self._start_time = (start + max(before)) // 2 if before else 0
        self._run_id = run_id
        self._facts = self._find_run_facts()

    def build(self) -> RunRecord:
        """Build the record of the run."""
        headers: dict[int, tuple[int, SoilHeader]] = {}
        for time, header in self._values[SOIL_HEADER_TOPIC]:
            if header.run_id == self._run_id:
                headers.setdefault(header.tick, (time, header))
        ledgers: dict[int, Ledger] = {}
        for _, ledger in self._values[LEDGER_TOPIC]:
            if ledger.run_id == self._run_id:
                ledgers.setdefault(ledger.tick, ledger)
        phases = self._phases(self._namespaces.machine)
        truck = self._namespaces.truck
        # The run ends with the task of the truck's operator.
        truck_phases = self._phases(truck) if truck else []
        last = self._find_last_tick(headers, ledgers, (truck_phases or phases)[-1])
        last_log_time, header = headers[last]
        counts = self._by_tick(self._namespaces.node + PARTICLES_SUFFIX)
        diagnostics = self._values_of_run(DIAGNOSTICS_TOPIC)
        return RunRecord(
            facts=self._facts,
            machine_config=self._machine_config(),
            last_log_time=last_log_time,
            wall_time=(last_log_time - headers[0][0]) / 1e9,
            header=header,
            ledger=ledgers[last],
            max_imbalance=max((each.imbalance for each in ledgers.values()), key=abs),
            state_hash=self._latest_state_hash(last),
            states=self._machine_states(last),
            phases=phases,
            cycles=self._values_of_run(self._namespaces.machine + CYCLES_SUFFIX),
            max_particles=max((n for tick, n in counts.items() if tick <= last), default=0),
            tunnelled=self._count_tunnelled(diagnostics),
            nodes=sorted({node for statuses in diagnostics for node in statuses}),
            truck=self._truck_record(last, truck_phases) if truck else None,
        )

    def _truck_record(self, last: int, phases: list[OperatorPhase]) -> TruckRecord:
        """Return what the truck did up to a tick."""
        truck = self._namespaces.truck
        topics = (truck + ODOM_SUFFIX, truck + JOINT_STATES_SUFFIX)
        bases, joints = map(self._by_tick, topics)
        ticks = [tick for tick in bases.keys() & joints.keys() if tick <= last]
        if not ticks:
            raise self._missing_error("messages of the same tick", " and ".join(topics))
        end = max(ticks)
        loads = self._values_of_run(truck + CYCLES_SUFFIX)
        return TruckRecord(bases[end], joints[end], phases, loads)

    def _values_of_run(self, topic: str) -> list[Any]:
        return [value for time, value in self._values[topic] if time >= self._start_time]

    def _by_tick(self, topic: str) -> dict[int, Any]:
        """Return the values of a stamped topic by the tick at whose end they were measured."""
        period = self._facts.tick_period
        try:
            return {
                tick_from_stamp(stamp, period): value for stamp, value in self._values_of_run(topic)
            }
        except EarthmovingError as error:
            raise RecordedRunError(f"a message on {topic}: {error}") from error

    def _missing_error(self, what: str, topic: str) -> RecordedRunError:
        return RecordedRunError(
            f"{self._reader.path} lacks {what} on {topic}; record all topics from the start of the"
            " run to its end, and reduce the load so that the recorder keeps up"
        )

    def _find_run_facts(self) -> RunFacts:
        own: list[RunFacts] = [
            facts for _, facts in self._values[SIM_CONFIG_TOPIC] if facts.run_id == self._run_id
        ]
        if not own:
            raise self._missing_error(f"the configuration of run {self._run_id}", SIM_CONFIG_TOPIC)
        return own[-1]

    def _machine_config(self) -> str:
        topic = self._namespaces.node + MACHINE_CONFIG_SUFFIX
        if not self._values[topic]:
            raise self._missing_error("the machine's configuration", topic)
        return str(self._values[topic][-1][1])

    def _phases(self, machine: str) -> list[OperatorPhase]:
        """Return the phases of the operator of a machine."""
        topic = machine + PHASE_SUFFIX
        messages = self._values_of_run(topic)
        if not messages:
            raise self._missing_error("a phase of the operator", topic)
        period = self._facts.tick_period
        return [
            OperatorPhase(round(each["time"] / period), *(each[name] for name in PHASE_FIELDS))
            for each in messages
        ]

    def _find_last_tick(
        self, headers: dict[int, Any], ledgers: dict[int, Ledger], end: OperatorPhase
    ) -> int:
        """Return the last tick of the run.

        Args:
            headers, ledgers: by tick; none may be missing up to the last tick.
            end: the operator's last phase.
        """
        complete, newest = -1, max(headers)
        while complete + 1 in headers and complete + 1 in ledgers:
            complete += 1
        is_done = end.phase == "done"
        if complete < (end.tick if is_done else max(newest - 1, 1)):
            topic = LEDGER_TOPIC if complete + 1 in headers else SOIL_HEADER_TOPIC
            raise self._missing_error(f"tick {complete + 1} of {newest}", topic)
        if is_done:
            # In lockstep the last command takes effect only after the command delay.
            delay = 0 if self._facts.realtime else self._command_delay()
            return min(end.tick + delay, complete)
        # A file without an end may have lost rows of its last tick.
        return max(complete - 1, 1) if self._reader.truncated else complete

    def _command_delay(self) -> int:
        """Return the machine's command delay [ticks]; 0 if its configuration has none."""
        try:
            section = machine_config_section(self._machine_config(), self._namespaces)
            return int(section["command_delay"])
        except (yaml.YAMLError, KeyError, TypeError, ValueError):
            return 0

    def _latest_state_hash(self, last: int) -> StateHash:
        hashes: list[StateHash] = [
            each
            for _, each in self._values[STATE_HASH_TOPIC]
            if each.run_id == self._run_id and each.tick <= last
        ]
        if not hashes:
            raise self._missing_error(f"a hash of tick 0 to {last}", STATE_HASH_TOPIC)
        return max(hashes, key=lambda each: each.tick)

    def _machine_states(self, last: int) -> list[MachineState]:
        """Return the machine's states of all ticks with both a base pose and joint angles."""
        machine = self._namespaces.machine
        topics = (machine + ODOM_SUFFIX, machine + JOINT_STATES_SUFFIX)
        bases, joints = map(self._by_tick, topics)
        ticks = sorted(tick for tick in bases.keys() & joints.keys() if tick <= last)
        if not ticks:
            raise self._missing_error("messages of the same tick", " and ".join(topics))
        return [MachineState(tick, bases[tick], joints[tick]) for tick in ticks]

    def _count_tunnelled(self, diagnostics: list[dict[str, dict[str, str]]]) -> int:
        """Return the last count of tunnelled particles that the machine node published."""
        namespace = f"{self._reader.namespace}{self._namespaces.node}".strip("/")
        for statuses in reversed(diagnostics):
            for node, values in statuses.items():
                is_own = node.rpartition("/")[0] == namespace
                if is_own and values.get(_TUNNELLED_KEY, "").isdigit():
                    return int(values[_TUNNELLED_KEY])
        raise self._missing_error(
            f"{_TUNNELLED_KEY!r} of a node of /{namespace}", DIAGNOSTICS_TOPIC
        )
