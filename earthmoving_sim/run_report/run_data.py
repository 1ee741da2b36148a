"""What is kept of a run."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

from earthmoving_sim.received_numbers import ReceivedNumbers
from earthmoving_sim.run_report.latency import CommandLatency
from earthmoving_sim.run_report.problems import Problems
from earthmoving_sim.run_report.terrain_history import TerrainHistory
from earthmoving_sim.run_report.trace import Trace
from earthmoving_sim.run_report.way import Way
from msg_bridge.codec.labelled_array import array_label
from msg_bridge.yaml_text import load_yaml

__all__ = [
    "Handler",
    "MachineData",
    "MovedVolumes",
    "PhaseChange",
    "ReadingState",
    "RunData",
    "TopicHandlers",
    "labelled",
    "parse_config",
]

_FULL = 2_000_000
"""Samples of payload and swing are kept in full, for cycles: 11 hours at 50 Hz."""


class PhaseChange(NamedTuple):
    """A phase of the operator that begins: time [s], number of the cycle, and name."""

    time: float
    cycle: int
    phase: str


def _traces() -> defaultdict[str, Trace]:
    return defaultdict(Trace)


@dataclass
class MachineData:
    """What is kept of a machine.

    Attributes:
        payload: bank volume in its tools [m^3].
        fill: loose volume as a fraction of the heaped capacity.
        swing: angular velocity of the swing [rad/s].
        positions, velocities, efforts: by joint.
        commands: applied velocities by joint or track.
        cylinders, tracks: labelled values by label.
        forces: magnitude of the force of the soil on each tool [N].
        way: way of the base.
        tilt: pitch and roll [rad] by name.
        phases: changes of the operator's phase.
        reports: completed cycles or loads of the operator.
        latency: times from commands to their effect.
    """

    payload: Trace = field(default_factory=lambda: Trace(_FULL))
    fill: Trace = field(default_factory=Trace)
    swing: Trace = field(default_factory=lambda: Trace(_FULL))
    positions: defaultdict[str, Trace] = field(default_factory=_traces)
    velocities: defaultdict[str, Trace] = field(default_factory=_traces)
    efforts: defaultdict[str, Trace] = field(default_factory=_traces)
    commands: defaultdict[str, Trace] = field(default_factory=_traces)
    cylinders: defaultdict[str, Trace] = field(default_factory=_traces)
    tracks: defaultdict[str, Trace] = field(default_factory=_traces)
    forces: defaultdict[str, Trace] = field(default_factory=_traces)
    way: Way = field(default_factory=Way)
    tilt: defaultdict[str, Trace] = field(default_factory=_traces)
    phases: list[PhaseChange] = field(default_factory=list)
    reports: list[dict[str, Any]] = field(default_factory=list)
    latency: CommandLatency = field(default_factory=CommandLatency)


@dataclass
class MovedVolumes:
    """Sums of conversion rows.

    Attributes:
        received: numbers of the rows.
    """

    received: ReceivedNumbers = field(default_factory=ReceivedNumbers)
    _sums: dict[tuple[int, int], int] = field(default_factory=dict)  # mm^3

    def add(self, totals: defaultdict[int, Trace], machine_id: int, time: float, mm3: int) -> None:
        """Add a volume to the total of a machine.

        Args:
            totals: traces of the total volume [m^3] by machine id.
            machine_id: id of the machine.
            time: simulation time [s].
            mm3: volume [mm^3].
        """
        key = (id(totals), machine_id)
        self._sums[key] = self._sums.get(key, 0) + mm3
        totals[machine_id].add(time, self._sums[key] * 1e-9)


@dataclass
class RunData:
    """What is kept of a run.

    Attributes:
        run_id: number of the run; None if the bag does not name it.
        configs: configuration of each node, by the namespace of its topic.
        first_log, last_log: log times of its first and last message [ns].
        first_time, last_time: simulation times [s].
        first_tick: tick of the first ledger; None before it.
        present_time: simulation time of the last ledger [s]; None before the first one.
        terrain: the terrain at begin and end.
        accounts: volume of each account of the ledger [m^3].
        imbalance: imbalance of the ledger [mm^3].
        excavated, deposited: volume so far [m^3], by machine id.
        volumes: sums of the conversion rows.
        clock: simulation time over log time [s from the first message].
        late_ticks, real_time_factor: of the soil node, by log time [s from the first message].
        machines: by namespace.
        problems: what nodes reported in `/diagnostics`.
        diagnostics: last values of each node.
        rejections: reasons of join rejections.
        paused: changes of the pause: time [s from the first message] and state.
        design: remaining volumes to cut and to fill [m^3], if there is a design.
        malformed: number of messages that cannot be read, by topic.
    """

    run_id: int | None = None
    configs: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    first_log: int | None = None
    last_log: int = 0
    first_time: float | None = None
    last_time: float = 0.0
    first_tick: int | None = None
    present_time: float | None = None
    terrain: TerrainHistory = field(default_factory=TerrainHistory)
    accounts: defaultdict[str, Trace] = field(default_factory=_traces)
    imbalance: Trace = field(default_factory=Trace)
    excavated: defaultdict[int, Trace] = field(default_factory=lambda: defaultdict(Trace))
    deposited: defaultdict[int, Trace] = field(default_factory=lambda: defaultdict(Trace))
    volumes: MovedVolumes = field(default_factory=MovedVolumes)
    clock: Trace = field(default_factory=Trace)
    late_ticks: Trace = field(default_factory=Trace)
    real_time_factor: Trace = field(default_factory=Trace)
    machines: defaultdict[str, MachineData] = field(
        default_factory=lambda: defaultdict(MachineData)
    )
    problems: Problems = field(default_factory=Problems)
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)
    rejections: list[str] = field(default_factory=list)
    paused: list[tuple[float, bool]] = field(default_factory=list)
    design: defaultdict[str, Trace] = field(default_factory=_traces)
    malformed: Counter[str] = field(default_factory=Counter)

    @property
    def simulated_time(self) -> float:
        """Simulated time [s]."""
        return 0.0 if self.first_time is None else self.last_time - self.first_time

    @property
    def wall_time(self) -> float:
        """Time between the first and the last message in log time [s]."""
        return 0.0 if self.first_log is None else (self.last_log - self.first_log) * 1e-9

    @property
    def time_span(self) -> tuple[float, float]:
        """Begin and end of what is recorded [s], in the time of its messages."""
        if self.first_time is None:
            return 0.0, self.wall_time
        return self.first_time, self.last_time

    def note_time(self, time: float) -> None:
        """Note a simulation time [s] of a message."""
        self.first_time = time if self.first_time is None else min(self.first_time, time)
        self.last_time = max(self.last_time, time)


class ReadingState(Protocol):
    """The run that is read."""

    @property
    def run(self) -> RunData:
        """Its data, which are others when the next run begins."""

    @property
    def is_simulation(self) -> bool:
        """Whether times are simulation times; else they are log times."""

    def seconds(self, log_time: int) -> float:
        """Return the time since the first message of the run [s].

        Args:
            log_time: a log time [ns].
        """

    def time(self, stamp: Any, log_time: int) -> float:
        """Return the simulation time of a message [s]; without a simulation, `seconds`.

        That of a message with a stamp of another clock is that of the ledger before it.

        Args:
            stamp: its stamp, a builtin_interfaces/Time.
            log_time: its log time [ns].
        """


class TopicHandlers:
    """Handlers of some topics, which add their messages to the data of the run that is read."""

    def __init__(self, reading: ReadingState) -> None:
        """
        Args:
            reading: the run that is read.
        """
        self._reading = reading

    def find(self, topic: str, kind: str) -> Handler | None:
        """Return the handler of a topic; None if it is not one of these.

        Args:
            topic: its name, relative to the simulation.
            kind: its message type without the package.
        """
        raise NotImplementedError


@lru_cache(maxsize=32)  # the recorder repeats configurations, and parsing one takes 15 ms
def parse_config(text: str) -> Mapping[str, Any]:
    """Return the configuration of a node.

    Raises:
        yaml.YAMLError, TypeError: it is no mapping of sections.
    """
    content = load_yaml(text)
    if not isinstance(content, dict):
        raise TypeError("a configuration has sections by name")
    return content


def labelled(message: Any) -> dict[str, float]:
    """Return the values of a labelled array by name.

    Raises:
        CodecError: it has no labels.
    """
    return dict(zip(array_label(message).split(","), message.data, strict=True))


Handler = Callable[[Any, int], None]
"""Handles a message with its log time [ns]."""
