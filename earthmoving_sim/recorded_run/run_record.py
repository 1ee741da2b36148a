"""What a bag tells of its last run by small messages: all but the terrain, sorted by tick."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from dig_operator import CycleReport
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
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader
from msg_bridge.contract.topics import SOIL_HEADER_TOPIC

__all__ = ["MachineState", "OperatorPhase", "RunRecord", "read_run"]

_TUNNELLED = "tunnelled"
_UNFINISHED = "the operator did not finish"


class OperatorPhase(NamedTuple):
    """What the operator was about from the end of a tick on."""

    tick: int
    cycle: int
    phase: str
    abort_reason: str


class MachineState(NamedTuple):
    """Pose of the base and joint angles [rad], shape (4,), at the end of a tick."""

    tick: int
    base: BaseState
    joints: NDArray[np.float64]


@dataclass
class RunRecord:
    """The last run in a bag.

    Attributes:
        facts: its epoch and length of a tick.
        machine_config: parameters of the machine's node [YAML].
        last_log_time: log time of the last tick [ns]. The last tick is the one at which the operator's
            last command had counted its time, or else the last of which all is known.
        wall: log time from the first tick to the last [s].
        header, ledger: of the last tick.
        worst_imbalance: of all ticks, those after the last included [mm^3].
        state: the newest hash of the terrain up to the last tick, and the tick it was taken after.
        states: where the machine was, up to the last tick.
        phases: what the operator was about, in order.
        cycles: one report for each cycle.
        most_particles: largest number published.
        tunnelled: as the machine's node said last.
        nodes: names of the nodes that spoke on /diagnostics.
    """

    facts: RunFacts
    machine_config: str
    last_log_time: int
    wall_time: float
    header: SoilHeader
    ledger: Ledger
    max_imbalance: int
    state: tuple[int, str]
    states: list[MachineState]
    phases: list[OperatorPhase]
    cycles: list[CycleReport]
    max_particles: int
    tunnelled: int
    nodes: list[str]

    @property
    def abort_reason(self) -> str:
        """Why it ended before its last cycle, empty if it did not."""
        end = self.phases[-1]
        return end.abort_reason or ("" if end.phase == "done" else _UNFINISHED)


def read_run(
    reader: BagReader, namespaces: Namespaces, on_message: Callable[[], None]
) -> RunRecord:
    """Read all but the terrain of the last run in a bag.

    Args:
        reader: the bag; it has all topics of `run_topic_decoders`.
        place: of the machine.
        on_message: called after each message.

    Raises:
        RecordedRunError: a message cannot be read, or something of the run was not recorded.
        BagReadError: the file is damaged.
    """
    words = run_topic_decoders(namespaces)
    heard: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    for topic, time, message in reader.messages(words):
        try:
            value = words[topic].decode(message)
        except EarthmovingError as error:
            raise RecordedRunError(f"a message on {topic}, logged at {time} ns: {error}") from error
        if value is not None:
            heard[topic].append((time, value))
        on_message()
    return _RunReader(reader, namespaces, heard).build_record()


class _RunReader:
    """Takes the last run out of all that was heard."""

    def __init__(
        self, reader: BagReader, namespaces: Namespaces, heard: dict[str, list[tuple[int, Any]]]
    ) -> None:
        self._reader, self._namespaces, self._messages = reader, namespaces, heard
        self._machine = namespaces.machine
        headers = heard[SOIL_HEADER_TOPIC]
        if not headers:
            raise self._missing_error("a header of the soil", SOIL_HEADER_TOPIC)
        run_id = max(header.run_id for _, header in headers)
        began = min(time for time, header in headers if header.run_id == run_id)
        before = [time for time, header in headers if header.run_id < run_id]
        # Most messages do not say their epoch. Between two runs nothing is said for a while.
        self._start_time = (began + max(before)) // 2 if before else 0
        self._run_id = run_id
        self._facts = self._find_run_facts()

    def build_record(self) -> RunRecord:
        """All there is."""
        headers: dict[int, tuple[int, SoilHeader]] = {}
        for time, header in self._messages[SOIL_HEADER_TOPIC]:
            if header.run_id == self._run_id:
                headers.setdefault(header.tick, (time, header))
        ledgers: dict[int, Ledger] = {}
        for ledger in self._messages_of_run(LEDGER_TOPIC):
            ledgers.setdefault(ledger.tick, ledger)
        phases = self._phases()
        last = self._find_last_tick(headers, ledgers, phases[-1])
        last_log_time, header = headers[last]
        cycles = self._messages_of_run(self._machine + CYCLES_SUFFIX)
        counts = self._by_tick(self._namespaces.node + PARTICLES_SUFFIX)
        return RunRecord(
            facts=self._facts,
            machine_config=self._machine_config(),
            last_log_time=last_log_time,
            wall_time=(last_log_time - headers[0][0]) / 1e9,
            header=header,
            ledger=ledgers[last],
            max_imbalance=max((each.imbalance for each in ledgers.values()), key=abs),
            state=self._latest_state_hash(last),
            states=self._machine_states(last),
            phases=phases,
            cycles=cycles,
            max_particles=max((n for tick, n in counts.items() if tick <= last), default=0),
            tunnelled=self._tunnelled(),
            nodes=sorted(
                {node for said in self._messages_of_run(DIAGNOSTICS_TOPIC) for node in said}
            ),
        )

    def _messages_of_run(self, topic: str) -> list[Any]:
        return [value for time, value in self._messages[topic] if time >= self._start_time]

    def _by_tick(self, topic: str) -> dict[int, Any]:
        """What a stamped topic told of the end of each tick."""
        period = self._facts.tick_period
        try:
            return {
                tick_from_stamp(stamp, period): value
                for stamp, value in self._messages_of_run(topic)
            }
        except EarthmovingError as error:
            raise RecordedRunError(f"a message on {topic}: {error}") from error

    def _missing_error(self, what: str, topic: str) -> RecordedRunError:
        return RecordedRunError(
            f"{self._reader.path} lacks {what} on {topic}; record all topics from the start of the"
            " run to its end, and see that the recorder keeps up"
        )

    def _find_run_facts(self) -> RunFacts:
        own: list[RunFacts] = [
            f for _, f in self._messages[SIM_CONFIG_TOPIC] if f.run_id == self._run_id
        ]
        if not own:
            raise self._missing_error(
                f"the configuration of epoch {self._run_id}", SIM_CONFIG_TOPIC
            )
        return own[-1]

    def _machine_config(self) -> str:
        topic = self._namespaces.node + MACHINE_CONFIG_SUFFIX
        if not self._messages[topic]:
            raise self._missing_error("the machine's configuration", topic)
        return str(self._messages[topic][-1][1])

    def _phases(self) -> list[OperatorPhase]:
        topic = self._machine + PHASE_SUFFIX
        said = self._messages_of_run(topic)
        if not said:
            raise self._missing_error("a word of the operator", topic)
        tick = self._facts.tick_period
        return [
            OperatorPhase(round(each["time"] / tick), *(each[name] for name in PHASE_FIELDS))
            for each in said
        ]

    def _find_last_tick(
        self, headers: dict[int, Any], ledgers: dict[int, Ledger], end: OperatorPhase
    ) -> int:
        """The last tick of the run, up to which no header and no ledger may be missing."""
        whole, newest = -1, max(headers)
        while whole + 1 in headers and whole + 1 in ledgers:
            whole += 1
        done = end.phase == "done"
        if whole < (end.tick if done else max(newest - 1, 1)):
            topic = LEDGER_TOPIC if whole + 1 in headers else SOIL_HEADER_TOPIC
            raise self._missing_error(f"tick {whole + 1} of {newest}", topic)
        if done:
            # A machine in lockstep does not wait for the command that does not come until then.
            delay = (
                0
                if self._facts.realtime
                else _command_delay(self._machine_config(), self._namespaces)
            )
            return min(end.tick + delay, whole)
        # A file that breaks off may have lost rows of its last tick.
        return max(whole - 1, 1) if self._reader.truncated else whole

    def _latest_state_hash(self, last: int) -> tuple[int, str]:
        known: list[tuple[int, str]] = [
            s for s in self._messages_of_run(STATE_HASH_TOPIC) if s[0] <= last
        ]
        if not known:
            raise self._missing_error(f"a hash of tick 0 to {last}", STATE_HASH_TOPIC)
        return max(known)

    def _machine_states(self, last: int) -> list[MachineState]:
        names = (self._machine + ODOM_SUFFIX, self._machine + JOINT_STATES_SUFFIX)
        bases, joints = map(self._by_tick, names)
        both = sorted(tick for tick in bases.keys() & joints.keys() if tick <= last)
        if not both:
            raise self._missing_error("a tick that is told of both", " and ".join(names))
        return [MachineState(tick, bases[tick], joints[tick]) for tick in both]

    def _tunnelled(self) -> int:
        """As the machine's node, whatever its name, said last."""
        for said in reversed(self._messages_of_run(DIAGNOSTICS_TOPIC)):
            for node, values in said.items():
                own = node.rpartition("/")[0] == self._namespaces.node.strip("/")
                if own and values.get(_TUNNELLED, "").isdigit():
                    return int(values[_TUNNELLED])
        raise self._missing_error(
            f"{_TUNNELLED!r} of a node of {self._namespaces.node or '/'}", DIAGNOSTICS_TOPIC
        )


def _command_delay(text: str, namespaces: Namespaces) -> int:
    """Ticks for which the machine goes on once its operator has left the levers, in lockstep.

    Args:
        text: the configuration of its node [YAML]; 0 if it names no delay.
        place: of the machine.
    """
    try:
        return int(machine_config_section(text, namespaces)["command_delay"])
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        return 0
