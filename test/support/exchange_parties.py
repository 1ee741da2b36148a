"""A soil and a machine reduced to their books, to test the exchange without any physics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.contract.rows import (
    CHANGED,
    CONVERSION,
    FORCE,
    LANDED,
    MAX_ROW_VOLUME,
    SWEEP,
    Kind,
    Rows,
    empty_rows,
)
from msg_bridge.exchange.machine_side import MachineExchange, Phase
from msg_bridge.exchange.soil_side import SoilExchange, TickInput

GRID = Grid(4, 4, 1.0)


class Carrier(Protocol):
    """A transport."""

    def carry(self) -> int: ...


class BookSoil:
    """Gives a random volume for each sweep row and takes back what lands."""

    def __init__(self, rng: np.random.Generator, expected: tuple[int, ...] = (1,)) -> None:
        self.rng = rng
        self.terrain = 10**15
        self.rows_seen: list[tuple[int, int]] = []
        self.sweeps_seen: list[tuple[int, int]] = []
        self.exchange = SoilExchange(GRID, lambda: np.zeros(GRID.shape), expected=expected)
        self.ledgers: list[Ledger] = []
        self.releasing: list[int] = []

    def step(self, *, wait: bool = True) -> bool:
        tick = self.exchange.poll(wait=wait)
        if tick is None:
            return False
        conversions = self.move(tick)
        changed = empty_rows(CHANGED, 3)
        changed["revision"] = tick.tick
        forces = empty_rows(FORCE, 1)
        self.ledgers.append(
            self.exchange.answer(
                conversions, forces, changed, revision=tick.tick, terrain_mm3=self.terrain
            )
        )
        return True

    def move(self, tick: TickInput) -> Rows:
        self.rows_seen += [(int(r["source"]), int(r["seq"])) for r in tick.landed]
        self.sweeps_seen += [(int(r["source"]), int(r["seq"])) for r in tick.sweeps]
        dug = empty_rows(CONVERSION, tick.sweeps.size)
        dug["kind"], dug["source"] = Kind.EXCAVATE, tick.sweeps["source"]
        dug["volume_mm3"] = self.rng.integers(1, 2**32 - 1, tick.sweeps.size)
        back = empty_rows(CONVERSION, tick.landed.size)
        for name in ("source", "particle_id", "volume_mm3"):
            back[name] = tick.landed[name]
        back["kind"] = self.rng.choice(
            [Kind.DEPOSIT, Kind.OUTSIDE, Kind.REFUSE], tick.landed.size, p=[0.8, 0.1, 0.1]
        )
        released = self.put_down(self.releasing)
        self.releasing = []
        for rows in (back, released):
            onto = rows["volume_mm3"][rows["kind"] == Kind.DEPOSIT].astype(np.int64).sum()
            self.terrain += int(onto)
        self.terrain -= int(dug["volume_mm3"].astype(np.int64).sum())
        return np.concatenate([dug, back, released])

    def put_down(self, sources: list[int]) -> Rows:
        """Rows that make terrain of all that absent sources held."""
        parts = [empty_rows(CONVERSION)]
        for source in sources:
            volume = self.exchange.release(source)
            rows = empty_rows(CONVERSION, -(-volume // MAX_ROW_VOLUME))
            rows["source"], rows["kind"] = source, Kind.DEPOSIT
            rows["volume_mm3"] = MAX_ROW_VOLUME
            rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - volume)
            parts.append(rows)
        return np.concatenate(parts)


class BookMachine:
    """Turns what it gets into particles, and lands some of them each tick."""

    def __init__(self, rng: np.random.Generator, source: int = 1, life: int = 0) -> None:
        self.rng = rng
        self.exchange = MachineExchange(source, life=life)
        self.pending: list[int] = []
        self.particles: dict[int, int] = {}
        self.frozen: set[int] = set()
        self.born = 0
        self.applied: list[int] = []
        self.answers: list[tuple[int, int]] = []  # (last tick sent, tick answered)
        self.rows_per_tick = 8
        self.entered = False

    @property
    def totals(self) -> dict[str, int]:
        return {"pending_mm3": sum(self.pending), "particles_mm3": sum(self.particles.values())}

    @property
    def held(self) -> int:
        return sum(self.totals.values())

    def step(self, *, leave: bool = False) -> bool:
        """Apply an answer if it has come, and send the next tick; False if still waiting."""
        if self.exchange.waiting:
            answer = self.exchange.poll()
            if answer is None:
                return False
            self.answers.append((self.exchange.sent_tick, answer.tick))
            self.apply(answer.conversions)
        if not self.exchange.joined:
            self.entered = False
            return False
        if not self.entered:
            self.apply(self.exchange.owed)
            self.frozen.clear()  # what the soil has not answered is offered again
            self.entered = True
        while self.pending:
            self.born += 1
            self.particles[self.born] = self.pending.pop()
        free = [n for n in self.particles if n not in self.frozen]
        landing = free[: int(self.rng.integers(0, self.rows_per_tick + 1))]
        landed = empty_rows(LANDED, len(landing))
        landed["particle_id"] = landing
        landed["volume_mm3"] = [self.particles[n] for n in landing]
        self.frozen |= set(landing)
        sweeps = empty_rows(SWEEP, int(self.rng.integers(0, self.rows_per_tick + 1)))
        self.exchange.send(sweeps, landed, **self.totals, leave=leave)
        return True

    def apply(self, conversions: Rows) -> None:
        for row in conversions:
            self.applied.append(int(row["seq"]))
            particle = int(row["particle_id"])
            if row["kind"] == Kind.EXCAVATE:
                self.pending.append(int(row["volume_mm3"]))
            elif row["kind"] == Kind.REFUSE:
                self.frozen.remove(particle)
            else:
                assert self.particles.pop(particle) == row["volume_mm3"]
                self.frozen.remove(particle)


class Driver:
    """Carries messages and steps everybody, reminding now and then as a timer would."""

    def __init__(self, soil: BookSoil, machines: list[BookMachine], transport: Carrier) -> None:
        self.soil = soil
        self.machines = machines
        self.transport = transport
        self.rounds = 0

    def round(self, *, leaving: BookMachine | None = None) -> bool:
        """One round; whether anything happened. `leaving` leaves with its next tick."""
        self.rounds += 1
        moved = self.transport.carry() > 0
        moved |= self.soil.step()
        for machine in self.machines:
            moved |= machine.step(leave=machine is leaving)
        if not moved or self.rounds % 5 == 0:
            for end in (self.soil.exchange, *(machine.exchange for machine in self.machines)):
                end.remind()
        return moved

    def until(self, done: Callable[[], bool], rounds: int = 20_000) -> None:
        """Go on until a condition holds."""
        for _ in range(rounds):
            if done():
                return
            self.round()
        raise AssertionError(f"stuck at tick {self.soil.exchange.tick}")

    def ticks(self, count: int) -> None:
        """Go on until the soil has answered `count` more ticks."""
        goal = self.soil.exchange.tick + count
        self.until(lambda: self.soil.exchange.tick >= goal)

    def held_back(self, machine: BookMachine) -> list[Message]:
        """Messages of the machine's next tick, its header last, on their way to the soil."""
        while True:
            self.transport.carry()
            self.soil.step()
            if machine.step():
                return machine.exchange.take_outbox()

    def leave(self, machine: BookMachine) -> None:
        """Let a machine leave, and wait until it is out."""
        for _ in range(20_000):
            if machine.exchange.phase is Phase.OUT:
                return
            self.round(leaving=machine)
        raise AssertionError("the machine never got out")
