"""A world in one process: soil and machines over the direct transport, at full speed.

The same soil, machine and exchange objects that run as ROS 2 nodes, without DDS. One tick::

    machines step -> exchange -> soil: cut, deposit, slip -> exchange -> machines take the answer
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

from machine_sim.core import MachineSim
from msg_bridge.contract.errors import ExchangeError, ParameterError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.rows import CHANGED, CONVERSION, FORCE, empty_rows
from msg_bridge.exchange.direct import DirectTransport
from msg_bridge.exchange.machine_side import MachineExchange, TickAnswer
from msg_bridge.exchange.soil_side import SoilExchange
from soil_sim.soil import Soil

__all__ = ["World"]

_log = logging.getLogger(__name__)


class World:
    """Soil and machines in lockstep.

    Attributes:
        soil: the terrain.
        machines: by source number, from 1.
        ledger: of the last tick.
        answers: what each machine was answered in the last tick, by source.
    """

    def __init__(self, soil: Soil, machines: Mapping[int, MachineSim]) -> None:
        """
        Args:
            soil: the terrain the machines were set on.
            machines: by source number, from 1.

        Raises:
            ParameterError: a machine's particles swell otherwise than the soil.
        """
        for source, machine in machines.items():
            if machine.particles.swell != soil.params.swell:
                raise ParameterError(
                    f"machine {source} has swell {machine.particles.swell}, the soil"
                    f" {soil.params.swell}; give MachineSim the soil's"
                )
        self.soil = soil
        self.machines = dict(machines)
        self.answers: dict[int, TickAnswer] = {}
        self._soil_end = SoilExchange(
            soil.grid, lambda: soil.columns.height, expected=self.machines
        )
        self._machine_ends = {source: MachineExchange(source) for source in self.machines}
        self._transport = DirectTransport(self._soil_end, list(self._machine_ends.values()))
        for end in self._machine_ends.values():
            end.join()
        self._transport.carry()
        self._soil_end.poll()
        self.ledger: Ledger = self._soil_end.answer(
            empty_rows(CONVERSION),
            empty_rows(FORCE),
            empty_rows(CHANGED),
            revision=soil.revision,
            terrain_mm3=soil.total_mm3,
        )
        self._transport.carry()

    @property
    def tick(self) -> int:
        """Number of the last tick done; 0 before the first."""
        return self._soil_end.tick

    def step(self) -> Ledger:
        """Advance all machines and the soil by one tick.

        Returns:
            The ledger of the tick.
        """
        for source, machine in self.machines.items():
            moved = machine.step()
            self._machine_ends[source].send(
                moved.sweeps,
                moved.landed,
                pending_mm3=moved.pending_mm3,
                particles_mm3=moved.particles_mm3,
            )
        self._transport.carry()
        tick = self._soil_end.poll()
        if tick is None:
            raise ExchangeError("the direct transport lost a machine's tick")
        step = self.soil.step(tick.tick, tick.sweeps, tick.landed)
        for reason in step.refused:
            _log.warning("tick %d: %s", tick.tick, reason)
        self.ledger = self._soil_end.answer(
            step.conversions,
            step.forces,
            step.changed,
            revision=self.soil.revision,
            terrain_mm3=self.soil.total_mm3,
        )
        self._transport.carry()
        for source, machine in self.machines.items():
            answer = self._machine_ends[source].poll()
            if answer is None:
                raise ExchangeError("the direct transport lost the soil's answer")
            self.answers[source] = answer
            machine.apply(answer.conversions, answer.changed)
        return self.ledger

    def state_hash(self) -> str:
        """SHA-256 [hex] of the terrain."""
        return self.soil.state_hash()

    def close(self) -> None:
        """Free what the machines hold."""
        for machine in self.machines.values():
            machine.close()
