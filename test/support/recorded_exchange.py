"""Runs of soil and machines in one process that record all messages in the form of the nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim, MachineTickOutput
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.codec.tick_headers import to_multi_array
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    MachineHeader,
    Message,
    RetransmitRequest,
    RowChunk,
    SoilHeader,
)
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    ENDED_SESSION,
    FORCE,
    MAP_UPDATE,
    ConversionKind,
    Rows,
    empty_rows,
)
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.welcome import Welcome
from soil_sim.soil import Soil
from support.machine_scenes import excavator, level_soil
from support.recorded_messages import PERIOD, TOPICS, Recording, machine_topic
from support.soil_scenes import bucket_sweep, flat_soil


class SimulatedMachine(Protocol):
    """A MachineSim, or a script."""

    def step(self) -> MachineTickOutput: ...

    def apply(self, conversions: Rows, map_updates: Rows) -> None: ...


class ScriptedMachine:
    """Digs back and forth, turns its soil into particles, and requests deposits in each tick.

    A few deposits are outside of the map, and a few are malformed and are rejected.
    """

    def __init__(self, seed: int, y: float = 0.0) -> None:
        self._rng = np.random.default_rng(seed)
        self._y = y
        self._tick = 0
        self._at = (-1.0, y, -0.2)
        self._pending: list[int] = []
        self._particles: dict[int, int] = {}
        self._awaiting_answer: set[int] = set()
        self._num_created = 0

    @property
    def totals(self) -> dict[str, int]:
        return {
            "pending_mm3": sum(self._pending),
            "particles_mm3": sum(self._particles.values()),
        }

    def step(self) -> MachineTickOutput:
        self._tick += 1
        while self._pending and self._rng.random() < 0.9:
            self._num_created += 1
            self._particles[self._num_created] = self._pending.pop()
        free = [n for n in self._particles if n not in self._awaiting_answer]
        depositing = free[: int(self._rng.integers(0, 8))]
        deposit_requests = empty_rows(DEPOSIT_REQUEST, len(depositing))
        deposit_requests["particle_id"] = depositing
        deposit_requests["volume_mm3"] = [self._particles[n] for n in depositing]
        deposit_requests["x"] = self._rng.uniform(
            1.5, 3.2, len(depositing)
        )  # the map ends at 3.1 m
        deposit_requests["x"][self._rng.random(len(depositing)) < 0.1] = np.nan
        deposit_requests["y"] = self._y
        self._awaiting_answer |= set(depositing)
        phase = 0.1 * self._tick
        end = (float(np.cos(phase)) * -1.0, self._y, -0.2 - 0.001 * self._tick)
        sweeps = bucket_sweep(self._at, end)
        self._at = end
        return MachineTickOutput(sweeps, deposit_requests, **self.totals)

    def apply(self, conversions: Rows, map_updates: Rows) -> None:
        for row in conversions:
            particle = int(row["particle_id"])
            if row["kind"] == ConversionKind.EXCAVATE:
                self._pending.append(int(row["volume_mm3"]))
            else:
                self._awaiting_answer.remove(particle)
                if row["kind"] != ConversionKind.REJECT:
                    assert self._particles.pop(particle) == row["volume_mm3"]

    def repeat_deposit_requests(self) -> None:
        """Request the deposits again that a former session did not answer."""
        self._awaiting_answer.clear()


class RecordedRun:
    """Soil and machines in lockstep, with all their messages recorded.

    Attributes:
        recording: the messages.
        soil: the soil.
        simulated_machines: the machines by id.
        soil_endpoint, machine_endpoints: their ends of the exchange.
    """

    def __init__(
        self,
        soil: Soil,
        simulated_machines: Mapping[int, SimulatedMachine],
        *,
        map_interval_ticks: int = 25,
        run_id: int = 1,
        recording: Recording | None = None,
    ) -> None:
        self.recording = recording if recording is not None else Recording()
        self.soil = soil
        self.simulated_machines = dict(simulated_machines)
        self.soil_endpoint = SoilExchange(
            Welcome(soil.grid, lambda: soil.columns.height, lambda: soil.layers),
            expected=self.simulated_machines,
            run_id=run_id,
        )
        self.machine_endpoints = {
            machine_id: MachineExchange(machine_id, run_id=run_id)
            for machine_id in self.simulated_machines
        }
        self._map_interval_ticks = map_interval_ticks
        self._last_map_revision = -1
        for end in self.machine_endpoints.values():
            end.join()
        self._deliver_messages()
        assert self.soil_endpoint.poll() is not None
        self._publish_results(empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))

    @property
    def tick(self) -> int:
        return self.soil_endpoint.tick

    def step(
        self, *, leaving: Iterable[int] = (), late: Iterable[int] = (), released: Rows | None = None
    ) -> None:
        """Run one tick.

        Args:
            leaving: machines that leave with it.
            late: machines that send nothing in it.
            released: deposit requests for the soil of absent machines.
        """
        leaving, late = set(leaving), set(late)
        for machine_id, end in self.machine_endpoints.items():
            if end.join_state is JoinState.READY and machine_id not in late:
                moved = self.simulated_machines[machine_id].step()
                totals = {"pending_mm3": moved.pending_mm3, "particles_mm3": moved.particles_mm3}
                end.send(
                    moved.sweeps, moved.deposit_requests, **totals, leave=machine_id in leaving
                )
        self._deliver_messages()
        tick = self.soil_endpoint.poll(wait=not late)
        assert tick is not None
        deposit_requests = (
            tick.deposit_requests
            if released is None
            else np.concatenate([tick.deposit_requests, released])
        )
        step = self.soil.step(tick.tick, tick.sweeps, deposit_requests)
        self._publish_results(step.conversions, step.forces, step.map_updates)
        for machine_id, end in self.machine_endpoints.items():
            answer = end.poll()
            if answer is not None:
                self.simulated_machines[machine_id].apply(answer.conversions, answer.map_updates)
                end.acknowledge_answer()

    def rejoin(self, machine_id: int, **totals: int) -> None:
        """Let a machine that left join again and apply its backlog."""
        self.machine_endpoints[machine_id].join(**totals)
        self.step()
        assert self.machine_endpoints[machine_id].joined
        self.simulated_machines[machine_id].apply(
            self.machine_endpoints[machine_id].backlog, empty_rows(MAP_UPDATE)
        )

    def release(self, machine_id: int, *, pieces: int) -> int:
        """Release the soil of an absent machine in some rows; return its volume [mm^3]."""
        volume = sum(self.soil_endpoint.release(machine_id).values())
        rows = empty_rows(DEPOSIT_REQUEST, pieces)
        rows["machine_id"], rows["particle_id"] = machine_id, np.arange(pieces)
        rows["volume_mm3"] = volume // pieces
        rows["volume_mm3"][0] += volume % pieces
        self.step(released=rows)
        return volume

    def release_ended(self, machine_id: int) -> int:
        """Release what a joined machine left behind in earlier sessions; return it [mm^3]."""
        volume = sum(self.soil_endpoint.release_ended(machine_id).values())
        rows = empty_rows(DEPOSIT_REQUEST, 1)
        rows["machine_id"], rows["volume_mm3"] = ENDED_SESSION, volume
        self.step(released=rows)
        return volume

    def crash(
        self, machine_id: int, replacement: SimulatedMachine, *, session_id: int | None = None
    ) -> None:
        """Replace a machine, whose soil is lost, by an empty one once the soil has dropped it.

        Args:
            machine_id: the machine.
            replacement: the empty one.
            session_id: sessions of the replacement count from the next one on; by default they
                continue those of the machine.
        """
        self.soil_endpoint.drop(machine_id)
        self.simulated_machines[machine_id] = replacement
        if session_id is None:
            session_id = self.machine_endpoints[machine_id].session_id + 1
        self.machine_endpoints[machine_id] = MachineExchange(
            machine_id, run_id=self.soil_endpoint.run_id, session_id=session_id
        )
        self.machine_endpoints[machine_id].join()

    def _publish_results(self, conversions: Rows, forces: Rows, map_updates: Rows) -> None:
        ledger = self.soil_endpoint.answer(
            conversions,
            forces,
            map_updates,
            revision=self.soil.revision,
            terrain_mm3=self.soil.total_mm3,
        )
        self._deliver_messages()
        self.recording.add("/soil/ledger", to_multi_array(ledger))
        if self.tick % self._map_interval_ticks == 0:
            self.keyframe()

    def keyframe(self) -> None:
        """Publish a terrain map, unless the terrain did not change since the last one."""
        if self.soil.revision == self._last_map_revision:
            return
        self._last_map_revision = self.soil.revision
        self.recording.add(
            "/terrain/map", terrain_cloud(self.soil, self.soil_endpoint.run_id, self.tick)
        )

    def _deliver_messages(self) -> None:
        for end in self.machine_endpoints.values():
            for message in end.drain_outbox():
                self._record_message(message, end.machine_id)
                self.soil_endpoint.receive(message)
        for message in self.soil_endpoint.drain_outbox():
            self._record_message(message, 0)
            for end in self.machine_endpoints.values():
                end.receive(message)

    def _record_message(self, message: Message, machine_id: int) -> None:
        if isinstance(message, RowChunk):
            topic = TOPICS.get(message.stream) or machine_topic(
                message.machine_id, "conversion_backlog"
            )
            stamp = stamp_from_tick(max(self.tick, 0), PERIOD)
            self.recording.add(topic, to_chunk_cloud(message, "map", stamp))
        elif isinstance(message, (MachineHeader, SoilHeader, RetransmitRequest)):
            topic = machine_topic(machine_id, "soil_tick") if machine_id else "/soil/tick"
            self.recording.add(topic, to_multi_array(message))
        else:
            # A node publishes these in other messages.
            assert isinstance(message, (Keyframe, JoinRejected))


def terrain_cloud(soil: Soil, run_id: int, tick: int) -> Any:
    """Return the current terrain as a message."""
    columns = soil.columns
    frame = Keyframe(run_id, soil.revision, soil.grid, columns.height, *soil.layers)
    terrain = TerrainMap(frame, columns.loose_depth)
    return to_terrain_cloud(terrain, "map", stamp_from_tick(max(tick, 0), PERIOD))


def scripted_run(machines: int = 1, **options: Any) -> RecordedRun:
    """Return a run of scripted machines on a small map."""
    simulated_machines = {n: ScriptedMachine(n, y=1.5 * (n - 1.5)) for n in range(1, machines + 1)}
    return RecordedRun(flat_soil(6.0, 0.2, soil_depth=2.0), simulated_machines, **options)


def recorded_dig(ticks: int) -> Recording:
    """Record an excavator that drags its bucket through the ground in front of it."""
    home = excavator()
    down = -arm_geometry(home).swing[2]
    angles = solve_arm_angles(home, 7.0, down + 0.1, 2.0)
    soil = level_soil()
    spec = replace(home, home=np.array([0.0, *angles]))
    machine = MachineSim([Placement(spec)], soil.grid, soil.columns.height)
    run = RecordedRun(soil, {1: machine}, map_interval_ticks=30)
    for tick in range(ticks):
        fraction = tick / ticks
        target = solve_arm_angles(
            home,
            7.0 - fraction,
            down - 0.2 * math.sin(math.pi * fraction) + 0.05,
            2.0 + 0.3 * fraction,
        )
        error = np.array(target) - machine.machine.joint_positions[1:]
        machine.command(np.array([0.0, *(5.0 * error)]), np.zeros(2))
        run.step()
    run.keyframe()
    machine.close()
    return run.recording
