"""One pass over a bag, which fills the data of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import yaml

from earthmoving_sim.run_report.machine_handlers import MachineHandlers
from earthmoving_sim.run_report.run_data import Handler, RunData, labelled, parse_config
from earthmoving_sim.run_report.soil_handlers import SoilHandlers
from msg_bridge.bag.reader import BagReader
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError

__all__ = ["read_runs"]

_NANO = 1e-9
_PROGRESS_INTERVAL = 2000  # messages
_MAX_DIFFERENCE = 10.0
"""Difference from the time of the ledger above which a stamp is that of another clock [s]."""
_SIM_CONFIG = f"/{topics.SIM_CONFIG}"
_LEDGER = f"/{topics.SOIL_LEDGER}"


def read_runs(
    reader: BagReader,
    *,
    run_id: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[RunData, list[int]]:
    """Return the data of one run of a bag, and the numbers of all its runs.

    Args:
        reader: the bag.
        run_id: number of the run; None: the last one.
        progress: is called with the fraction that has been read.

    Raises:
        BagReadError: the bag is damaged.
    """
    reading = _Reading(reader, run_id)
    wanted = list(reading.handlers)
    total = sum(reader.topics[name].count for name in wanted)
    for number, (topic, time, data) in enumerate(reader.raw_messages(wanted)):
        reading.add(topic, data, time)
        if progress is not None and number % _PROGRESS_INTERVAL == 0:
            progress(number / max(total, 1))
    if progress is not None:
        progress(1.0)
    return reading.run, reading.run_ids


class _Reading:
    """The run that is read; see `ReadingState`.

    Attributes:
        run: its data.
        run_ids: numbers of all runs so far.
        is_simulation: whether times are simulation times.
        handlers: by topic.
    """

    def __init__(self, reader: BagReader, run_id: int | None) -> None:
        self.run = RunData()
        self.run_ids: list[int] = []
        self.is_simulation = f"/{topics.SOIL_TICK}" in reader.topics
        self._has_ledger = _LEDGER in reader.topics and reader.topics[_LEDGER].count > 0
        self._reader, self._wanted_id = reader, run_id
        self._present_id: int | None = None
        self._soil, self._machines = SoilHandlers(self), MachineHandlers(self)
        self.handlers: dict[str, Handler] = {}
        for name, info in reader.topics.items():
            handler = self._handler(name, info.type.rpartition("/")[2])
            if handler is not None and reader.is_of_simulation(name):
                self.handlers[name] = handler

    def _handler(self, topic: str, kind: str) -> Handler | None:
        """Return the handler of a topic; None if it is not read."""
        if topic.endswith(f"/{topics.MACHINE_CONFIG}") and kind == "String":
            return self._soil.on_config(topic)
        return self._soil.find(topic, kind) or self._machines.find(topic, kind)

    def add(self, topic: str, data: bytes, log_time: int) -> None:
        """Handle a message; one that cannot be read is counted."""
        try:
            message = self._reader.decode(topic, data, log_time)
            if topic == _SIM_CONFIG:
                self._begin_run(int(parse_config(message.data)["run"]["run_id"]))
            elif topic == _LEDGER:
                self._note_run(int(labelled(message)["run_id"]))
            if self._wanted_id is not None and self._present_id not in (self._wanted_id, None):
                return
            self.run.first_log = log_time if self.run.first_log is None else self.run.first_log
            self.run.last_log = log_time
            self.handlers[topic](message, log_time)
        except (EarthmovingError, ValueError, TypeError, KeyError, IndexError, yaml.YAMLError):
            self.run.malformed[topic] += 1

    def _note_run(self, run_id: int) -> None:
        """Begin with the run of a ledger if no configuration of it, or of a later one, was read.

        A bag may begin in the middle of a run, and have its configuration later or never.
        """
        if self._present_id is None or run_id > self._present_id:
            self._begin_run(run_id)

    def _begin_run(self, run_id: int) -> None:
        """Begin with empty data if the run is another one than before."""
        self._present_id = run_id
        if run_id not in self.run_ids:
            self.run_ids.append(run_id)
        is_wanted = self._wanted_id in (None, run_id)
        if is_wanted and self.run.run_id not in (None, run_id):
            self.run = RunData()
        if is_wanted:
            self.run.run_id = run_id

    def seconds(self, log_time: int) -> float:
        """Return the time since the first message of the run [s]."""
        return (log_time - (self.run.first_log or log_time)) * _NANO

    def time(self, stamp: Any, log_time: int) -> float:
        """Return the simulation time of a message [s]; see `ReadingState`."""
        if not self.is_simulation:
            return self.seconds(log_time)
        time, present = float(stamp.sec) + _NANO * float(stamp.nanosec), self.run.present_time
        if present is not None and abs(time - present) > _MAX_DIFFERENCE:
            return present
        if not self._has_ledger:
            self.run.note_time(time)
        return time
