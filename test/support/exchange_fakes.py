"""A soil and a machine that only account volumes, to test the exchange without physics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.contract.rows import (
    CONVERSION,
    DEPOSIT_REQUEST,
    FORCE,
    MAP_UPDATE,
    MAX_ROW_VOLUME,
    SWEEP,
    ConversionKind,
    Rows,
    empty_rows,
)
from msg_bridge.exchange.direct_transport import DirectTransport
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.tick_input import TickInput
from msg_bridge.exchange.welcome import Welcome
from msg_bridge.testing import LossyTransport

GRID = Grid(4, 4, 1.0)


class Transport(Protocol):
    """A transport."""

    def deliver(self) -> int: ...


class FakeSoil:
    """Excavates a random volume for each sweep and accepts most deposit requests."""

    def __init__(self, rng: np.random.Generator, expected: tuple[int, ...] = (1,)) -> None:
        self.rng = rng
        self.terrain = 10**15
        self.rows_seen: list[tuple[int, int]] = []
        self.sweeps_seen: list[tuple[int, int]] = []
        self.exchange = SoilExchange(
            Welcome(GRID, lambda: np.zeros(GRID.shape)), expected=expected, admit_others=True
        )
        self.ledgers: list[Ledger] = []
        self.releasing: list[int] = []
        self.num_rejected = 0

    def step(self, *, wait: bool = True) -> bool:
        try:
            tick = self.exchange.poll(wait=wait)
        except ExchangeError:  # forged rows
            self.num_rejected += 1
            return False
        if tick is None:
            return False
        conversions = self.move(tick)
        map_updates = empty_rows(MAP_UPDATE, 3)
        map_updates["revision"] = tick.tick
        forces = empty_rows(FORCE, 1)
        self.ledgers.append(
            self.exchange.answer(
                conversions, forces, map_updates, revision=tick.tick, terrain_mm3=self.terrain
            )
        )
        return True

    def move(self, tick: TickInput) -> Rows:
        self.rows_seen += [(int(r["machine_id"]), int(r["seq"])) for r in tick.deposit_requests]
        self.sweeps_seen += [(int(r["machine_id"]), int(r["seq"])) for r in tick.sweeps]
        dug = empty_rows(CONVERSION, tick.sweeps.size)
        dug["kind"], dug["machine_id"] = ConversionKind.EXCAVATE, tick.sweeps["machine_id"]
        dug["volume_mm3"] = self.rng.integers(1, 2**32 - 1, tick.sweeps.size)
        back = empty_rows(CONVERSION, tick.deposit_requests.size)
        for name in ("machine_id", "particle_id", "volume_mm3"):
            back[name] = tick.deposit_requests[name]
        back["kind"] = self.rng.choice(
            [ConversionKind.DEPOSIT, ConversionKind.OUTSIDE, ConversionKind.REJECT],
            tick.deposit_requests.size,
            p=[0.8, 0.1, 0.1],
        )
        released = self.deposit_released(self.releasing)
        self.releasing = []
        for rows in (back, released):
            is_deposit = rows["kind"] == ConversionKind.DEPOSIT
            self.terrain += int(rows["volume_mm3"][is_deposit].astype(np.int64).sum())
        self.terrain -= int(dug["volume_mm3"].astype(np.int64).sum())
        return np.concatenate([dug, back, released])

    def deposit_released(self, machine_ids: list[int]) -> Rows:
        """Return rows that deposit all soil of absent machines."""
        parts = [empty_rows(CONVERSION)]
        for machine_id in machine_ids:
            volume = sum(self.exchange.release(machine_id).values())
            rows = empty_rows(CONVERSION, -(-volume // MAX_ROW_VOLUME))
            rows["machine_id"], rows["kind"] = machine_id, ConversionKind.DEPOSIT
            rows["volume_mm3"] = MAX_ROW_VOLUME
            rows["volume_mm3"][-1:] -= np.uint32(rows.size * MAX_ROW_VOLUME - volume)
            parts.append(rows)
        return np.concatenate(parts)


class FakeMachine:
    """Turns parcels into particles, and requests to deposit some of them in each tick."""

    def __init__(self, rng: np.random.Generator, machine_id: int = 1, session_id: int = 0) -> None:
        self.rng = rng
        self.exchange = MachineExchange(machine_id, session_id=session_id)
        self.pending: list[int] = []
        self.particles: dict[int, int] = {}
        self.frozen: set[int] = set()
        self.num_created = 0
        self.applied: list[int] = []
        self.answers: list[tuple[int, int]] = []  # (last tick sent, tick answered)
        self.rows_per_tick = 8
        self.num_rejected = 0
        self.entered = False

    @property
    def totals(self) -> dict[str, int]:
        """Volumes of a header [mm^3]."""
        return {"pending_mm3": sum(self.pending), "particles_mm3": sum(self.particles.values())}

    @property
    def soil_mm3(self) -> int:
        """All soil in the machine [mm^3]."""
        return sum(self.totals.values())

    def step(self, *, leave: bool = False) -> bool:
        """Apply the answer if it is here and send the next tick; return False if it is not."""
        if self.exchange.waiting:
            try:
                answer = self.exchange.poll()
            except ExchangeError:  # forged rows
                self.num_rejected += 1
                return False
            if answer is None:
                return False
            self.answers.append((self.exchange.sent_tick, answer.tick))
            self.apply(answer.conversions)
            self.exchange.acknowledge_answer()
        if not self.exchange.joined:
            self.entered = False
            return False
        if not self.entered:
            self.apply(self.exchange.backlog)
            self.frozen.clear()  # requests without an answer are sent again
            self.entered = True
        while self.pending:
            self.num_created += 1
            self.particles[self.num_created] = self.pending.pop()
        free = [n for n in self.particles if n not in self.frozen]
        landing = free[: int(self.rng.integers(0, self.rows_per_tick + 1))]
        deposit_requests = empty_rows(DEPOSIT_REQUEST, len(landing))
        deposit_requests["particle_id"] = landing
        deposit_requests["volume_mm3"] = [self.particles[n] for n in landing]
        self.frozen |= set(landing)
        sweeps = empty_rows(SWEEP, int(self.rng.integers(0, self.rows_per_tick + 1)))
        self.exchange.send(sweeps, deposit_requests, **self.totals, leave=leave)
        return True

    def apply(self, conversions: Rows) -> None:
        for row in conversions:
            self.applied.append(int(row["seq"]))
            particle = int(row["particle_id"])
            if row["kind"] == ConversionKind.EXCAVATE:
                self.pending.append(int(row["volume_mm3"]))
            elif row["kind"] == ConversionKind.REJECT:
                self.frozen.remove(particle)
            else:
                assert self.particles.pop(particle) == row["volume_mm3"]
                self.frozen.remove(particle)


class ExchangeDriver:
    """Delivers messages and steps all participants, with retransmission requests at times."""

    def __init__(
        self, num_machines: int = 1, *, expected: int | None = None, seed: int = 0, **loss: float
    ) -> None:
        """Connect a soil and machines; the expected ones have requested to join.

        Args:
            num_machines: number of machines, with the ids from 1 on.
            expected: number of machines that the soil waits for, all by default.
            seed: seed of all random numbers.
            loss: probabilities of `LossyTransport`; without any, the transport is direct.
        """
        expected = num_machines if expected is None else expected
        self.soil = FakeSoil(np.random.default_rng(seed), expected=tuple(range(1, expected + 1)))
        self.machines = [
            FakeMachine(np.random.default_rng(seed + n), n) for n in range(1, num_machines + 1)
        ]
        self.rounds = 0
        self._seed, self._loss = seed, loss
        self.connect()
        for machine in self.machines[:expected]:
            machine.exchange.join()

    def connect(self) -> None:
        """Connect the present machines with the soil."""
        ends = [machine.exchange for machine in self.machines]
        self.transport: Transport = DirectTransport(self.soil.exchange, ends)
        if self._loss:
            rng = np.random.default_rng(self._seed)
            self.transport = LossyTransport(self.soil.exchange, ends, rng, **self._loss)

    def is_balanced(self) -> bool:
        """Return whether the ledger was balanced at every tick."""
        return {ledger.imbalance for ledger in self.soil.ledgers} == {0}

    def round(self, *, leaving: FakeMachine | None = None) -> bool:
        """Do one round; return whether anything happened. `leaving` leaves with its next tick."""
        self.rounds += 1
        has_progress = self.transport.deliver() > 0
        has_progress |= self.soil.step()
        for machine in self.machines:
            has_progress |= machine.step(leave=machine is leaving)
        if not has_progress or self.rounds % 5 == 0:
            for end in (self.soil.exchange, *(machine.exchange for machine in self.machines)):
                end.request_missing()
        return has_progress

    def until(self, done: Callable[[], bool], rounds: int = 20_000) -> None:
        """Do rounds until a condition holds."""
        for _ in range(rounds):
            if done():
                return
            self.round()
        raise AssertionError(f"stuck at tick {self.soil.exchange.tick}")

    def ticks(self, count: int) -> None:
        """Do rounds until the soil has answered `count` more ticks."""
        goal = self.soil.exchange.tick + count
        self.until(lambda: self.soil.exchange.tick >= goal)

    def hold_next_tick(self, machine: FakeMachine) -> list[Message]:
        """Return the messages of the machine's next tick, its header last, not yet delivered."""
        while True:
            self.transport.deliver()
            self.soil.step()
            if machine.step():
                return machine.exchange.drain_outbox()

    def leave(self, machine: FakeMachine) -> None:
        """Let a machine leave; do rounds until it is out."""
        for _ in range(20_000):
            if machine.exchange.join_state is JoinState.OUT:
                return
            self.round(leaving=machine)
        raise AssertionError("the machine did not leave")
