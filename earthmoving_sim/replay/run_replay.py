"""Run one recorded run again, and compare it with the recording."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from earthmoving_sim.replay.comparison import (
    Difference,
    find_header_difference,
    find_ledger_difference,
)
from earthmoving_sim.replay.difference_details import DifferenceError, joint_detail, row_detail
from earthmoving_sim.replay.errors import ReplayError
from earthmoving_sim.replay.node_parameters import ParameterChange, check_changes_of_state
from earthmoving_sim.replay.observer import Observer
from earthmoving_sim.replay.placement_terrain import PlacementTerrain
from earthmoving_sim.replay.recorded.recorded_node import (
    NodeAction,
    RecordedNode,
    node_topics,
)
from earthmoving_sim.replay.recorded.recorded_soil import (
    SOIL_TICK_TOPIC,
    SOIL_TOPICS,
    RecordedSoil,
)
from earthmoving_sim.replay.recorded.run_survey import RunSurvey, SessionId
from earthmoving_sim.replay.recorded.soil_tick_inputs import find_inputs
from earthmoving_sim.replay.recorded.topic_queues import TopicQueues
from earthmoving_sim.replay.replay_result import ReplayResult
from earthmoving_sim.replay.replayed_machines import ReplayedMachines, compile_kernels
from earthmoving_sim.replay.replayed_soil import ReplayedSoil
from earthmoving_sim.replay.run_setups import RunConfigurations
from earthmoving_sim.replay.saved_state import SavedMachines, SavedState
from msg_bridge.bag.reader import BagReader
from msg_bridge.bag.recording_begin import RECORD_FROM_BEGIN
from msg_bridge.bag.writer import BagError
from msg_bridge.checkpoint.state_file import load_state_file, save_state_file
from msg_bridge.codec.run_config import parse_run_facts
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import MachineHeader, SoilHeader, Verb
from msg_bridge.contract.topics import resolve
from soil_sim.warm_up import warm_up as warm_up_soil

__all__ = ["RunReplay"]

_SOIL_HASH = f"/{topics.SOIL_STATE_HASH}"
_SOIL = "soil"


class RunReplay:
    """The replay of one run.

    Attributes:
        survey: what the bag has of the run.
        facts: parameters of the run.
        soil: the soil.
        machines: the machine nodes that have joined, by machine id.
        result: what was found so far.
    """

    def __init__(
        self, reader: BagReader, survey: RunSurvey, changes: Sequence[ParameterChange] = ()
    ) -> None:
        """
        Args:
            reader: the bag.
            survey: what it has of the run.
            changes: parameters with other values than recorded; with any, nothing is compared.

        Raises:
            ReplayError: the bag lacks the configuration of a node.
            RecordedFileError: a file that the run depends on is missing.
            ParameterError: a change is of no parameter, or has an invalid value.
            EarthmovingError: another invalid parameter or file.
        """
        self._reader = reader
        self.survey, self.facts = survey, parse_run_facts(survey.config)
        self.machines: dict[int, ReplayedMachines] = {}
        self.result = ReplayResult()
        self._changes = tuple(changes)
        self._observer: Observer | None = None
        self._before: SoilHeader | None = None
        self._absent = 0  # in the last recorded ledger [mm^3]
        self._volumes: dict[SessionId, int] = {}  # last reported soil [mm^3]
        self._first_sessions: dict[int, SessionId] = {}  # of the machines, by machine id
        self._terrain = PlacementTerrain(survey)
        with ExitStack() as stack:  # closed at once if anything fails
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            self._set_up(folder, changes)
            self._stack = stack.pop_all()

    def _set_up(self, folder: Path, changes: Sequence[ParameterChange]) -> None:
        """Restore files and parameters, and create the soil; `folder` is an empty one."""
        survey = self.survey
        self._configurations = RunConfigurations(self._reader, survey, folder)
        self._soil_setup, self._setups = self._configurations.setups(changes)
        self.soil = ReplayedSoil(self._soil_setup, survey.run_id)
        self._terrain.keep(0, self.soil.keyframe)
        if changes:  # machines read soils from the configuration of the soil node
            self.facts = parse_run_facts(self.soil.config())
        warm_up_soil(self._soil_setup.soil)
        for setup in self._setups.values():
            compile_kernels(setup)
        types = dict(SOIL_TOPICS)
        for namespace in survey.nodes.values():
            types |= node_topics(namespace, self._machine_names(namespace))
        queues = TopicQueues(self._reader, types)
        self._recorded_soil = RecordedSoil(queues, survey.run_id)
        self._nodes = {
            machine_id: RecordedNode(
                queues, namespace, self._machine_names(namespace), survey.tick_periods
            )
            for machine_id, namespace in survey.nodes.items()
        }

    @property
    def _is_compared(self) -> bool:
        """Whether the replay is to be equal to the recording."""
        return not self._changes

    def follow(self, observer: Observer) -> None:
        """Let an observer follow the replay, which has not begun; a state is restored before."""
        self._observer = observer
        observer.start_soil(self.soil)
        for machine_id, machines in self.machines.items():
            session = self._first_sessions[machine_id]
            observer.start_machines(machines, self._setups[session], session.session_id)

    def save(self, path: Path) -> None:
        """Write the state after the last tick, from which `restore` continues.

        Raises:
            ReplayError: no tick was replayed, or particles are cubes.
            MachineError: machines touch, or have dynamic tracks: see `dump_physics`.
            StateFileError: the file cannot be written.
        """
        if self._before is None:
            raise ReplayError("there is no state before the first tick; replay some ticks first")
        if self.result.difference is not None or self.result.ended_early:
            raise ReplayError("the replay ended within a tick; save the state of one before")
        machines = {}
        for machine_id, each in self.machines.items():
            header = self._nodes[machine_id].newest_header
            assert header is not None, "a node that has joined has sent a header"
            if self._setups[self._first_sessions[machine_id]].particles.mode == "cubes":
                raise ReplayError("a state with particles.mode cubes cannot be saved")
            machines[machine_id] = SavedMachines.of(each, self._first_sessions[machine_id], header)
        progress = self._before, self._absent, self._volumes
        state = SavedState(self.soil, machines, self._terrain, *progress)
        save_state_file(path, state, self._about_state(self._changes))

    def _about_state(self, changes: Sequence[ParameterChange]) -> dict[str, Any]:
        """Return what a state file must be of."""
        return {"run_id": self.survey.run_id, "what_if": list(map(str, changes))}

    def restore(self, path: Path) -> None:
        """Continue from a saved state of the run, before the first tick is replayed.

        With changes of parameters, they begin in this state.

        Raises:
            StateFileError: it is no state of this run as recorded, or of another version.
            ParameterError: a change that has no effect from here on.
            EarthmovingError: the state does not fit the changed parameters.
        """
        check_changes_of_state(self._changes)
        saved: SavedState = load_state_file(path, self._about_state(()))
        recorded, facts = self._configurations.setups(), parse_run_facts(self.survey.config)
        self.soil, self._before = saved.soil, saved.header
        self._terrain = saved.terrain
        self._absent, self._volumes = saved.absent, saved.volumes
        self._recorded_soil.skip_through(saved.header.tick)
        self.result.last_tick = self.result.first_tick = saved.header.tick
        for machine_id, each in saved.machines.items():
            session = self._first_sessions[machine_id] = each.first_session
            keyframe = self._terrain.of(self.survey.starts[session])
            setup = recorded.machines[session]
            self.machines[machine_id] = each.restore(setup, facts, keyframe, self._on_state)
            self._nodes[machine_id].skip_through(each.newest_header)
        if self._changes:
            self._change_parameters()

    def _change_parameters(self) -> None:
        """Continue soil and machines with the changed parameters."""
        self.soil.change(self._soil_setup)
        for machine_id, before in self.machines.items():
            session = self._first_sessions[machine_id]
            changed = self._make_machines(session)
            try:
                changed.continue_from(before)
            except EarthmovingError:
                changed.close()
                raise
            self.machines[machine_id] = changed

    def close(self) -> None:
        """Release the physics engines and the restored files."""
        for each in self.machines.values():
            each.close()
        self.machines.clear()
        self._stack.close()

    def run(
        self, progress: Callable[[int], None] | None = None, *, until: int | None = None
    ) -> ReplayResult:
        """Replay to the end of the recording, or to the first difference.

        Args:
            until: last tick to replay; None: all.
            progress: called after each tick of the soil with its number.

        Raises:
            EarthmovingError: the first tick cannot be replayed: the bag is damaged, or lacks the
                begin of the run or a message. Of a later tick, it is `ended_early`.
        """
        start = time.perf_counter()
        try:
            while (recorded := self._recorded_soil.next_tick()) is not None:
                self._step(*recorded)
                if progress is not None:
                    progress(self.result.last_tick)
                if until is not None and self.result.last_tick >= until:
                    break
            else:
                self._finish()
                if not self._reader.truncated:  # there topics end at different ticks
                    self.survey.check_end(self.result.last_tick)
            if self._before is None:
                raise ReplayError(
                    f"the bag lacks the ticks of run {self.survey.run_id} on {SOIL_TICK_TOPIC};"
                    " record all topics"
                )
        except DifferenceError as found:
            self.result.difference = self._with_detail(found)
        except BagError:  # of a recording of the replay
            raise
        except EarthmovingError as error:
            if self.result.last_tick <= self.result.first_tick:
                raise
            self.result.ended_early = str(error)
        self.result.wall_time = time.perf_counter() - start
        self.result.simulated_time = self.result.num_ticks * self.facts.tick_period
        return self.result

    def _finish(self) -> None:
        """Apply the last answers that the machines have received."""
        for machines in self.machines.values():
            machines.finish()

    # What the bag has.

    def _machine_names(self, namespace: str) -> list[str]:
        """Return the names of the machines of a node; one empty name for an only machine."""
        starts = self.survey.starts.items()
        session = next(each for each, begin in starts if begin.namespace == namespace)
        return list(self._setups[session].machines)

    # The ticks.

    def _step(self, recorded: SoilHeader, ledger: Ledger | None) -> None:
        inputs = find_inputs(self._before, recorded, self.survey.last_ticks)
        # Of what was reported before this tick.
        absent = self._absent + sum(self._volumes.get(each, 0) for each in inputs.dropped)
        for session, tick in inputs.processed.items():
            self._volumes[session] = self._perform_through(session, tick).soil_mm3
        joins = [self._perform_through(session, None) for session in inputs.joined]
        # In a tick with a rejoin, soil that is not absent any more went with the machine.
        is_rejoin = any(header.verb is Verb.REJOIN for header in joins)
        releases = ledger is not None and ledger.absent < absent and not is_rejoin
        messages = [message for each in self.machines.values() for message in each.take_messages()]
        done = self.soil.step(inputs, messages, release=releases)
        sent = self.soil.endpoint.drain_outbox()
        header = next(each for each in sent if isinstance(each, SoilHeader))
        for machines in self.machines.values():
            machines.receive(header.tick, sent)
        if self._observer is not None:
            self._observer.on_soil_tick(header, done, sent)
        self._before = recorded
        self._terrain.keep(recorded.revision, self.soil.keyframe)
        difference = find_header_difference(recorded, header, _SOIL)
        if ledger is None:
            self.result.num_missing_ledgers += 1
        else:
            self._absent = ledger.absent
            self.result.num_ledgers += self._is_compared
            difference = difference or find_ledger_difference(ledger, done.ledger)
        if difference is not None and self._is_compared:
            raise DifferenceError(difference, sent=sent)
        self._compare_hash(_SOIL_HASH, header.tick, self.soil.soil.state_hash)
        self.result.last_tick = header.tick

    def _perform_through(self, session: SessionId, tick: int | None) -> MachineHeader:
        """Let a machine node do what it did up to a tick of a session, or up to its join.

        Returns:
            The recorded header of that tick or join request.

        Raises:
            ReplayError: the bag lacks it.
        """
        machine_id = session.machine_id
        while True:
            node = self._nodes.get(machine_id)
            action = None if node is None else node.next_action()
            what = "join request" if tick is None else f"tick {tick}"
            if action is None or action.header.run_id > self.survey.run_id:
                raise ReplayError(
                    f"the bag lacks the {what} of machine {machine_id} in session"
                    f" {session.session_id} on its topic {topics.MACHINE_TICK}"
                )
            if action.header.run_id < self.survey.run_id:
                continue
            if not action.header.is_tick and action.session != session:
                if action.session in self.survey.starts:
                    self._start_node(action.session)
                continue  # the request was rejected, and changed nothing
            self._perform(action)
            is_join = tick is None and not action.header.is_tick
            if action.session == session and (is_join or action.header.tick == tick):
                return action.header

    def _perform(self, action: NodeAction) -> None:
        header, machine_id = action.header, action.header.machine_id
        start = self.survey.starts.get(action.session)
        if not header.is_tick and start is not None:
            self._start_node(action.session)
        machines = self.machines.get(machine_id)
        if machines is None:
            raise ReplayError(
                f"machine {machine_id} joined before the recording began; {RECORD_FROM_BEGIN}"
            )
        replayed = machines.perform(action)
        sent = machines.unsent_messages
        if self._observer is not None:
            self._observer.on_action(machines, action, sent)
        difference = find_header_difference(header, replayed, machines.namespace)
        if difference is not None and self._is_compared:
            raise DifferenceError(difference, machines, action.session, sent)

    def _start_node(self, session: SessionId) -> None:
        """Begin with the machines of a process of a machine node."""
        before = self.machines.pop(session.machine_id, None)
        if before is not None:
            before.close()
        machines = self.machines[session.machine_id] = self._make_machines(session)
        self._first_sessions[session.machine_id] = session
        if self._observer is not None:
            self._observer.start_machines(machines, self._setups[session], session.session_id)

    def _make_machines(self, session: SessionId) -> ReplayedMachines:
        """Create the machines of a process of a machine node, where they were placed."""
        start, setup = self.survey.starts[session], self._setups[session]
        keyframe = self._terrain.of(start)
        return ReplayedMachines(start.namespace, setup, self.facts, keyframe, self._on_state)

    # The comparison.

    def _on_state(self, machines: ReplayedMachines) -> None:
        if self._observer is not None:
            self._observer.on_state(machines)
        topic = resolve(topics.MACHINE_STATE_HASH, machines.namespace)
        state_hash = machines.run.sim.state_hash
        self._compare_hash(topic, machines.run.tick, state_hash, machines)

    def _compare_hash(
        self,
        topic: str,
        tick: int,
        state_hash: Callable[[], str],
        machines: ReplayedMachines | None = None,
    ) -> None:
        recorded = self.survey.hashes.get(topic, {}).get(tick)
        if recorded is None or not self._is_compared:
            return
        replayed = state_hash()
        if replayed != recorded:
            where = _SOIL if machines is None else machines.namespace
            text = f"the state hash is {recorded[:12]} recorded, {replayed[:12]} replayed"
            raise DifferenceError(Difference(tick, where, text), machines)
        self.result.num_hashes[topic] = self.result.num_hashes.get(topic, 0) + 1

    def _with_detail(self, found: DifferenceError) -> Difference:
        """Return a difference with the first row and the joint that differ, where known."""
        difference, machines = found.difference, found.machines
        details = [
            row_detail(self._reader, self.survey.run_id, found.session, difference, found.sent)
        ]
        if machines is not None:
            period = self.facts.tick_period
            details.append(joint_detail(self._reader, machines, difference.tick, period))
        return replace(difference, text="; ".join([difference.text, *filter(None, details)]))
