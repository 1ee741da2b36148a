"""A world in one process: soil and machines over the direct transport, at full speed.

The same soil, machine and exchange objects that run as ROS 2 nodes, without DDS. One tick::

    machines step -> exchange -> soil: cut, deposit, slip -> exchange -> machines take an answer

It is the answer to the tick before, as it is between nodes, where soil and machines work at the
same time: the same commands give the same run.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from machine_sim.endpoint import MachineEndpoint
from machine_sim.simulation import MachineSim
from msg_bridge.contract.errors import ExchangeError, ParameterError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.exchange.direct_transport import DirectTransport
from msg_bridge.exchange.machine_exchange import MachineExchange, TickAnswer
from soil_sim.endpoint import SoilEndpoint
from soil_sim.soil import Soil

__all__ = ["World"]

_log = logging.getLogger(__name__)


class World:
    """Soil and machines in lockstep.

    Attributes:
        soil: the terrain.
        machines: by source number, from 1.
        ledger: of the last tick.
        answers: the latest that each machine has taken, by source: of the tick before the last.
    """

    def __init__(self, soil: Soil, machines: Mapping[int, MachineSim]) -> None:
        """
        Args:
            soil: the terrain the machines were set on.
            machines: by source number, from 1.

        Raises:
            ParameterError: a machine knows other soils than the terrain has.
        """
        for machine_id, machine in machines.items():
            known, there = machine.particles.soils, soil.loose_soils
            if known != there:
                raise ParameterError(
                    f"machine {machine_id} knows the soils {known}, the terrain has {there}; give"
                    " MachineSim the terrain's"
                )
        self.soil = soil
        self.machines = dict(machines)
        self.answers: dict[int, TickAnswer] = {}
        self._surface_revision: int | None = None
        self._surface: NDArray[np.float64] = np.zeros((0, 0))
        self._soil_endpoint = SoilEndpoint(soil, expected=self.machines)
        self._machine_endpoints = {
            machine_id: MachineEndpoint(machine, MachineExchange(machine_id))
            for machine_id, machine in self.machines.items()
        }
        self._transport = DirectTransport(
            self._soil_endpoint, list(self._machine_endpoints.values())
        )
        for side in self._machine_endpoints.values():
            side.join()
        self.ledger = self._soil_tick()

    @property
    def tick(self) -> int:
        """Number of the last tick done; 0 before the first."""
        return self._soil_endpoint.tick

    @property
    def surface(self) -> NDArray[np.float64]:
        """Heights [m], shape (rows, cols), to the bits that messages carry (float32).

        The same array until the terrain changes; not to be written to.
        """
        if self._surface_revision != self.soil.revision:
            self._surface_revision = self.soil.revision
            self._surface = self.soil.columns.height.astype(np.float32).astype(np.float64)
        return self._surface

    def step(self) -> Ledger:
        """Advance all machines and the soil by one tick.

        Returns:
            The ledger of the tick.
        """
        for side in self._machine_endpoints.values():
            side.step()
        self.ledger = self._soil_tick()
        for machine_id, side in self._machine_endpoints.items():
            answer = side.poll()
            if answer is not None:
                self.answers[machine_id] = answer
            elif not side.is_ready:
                raise ExchangeError("the direct transport lost the soil's answer")
        return self.ledger

    def _soil_tick(self) -> Ledger:
        self._transport.deliver()
        done = self._soil_endpoint.advance()
        if done is None:
            raise ExchangeError("the direct transport lost a machine's tick")
        for reason in done.step.rejected_tools:
            _log.warning("tick %d: %s", done.ledger.tick, reason)
        self._transport.deliver()
        return done.ledger

    def state_hash(self) -> str:
        """SHA-256 [hex] of the terrain."""
        return self.soil.state_hash()

    def close(self) -> None:
        """Free what the machines hold."""
        for machine in self.machines.values():
            machine.close()
