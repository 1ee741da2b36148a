"""What a bag has of each run: configurations, sessions of machines, state hashes.

All of it is small or rare, and is read before the ticks: whether a machine left or was dropped, for
example, shows only in what follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from earthmoving_sim.replay.errors import ReplayError
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.run_config import parse_run_facts, parse_section, parse_session, versions
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract import topics
from msg_bridge.contract.messages import MachineHeader, Verb
from msg_bridge.exchange.session_key import MAX_SESSION_ID

__all__ = ["MAX_END_LAG", "NodeStart", "RunSurvey", "SessionId", "survey_runs"]

_SIM_CONFIG = f"/{topics.SIM_CONFIG}"
_SOIL_HASH = f"/{topics.SOIL_STATE_HASH}"
_MACHINE_TICK = f"/{topics.MACHINE_TICK}"
_MACHINE_CONFIG = f"/{topics.MACHINE_CONFIG}"
_MACHINE_HASH = f"/{topics.MACHINE_STATE_HASH}"

MAX_END_LAG = 10
"""Maximum number of ticks by which messages of one topic end before those of another: a recorder
that is stopped has received some messages of the last ticks, and not others."""

_PROGRESS_STEPS = 100
"""Number of calls to report the progress of reading a bag."""


class SessionId(NamedTuple):
    """A session of a machine node."""

    machine_id: int
    session_id: int


class NodeStart(NamedTuple):
    """A process of a machine node that entered a run.

    Attributes:
        namespace: namespace of the node.
        config: its configuration [YAML].
        terrain_revision: revision of the terrain on which it placed its machines.
    """

    namespace: str
    config: str
    terrain_revision: int


@dataclass
class RunSurvey:
    """What a bag has of one run.

    Attributes:
        run_id: number of the run.
        config: configuration of the soil node [YAML]; empty if the bag has none.
        nodes: namespace of each machine node, by machine id.
        starts: processes of machine nodes by their first session.
        last_ticks: last tick of each session that ended with LEAVE.
        hashes: state hash by topic and tick.
        newest_tick: last tick of which there is a header of a machine or a state hash.
        tick_periods: tick period of each run of the bag that has a configuration [s], by run id.
    """

    run_id: int
    config: str = ""
    nodes: dict[int, str] = field(default_factory=dict)
    starts: dict[SessionId, NodeStart] = field(default_factory=dict)
    last_ticks: dict[SessionId, int] = field(default_factory=dict)
    hashes: dict[str, dict[int, str]] = field(default_factory=dict)
    newest_tick: int = -1
    tick_periods: Mapping[int, float] = field(default_factory=dict)

    def check_configurations(self, bag: Path) -> None:
        """Check that there is a configuration of each machine node with what a replay needs.

        Args:
            bag: path of the bag, for the error.

        Raises:
            ReplayError: there is none.
        """
        placed = {s.namespace for s in self.starts.values() if s.terrain_revision >= 0}
        for namespace in self.nodes.values():
            if namespace not in placed:
                raise ReplayError(
                    f"{bag} lacks the configuration of {namespace} in run {self.run_id} with"
                    " session and terrain_revision; it was recorded by an older version, or not"
                    " from the begin of the run: record it again"
                )

    def check_end(self, last_tick: int) -> None:
        """Check that nothing in the bag is later than its last tick of the soil.

        Args:
            last_tick: that tick.

        Raises:
            ReplayError: headers of the soil are missing.
        """
        if self.newest_tick > last_tick + MAX_END_LAG:
            raise ReplayError(
                f"the bag has messages of machines up to tick {self.newest_tick}, and no header of"
                f" the soil after tick {last_tick}"
            )

    @property
    def other_versions(self) -> dict[str, tuple[str, str]]:
        """Software of another version than recorded: (recorded, here), by name."""
        recorded = parse_section(self.config, "versions")
        here = versions()
        return {
            name: (str(recorded[name]), here[name])
            for name in here
            if name in recorded and str(recorded[name]) != here[name]
        }


def survey_runs(
    reader: BagReader, progress: Callable[[float], None] | None = None
) -> list[RunSurvey]:
    """Return what a bag has of each run, in the order of the runs.

    Args:
        reader: the bag.
        progress: called now and then with the fraction read [0..1].

    Raises:
        BagReadError: the bag is damaged.
    """
    runs: dict[int, RunSurvey] = {}
    machine_nodes = [
        name.removesuffix(_MACHINE_TICK)
        for name in reader.topics
        if name.endswith(_MACHINE_TICK) and reader.is_of_simulation(name)
    ]
    wanted = {_SIM_CONFIG, _SOIL_HASH}
    for node in machine_nodes:
        wanted |= {node + suffix for suffix in (_MACHINE_TICK, _MACHINE_CONFIG, _MACHINE_HASH)}
    handlers = {_MACHINE_TICK: _add_header, _MACHINE_HASH: _add_hash, _MACHINE_CONFIG: _add_config}
    wanted &= reader.topics.keys()
    total = sum(reader.topics[name].count for name in wanted)
    step = max(1, total // _PROGRESS_STEPS)
    for number, (topic, _, message) in enumerate(reader.messages(wanted), 1):
        if progress is not None and number % step == 0:
            progress(number / total)
        handler = handlers.get(topic[topic.rindex("/") :], _add_hash)
        try:
            handler(runs, topic, message)
        except (CodecError, AttributeError, KeyError, TypeError, ValueError):
            continue  # a message of another program
    found = [runs[run_id] for run_id in sorted(runs) if runs[run_id].config]
    tick_periods = {each.run_id: parse_run_facts(each.config).tick_period for each in found}
    for each in found:
        each.tick_periods = tick_periods
    return found


def _run(runs: dict[int, RunSurvey], run_id: int) -> RunSurvey:
    return runs.setdefault(run_id, RunSurvey(run_id))


def _add_config(runs: dict[int, RunSurvey], topic: str, message: Any) -> None:
    text = message.data
    if topic == _SIM_CONFIG:
        _run(runs, parse_run_facts(text).run_id).config = text
        return
    run_id, session_id = parse_session(text)
    session = parse_section(text, "session")
    machine_id = int(parse_section(text, "machine_sim")["machine_id"])
    # The configuration has the number from which the sessions of the process count.
    first = SessionId(machine_id, session_id % MAX_SESSION_ID + 1)
    start = NodeStart(
        topic.removesuffix(_MACHINE_CONFIG), text, int(session.get("terrain_revision", -1))
    )
    _run(runs, run_id).starts[first] = start


def _add_header(runs: dict[int, RunSurvey], topic: str, message: Any) -> None:
    header = from_multi_array(message)
    if not isinstance(header, MachineHeader):
        return
    run = _run(runs, header.run_id)
    run.nodes.setdefault(header.machine_id, topic.removesuffix(_MACHINE_TICK))
    if header.is_tick:
        run.newest_tick = max(run.newest_tick, header.tick)
    if header.verb is Verb.LEAVE:
        run.last_ticks[SessionId(header.machine_id, header.session_id)] = header.tick


def _add_hash(runs: dict[int, RunSurvey], topic: str, message: Any) -> None:
    state = from_state_hash_string(message)
    run = _run(runs, state.run_id)
    run.newest_tick = max(run.newest_tick, state.tick)
    hashes = run.hashes.setdefault(topic, {})
    hashes[state.tick] = state.sha256
