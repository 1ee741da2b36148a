"""A run of machines without nodes, and the soil that answers its ticks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from machine_sim.commands import AppliedCommand, CommandArbiter
from machine_sim.dem import ParticleParams
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.params import MachineInstanceParams, MachineNodeParams
from machine_sim.params import MachineSimParams
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import CONVERSION, FORCE, MAP_UPDATE, empty_rows
from msg_bridge.exchange.soil_exchange import SoilExchange
from msg_bridge.exchange.welcome import Welcome
from support.machine_scenes import GRID, excavator

__all__ = ["RUN_ID", "MakeRun", "Soil", "machine_runs", "valid_command"]

RUN_ID = 4
KEYFRAME = Keyframe(RUN_ID, 0, GRID, np.zeros(GRID.shape))

MakeRun = Callable[..., MachineRun]
"""Makes a run: of a node with parameters by keyword, and other machines in it."""


@contextmanager
def machine_runs() -> Iterator[MakeRun]:
    """Return a function that makes runs, which are closed at the end."""
    made: list[MachineRun] = []

    def run(
        *others: MachineInstanceParams,
        tick: float = 0.01,
        realtime: bool = False,
        physics_step: float = 0.005,
        **params: Any,
    ) -> MachineRun:
        machine, of_node = excavator(), MachineNodeParams(**params)
        made.append(
            MachineRun(
                [
                    MachineInstance(each, machine, CommandArbiter(machine))
                    for each in (of_node, *others)
                ],
                of_node,
                MachineSimParams(physics_step=physics_step),
                ParticleParams(),
                RunFacts(RUN_ID, tick, realtime, GRID.cell, (LooseSoil(0.25, 1700.0),)),
                KEYFRAME,
                session_id=5,
            )
        )
        return made[-1]

    try:
        yield run
    finally:
        for each in made:
            each.close()


def valid_command(effect_time: float | None) -> bool:
    """Apply a command that the arbiter accepts."""
    return True


class Soil:
    """Soil exchange that answers the ticks of a run without any change."""

    def __init__(self, run: MachineRun) -> None:
        self.run = run
        self.exchange = SoilExchange(Welcome(GRID, lambda: np.zeros(GRID.shape)), run_id=RUN_ID)
        run.endpoint.join()
        self.answer()

    def answer(self, *, ticks_before: int = 0) -> None:
        """Answer the tick that was sent, after some ticks without the machine."""
        nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
        for _ in range(ticks_before):
            assert self.exchange.poll(wait=False) is not None
            self.exchange.answer(*nothing, revision=0, terrain_mm3=0)
        for message in self.run.endpoint.drain_outbox():
            self.exchange.receive(message)
        assert self.exchange.poll() is not None
        self.exchange.answer(*nothing, revision=0, terrain_mm3=0)
        for message in self.exchange.drain_outbox():
            self.run.endpoint.receive(message)
        self.run.endpoint.poll()

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    def tick(self) -> list[AppliedCommand]:
        """Perform a tick, and return the commands that took effect."""
        commands = self.run.apply_commands(0.0)
        self.run.step()
        self.answer()
        return commands
