"""Runs of soil and machines, every message of theirs recorded through the codec."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from machine_sim.core import MachineSim, MachineStep
from machine_sim.machine.kinematics import arm_angles, arm_geometry
from machine_sim.work.rig import Placement
from msg_bridge.codec.chunks import to_chunk_cloud
from msg_bridge.codec.headers import to_multi_array
from msg_bridge.codec.stamps import stamp_of_tick
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    Message,
    Refusal,
    Resend,
    RowChunk,
    SoilHeader,
)
from msg_bridge.contract.rows import (
    CHANGED,
    CONVERSION,
    FORCE,
    LANDED,
    Kind,
    Rows,
    empty_rows,
)
from msg_bridge.exchange.machine_side import MachineExchange, Phase
from msg_bridge.exchange.soil_side import SoilExchange
from soil_sim.soil import Soil
from support.bag_recording import PERIOD, TOPICS, Recording, machine_topic
from support.machine_scenes import excavator, level_soil
from support.soil_scenes import bucket_sweep, flat_soil


class Party(Protocol):
    """What moves soil: a MachineSim, or a script."""

    def step(self) -> MachineStep: ...

    def apply(self, conversions: Rows, changed: Rows) -> None: ...


class ScriptedMachine:
    """Digs back and forth, makes particles of what it gets, and lets some land each tick.

    A few land beyond the map, and a few cannot be believed and are refused.
    """

    def __init__(self, seed: int, y: float = 0.0) -> None:
        self._rng = np.random.default_rng(seed)
        self._y = y
        self._tick = 0
        self._at = (-1.0, y, -0.2)
        self._pending: list[int] = []
        self._particles: dict[int, int] = {}
        self._frozen: set[int] = set()
        self._born = 0

    @property
    def totals(self) -> dict[str, int]:
        return {
            "pending_mm3": sum(self._pending),
            "particles_mm3": sum(self._particles.values()),
        }

    def step(self) -> MachineStep:
        self._tick += 1
        while self._pending and self._rng.random() < 0.9:
            self._born += 1
            self._particles[self._born] = self._pending.pop()
        free = [n for n in self._particles if n not in self._frozen]
        landing = free[: int(self._rng.integers(0, 8))]
        landed = empty_rows(LANDED, len(landing))
        landed["particle_id"] = landing
        landed["volume_mm3"] = [self._particles[n] for n in landing]
        landed["x"] = self._rng.uniform(1.5, 3.2, len(landing))  # the map ends at 3.1 m
        landed["x"][self._rng.random(len(landing)) < 0.1] = np.nan
        landed["y"] = self._y
        self._frozen |= set(landing)
        phase = 0.1 * self._tick
        end = (float(np.cos(phase)) * -1.0, self._y, -0.2 - 0.001 * self._tick)
        sweeps = bucket_sweep(self._at, end)
        self._at = end
        return MachineStep(sweeps, landed, **self.totals)

    def apply(self, conversions: Rows, changed: Rows) -> None:
        for row in conversions:
            particle = int(row["particle_id"])
            if row["kind"] == Kind.EXCAVATE:
                self._pending.append(int(row["volume_mm3"]))
            else:
                self._frozen.remove(particle)
                if row["kind"] != Kind.REFUSE:
                    assert self._particles.pop(particle) == row["volume_mm3"]


class RecordedRun:
    """Soil and machines in lockstep, every message of theirs recorded."""

    def __init__(
        self,
        soil: Soil,
        parties: Mapping[int, Party],
        *,
        keyframe_every: int = 25,
        epoch: int = 1,
        recording: Recording | None = None,
    ) -> None:
        self.recording = recording if recording is not None else Recording()
        self.soil = soil
        self.parties = dict(parties)
        self.soil_end = SoilExchange(
            soil.grid,
            lambda: soil.columns.height,
            layers=lambda: soil.layers,
            expected=self.parties,
            epoch=epoch,
        )
        self.ends = {source: MachineExchange(source, epoch=epoch) for source in self.parties}
        self._every = keyframe_every
        self._keyframe_revision = -1
        for end in self.ends.values():
            end.join()
        self._carry()
        assert self.soil_end.poll() is not None
        self._answer(empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(CHANGED))

    @property
    def tick(self) -> int:
        return self.soil_end.tick

    def step(
        self, *, leaving: Iterable[int] = (), late: Iterable[int] = (), released: Rows | None = None
    ) -> None:
        """One tick of all that take part; `leaving` leave with it, `late` send nothing in it."""
        leaving, late = set(leaving), set(late)
        for source, end in self.ends.items():
            if end.phase is Phase.READY and source not in late:
                moved = self.parties[source].step()
                totals = {"pending_mm3": moved.pending_mm3, "particles_mm3": moved.particles_mm3}
                end.send(moved.sweeps, moved.landed, **totals, leave=source in leaving)
        self._carry()
        tick = self.soil_end.poll(wait=not late)
        assert tick is not None
        landed = tick.landed if released is None else np.concatenate([tick.landed, released])
        step = self.soil.step(tick.tick, tick.sweeps, landed)
        self._answer(step.conversions, step.forces, step.changed)
        for source, end in self.ends.items():
            answer = end.poll()
            if answer is not None:
                self.parties[source].apply(answer.conversions, answer.changed)

    def come_back(self, source: int, **totals: int) -> None:
        """A machine that left asks to join, and takes what it is owed."""
        self.ends[source].join(**totals)
        self.step()
        assert self.ends[source].joined
        self.parties[source].apply(self.ends[source].owed, empty_rows(CHANGED))

    def release(self, source: int, *, pieces: int) -> int:
        """Put down what an absent machine left, in some rows numbered from 0 [mm^3]."""
        volume = self.soil_end.release(source)
        rows = empty_rows(LANDED, pieces)
        rows["source"], rows["particle_id"] = source, np.arange(pieces)
        rows["volume_mm3"] = volume // pieces
        rows["volume_mm3"][0] += volume % pieces
        self.step(released=rows)
        return volume

    def crash(self, source: int, party: Party) -> None:
        """A machine is lost with all it holds; another begins in its place, empty."""
        self.parties[source] = party
        life = self.ends[source].life + 1
        self.ends[source] = MachineExchange(source, epoch=self.soil_end.epoch, life=life)
        self.ends[source].join()

    def _answer(self, conversions: Rows, forces: Rows, changed: Rows) -> None:
        ledger = self.soil_end.answer(
            conversions,
            forces,
            changed,
            revision=self.soil.revision,
            terrain_mm3=self.soil.total_mm3,
        )
        self._carry()
        self.recording.add("/soil/ledger", to_multi_array(ledger))
        if self.tick % self._every == 0:
            self.keyframe()

    def keyframe(self) -> None:
        """Publish the terrain, if it is another than the last time."""
        if self.soil.revision == self._keyframe_revision:
            return
        self._keyframe_revision = self.soil.revision
        self.recording.add("/terrain/map", terrain_cloud(self.soil, self.soil_end.epoch, self.tick))

    def _carry(self) -> None:
        for end in self.ends.values():
            for message in end.take_outbox():
                self._record(message, end.source)
                self.soil_end.receive(message)
        for message in self.soil_end.take_outbox():
            self._record(message, 0)
            for end in self.ends.values():
                end.receive(message)

    def _record(self, message: Message, source: int) -> None:
        if isinstance(message, RowChunk):
            topic = TOPICS.get(message.stream) or machine_topic(message.source, "soil_owed")
            stamp = stamp_of_tick(max(self.tick, 0), PERIOD)
            self.recording.add(topic, to_chunk_cloud(message, "map", stamp))
        elif isinstance(message, (MachineHeader, SoilHeader, Resend)):
            topic = machine_topic(source, "soil_tick") if source else "/soil/tick"
            self.recording.add(topic, to_multi_array(message))
        else:
            assert isinstance(message, (Keyframe, Refusal))  # a node sends those with more in them


def terrain_cloud(soil: Soil, epoch: int, tick: int) -> Any:
    """The terrain as it is, as a message."""
    columns = soil.columns
    frame = Keyframe(epoch, soil.revision, soil.grid, columns.height, *soil.layers)
    terrain = TerrainMap(frame, columns.loose_depth)
    return to_terrain_cloud(terrain, "map", stamp_of_tick(max(tick, 0), PERIOD))


def scripted_run(machines: int = 1, **options: Any) -> RecordedRun:
    """A small map with scripted machines at work."""
    parties = {n: ScriptedMachine(n, y=1.5 * (n - 1.5)) for n in range(1, machines + 1)}
    return RecordedRun(flat_soil(6.0, 0.2, dig_depth=2.0), parties, **options)


def recorded_dig(ticks: int) -> Recording:
    """An excavator that puts its lip in the ground before it and draws it in."""
    home = excavator()
    down = -arm_geometry(home).swing[2]
    angles = arm_angles(home, 7.0, down + 0.1, 2.0)
    soil = level_soil()
    description = replace(home, home=np.array([0.0, *angles]))
    machine = MachineSim([Placement(description)], soil.grid, soil.columns.height)
    run = RecordedRun(soil, {1: machine}, keyframe_every=30)
    for tick in range(ticks):
        part = tick / ticks
        wanted = arm_angles(
            home, 7.0 - part, down - 0.2 * math.sin(math.pi * part) + 0.05, 2.0 + 0.3 * part
        )
        error = np.array(wanted) - machine.machine.joint_positions[1:]
        machine.command(np.array([0.0, *(5.0 * error)]), np.zeros(2))
        run.step()
    run.keyframe()
    machine.close()
    return run.recording
