"""World: soil and machines in one process, over the direct transport, without DDS.

It uses the same soil, machine and exchange objects as the ROS 2 nodes. One tick::

    machines step -> exchange -> soil: cut, deposit, relax -> exchange -> machines apply an answer

The answer that machines apply is that to the tick before, as between nodes, where soil and machines
compute at the same time: the same commands give the same run.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from machine_sim.endpoint import MachineEndpoint
from machine_sim.simulation import MachineSim
from msg_bridge.contract.errors import ErrorCode, ExchangeError, ParameterError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.direct_transport import DirectTransport
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.exchange.tick_answer import TickAnswer
from soil_sim.endpoint import SoilEndpoint
from soil_sim.soil import Soil

__all__ = ["World"]

_log = logging.getLogger(__name__)


class World:
    """Soil and machines in lockstep.

    Attributes:
        soil: the terrain.
        machines: machines by machine_id, from 1.
        ledger: ledger of the last tick.
        answers: answer that each machine applied last, by machine_id; of the tick before the last.
        surface: heights rounded to float32, as in messages [m], shape (rows, cols), float64;
            changed in place.
    """

    def __init__(self, soil: Soil, machines: Mapping[int, MachineSim]) -> None:
        """
        Args:
            soil: the terrain on which the machines stand.
            machines: machines by machine_id, from 1.

        Raises:
            ParameterError: a machine has other soils than the terrain.
        """
        for machine_id, machine in machines.items():
            if machine.particles.soils != soil.loose_soils:
                raise ParameterError(
                    f"machine {machine_id} has the soils {machine.particles.soils}, the terrain has"
                    f" {soil.loose_soils}; create MachineSim with the soils of the terrain"
                )
        self.soil = soil
        self.machines = dict(machines)
        self.answers: dict[int, TickAnswer] = {}
        self.surface: NDArray[np.float64] = soil.columns.height.astype(np.float32).astype(
            np.float64
        )
        self._soil_endpoint = SoilEndpoint(soil, expected=self.machines)
        self._machine_endpoints = {
            machine_id: MachineEndpoint(machine, MachineExchange(machine_id))
            for machine_id, machine in self.machines.items()
        }
        self._transport = DirectTransport(
            self._soil_endpoint.exchange, list(self._machine_endpoints.values())
        )
        for endpoint in self._machine_endpoints.values():
            endpoint.join()
        self.ledger = self._soil_tick()

    @property
    def tick(self) -> int:
        """Number of the last tick done; 0 before the first."""
        return self._soil_endpoint.tick

    def step(self) -> Ledger:
        """Advance all machines and the soil by one tick; return the ledger of the tick."""
        for endpoint in self._machine_endpoints.values():
            endpoint.step()
        self.ledger = self._soil_tick()
        for machine_id, endpoint in self._machine_endpoints.items():
            answer = endpoint.poll()
            if answer is not None:
                self.answers[machine_id] = answer
            elif not endpoint.is_ready:
                raise ExchangeError(
                    "the direct transport lost the soil's answer", ErrorCode.LOST_MESSAGE
                )
        return self.ledger

    def _soil_tick(self) -> Ledger:
        self._transport.deliver()
        done = self._soil_endpoint.advance()
        if done is None:
            raise ExchangeError(
                "the direct transport lost a machine's tick", ErrorCode.LOST_MESSAGE
            )
        for reason in done.step.rejected_tools:
            _log.warning("tick %d: %s", done.ledger.tick, reason)
        updates: Rows = done.step.map_updates
        if updates.size:
            self.surface[updates["row"], updates["col"]] = updates["z"]
        self._transport.deliver()
        return done.ledger

    def state_hash(self) -> str:
        """Return the SHA-256 of the terrain [hex]."""
        return self.soil.state_hash()

    def close(self) -> None:
        """Release the physics engines of the machines."""
        for machine in self.machines.values():
            machine.close()
