"""A soil run and the exchange ends of machines on a simulated wall clock."""

from __future__ import annotations

from typing import Any

from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.machine_account import signed_volume
from msg_bridge.exchange.machine_exchange import MachineExchange
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import SoilRun
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import flat
from support.soil_scenes import bucket_sweep, flat_soil, make_deposit_requests

TICK = 0.01
AT_REST = bucket_sweep((0, 0, 1), (0, 0, 1))


class Timeline:
    """A soil run, the exchange ends of machines, and a simulated wall clock."""

    def __init__(self, *machines: int, site: Site | None = None, **params: Any) -> None:
        given = {
            "expected_machines": machines,
            "machine_timeout": 1.0,
            "tick_period": TICK,
            **params,
        }
        site = site or Site(flat(flat_soil().grid))
        self.run = SoilRun(site, SoilParams(), SoilNodeParams(**given), run_id=7)
        self.machines = {
            machine_id: MachineExchange(machine_id, run_id=7) for machine_id in machines
        }
        self.soil_mm3 = dict.fromkeys(machines, 0)  # of each machine
        self.now = 100.0
        for machine in self.machines.values():
            machine.join()
        self.exchange()
        self.ticks()  # the welcome, if all machines have joined

    def exchange(self) -> None:
        """Deliver all messages in both directions."""
        for machine in self.machines.values():
            for message in machine.drain_outbox():
                self.run.endpoint.receive(message)
        for message in self.run.endpoint.drain_outbox():
            for machine in self.machines.values():
                machine.receive(message)
        for machine_id, machine in self.machines.items():
            answer = machine.poll()
            if answer is not None:
                self.soil_mm3[machine_id] += signed_volume(answer.conversions)
                machine.acknowledge_answer()

    def send(self, machine_id: int, sweep: Rows = AT_REST) -> None:
        """Deliver the next tick of a machine."""
        nothing = make_deposit_requests([], [], 0)
        held = self.soil_mm3[machine_id]
        self.machines[machine_id].send(sweep.copy(), nothing, pending_mm3=held, particles_mm3=0)
        self.exchange()

    def ticks(self) -> int:
        """Compute all ticks that are possible now; return their number."""
        count = 0
        while self.run.advance(self.now) is not None:
            count += 1
        self.exchange()
        return count

    def wait(self, ticks: float) -> int:
        """Advance the wall clock and fire the timer; return the number of ticks computed."""
        self.now += ticks * TICK
        self.run.on_timer(self.now)
        return self.ticks()
