"""What a bag tells of its last run by small messages: all but the terrain, sorted by tick."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from earthmoving_sim.from_bag.words import (
    CONFIG,
    CYCLES,
    DIAGNOSTICS,
    HASH,
    JOINTS,
    LEDGER,
    MACHINE_CONFIG,
    ODOM,
    PARTICLES,
    PHASE,
    PHASE_NAMES,
    BagOutcomeError,
    Place,
    machine_section,
    words_of_run,
)
from machine_sim.operator import CycleReport
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.machine_state import BaseState
from msg_bridge.codec.sim_config import RunFacts
from msg_bridge.codec.stamps import tick_of_stamp
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader
from msg_bridge.nodes.topics import TICK_TOPIC

__all__ = ["MachineState", "Phase", "RunTold", "read_run"]

_TUNNELLED = "tunnelled"
_UNFINISHED = "the operator did not finish"


class Phase(NamedTuple):
    """What the operator was about from the end of a tick on."""

    tick: int
    cycle: int
    phase: str
    given_up: str


class MachineState(NamedTuple):
    """Pose of the base and joint angles [rad], shape (4,), at the end of a tick."""

    tick: int
    base: BaseState
    joints: NDArray[np.float64]


@dataclass
class RunTold:
    """The last run in a bag.

    Attributes:
        facts: its epoch and length of a tick.
        machine_config: parameters of the machine's node [YAML].
        last_time: log time of the last tick [ns]. The last tick is the one at which the operator's
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
    last_time: int
    wall: float
    header: SoilHeader
    ledger: Ledger
    worst_imbalance: int
    state: tuple[int, str]
    states: list[MachineState]
    phases: list[Phase]
    cycles: list[CycleReport]
    most_particles: int
    tunnelled: int
    nodes: list[str]

    @property
    def given_up(self) -> str:
        """Why it ended before its last cycle, empty if it did not."""
        end = self.phases[-1]
        return end.given_up or ("" if end.phase == "done" else _UNFINISHED)


def read_run(reader: BagReader, place: Place, went_on: Callable[[], None]) -> RunTold:
    """Read all but the terrain of the last run in a bag.

    Args:
        reader: the bag; it has all topics of `words_of_run`.
        place: of the machine.
        went_on: called after each message.

    Raises:
        BagOutcomeError: a message cannot be read, or something of the run was not recorded.
        BagReadError: the file is damaged.
    """
    words = words_of_run(place)
    heard: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    for topic, time, message in reader.messages(words):
        try:
            value = words[topic].take(message)
        except EarthmovingError as error:
            raise BagOutcomeError(f"a message on {topic}, logged at {time} ns: {error}") from error
        if value is not None:
            heard[topic].append((time, value))
        went_on()
    return _Run(reader, place, heard).told()


class _Run:
    """Takes the last run out of all that was heard."""

    def __init__(
        self, reader: BagReader, place: Place, heard: dict[str, list[tuple[int, Any]]]
    ) -> None:
        self._reader, self._place, self._heard = reader, place, heard
        self._machine = place.machine
        headers = heard[TICK_TOPIC]
        if not headers:
            raise self._lacks("a header of the soil", TICK_TOPIC)
        epoch = max(header.epoch for _, header in headers)
        began = min(time for time, header in headers if header.epoch == epoch)
        before = [time for time, header in headers if header.epoch < epoch]
        # Most messages do not say their epoch. Between two runs nothing is said for a while.
        self._began = (began + max(before)) // 2 if before else 0
        self._epoch = epoch
        self._facts = self._facts_of_run()

    def told(self) -> RunTold:
        """All there is."""
        headers: dict[int, tuple[int, SoilHeader]] = {}
        for time, header in self._heard[TICK_TOPIC]:
            if header.epoch == self._epoch:
                headers.setdefault(header.tick, (time, header))
        ledgers: dict[int, Ledger] = {}
        for ledger in self._of_run(LEDGER):
            ledgers.setdefault(ledger.tick, ledger)
        phases = self._phases()
        last = self._last(headers, ledgers, phases[-1])
        last_time, header = headers[last]
        cycles = self._of_run(self._machine + CYCLES)
        counts = self._by_tick(self._place.node + PARTICLES)
        return RunTold(
            facts=self._facts,
            machine_config=self._machine_config(),
            last_time=last_time,
            wall=(last_time - headers[0][0]) / 1e9,
            header=header,
            ledger=ledgers[last],
            worst_imbalance=max((each.imbalance for each in ledgers.values()), key=abs),
            state=self._state(last),
            states=self._states(last),
            phases=phases,
            cycles=cycles,
            most_particles=max((n for tick, n in counts.items() if tick <= last), default=0),
            tunnelled=self._tunnelled(),
            nodes=sorted({node for said in self._of_run(DIAGNOSTICS) for node in said}),
        )

    def _of_run(self, topic: str) -> list[Any]:
        return [value for time, value in self._heard[topic] if time >= self._began]

    def _by_tick(self, topic: str) -> dict[int, Any]:
        """What a stamped topic told of the end of each tick."""
        period = self._facts.tick
        try:
            return {tick_of_stamp(stamp, period): value for stamp, value in self._of_run(topic)}
        except EarthmovingError as error:
            raise BagOutcomeError(f"a message on {topic}: {error}") from error

    def _lacks(self, what: str, topic: str) -> BagOutcomeError:
        return BagOutcomeError(
            f"{self._reader.path} lacks {what} on {topic}; record all topics from the start of the"
            " run to its end, and see that the recorder keeps up"
        )

    def _facts_of_run(self) -> RunFacts:
        own: list[RunFacts] = [f for _, f in self._heard[CONFIG] if f.epoch == self._epoch]
        if not own:
            raise self._lacks(f"the configuration of epoch {self._epoch}", CONFIG)
        return own[-1]

    def _machine_config(self) -> str:
        topic = self._place.node + MACHINE_CONFIG
        if not self._heard[topic]:
            raise self._lacks("the machine's configuration", topic)
        return str(self._heard[topic][-1][1])

    def _phases(self) -> list[Phase]:
        topic = self._machine + PHASE
        said = self._of_run(topic)
        if not said:
            raise self._lacks("a word of the operator", topic)
        tick = self._facts.tick
        return [
            Phase(round(each["time"] / tick), *(each[name] for name in PHASE_NAMES))
            for each in said
        ]

    def _last(self, headers: dict[int, Any], ledgers: dict[int, Ledger], end: Phase) -> int:
        """The last tick of the run, up to which no header and no ledger may be missing."""
        whole, newest = -1, max(headers)
        while whole + 1 in headers and whole + 1 in ledgers:
            whole += 1
        done = end.phase == "done"
        if whole < (end.tick if done else max(newest - 1, 1)):
            topic = LEDGER if whole + 1 in headers else TICK_TOPIC
            raise self._lacks(f"tick {whole + 1} of {newest}", topic)
        if done:
            # A machine in lockstep does not wait for the command that does not come until then.
            delay = (
                0 if self._facts.realtime else _command_delay(self._machine_config(), self._place)
            )
            return min(end.tick + delay, whole)
        # A file that breaks off may have lost rows of its last tick.
        return max(whole - 1, 1) if self._reader.truncated else whole

    def _state(self, last: int) -> tuple[int, str]:
        known: list[tuple[int, str]] = [s for s in self._of_run(HASH) if s[0] <= last]
        if not known:
            raise self._lacks(f"a hash of tick 0 to {last}", HASH)
        return max(known)

    def _states(self, last: int) -> list[MachineState]:
        names = (self._machine + ODOM, self._machine + JOINTS)
        bases, joints = map(self._by_tick, names)
        both = sorted(tick for tick in bases.keys() & joints.keys() if tick <= last)
        if not both:
            raise self._lacks("a tick that is told of both", " and ".join(names))
        return [MachineState(tick, bases[tick], joints[tick]) for tick in both]

    def _tunnelled(self) -> int:
        """As the machine's node, whatever its name, said last."""
        for said in reversed(self._of_run(DIAGNOSTICS)):
            for node, values in said.items():
                own = node.rpartition("/")[0] == self._place.node.strip("/")
                if own and values.get(_TUNNELLED, "").isdigit():
                    return int(values[_TUNNELLED])
        raise self._lacks(f"{_TUNNELLED!r} of a node of {self._place.node or '/'}", DIAGNOSTICS)


def _command_delay(text: str, place: Place) -> int:
    """Ticks for which the machine goes on once its operator has left the levers, in lockstep.

    Args:
        text: the configuration of its node [YAML]; 0 if it names no delay.
        place: of the machine.
    """
    try:
        return int(machine_section(text, place)["command_delay"])
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        return 0
