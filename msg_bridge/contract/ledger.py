"""The ledger: where every cubic millimetre of soil is at the end of a tick."""

from __future__ import annotations

from dataclasses import dataclass, field

from msg_bridge.contract.quick_init import quick_init

__all__ = ["Ledger"]


@quick_init
@dataclass(frozen=True)
class Ledger:
    """A consistent cut through all accounts, each counted by its own holder [mm^3 bank].

    Attributes:
        run_id: number of the run.
        tick: number of the tick that just ended.
        terrain: sum over all columns above the floor.
        in_flight: signed volume of the conversion rows published and not yet acknowledged by
            their machine. Excavated soil counts positive. Deposited and outside soil counts
            negative, since its machine still counts the particle.
        pending: parcels received by machines and not yet turned into particles.
        particles: all live particles, frozen ones included.
        absent: soil last reported by machines that left without depositing it.
        outside: soil that left the map.
        start: sum of all accounts when the run began.
        stamp_sec, stamp_nanosec: simulation time at the end of the tick, as of a ROS stamp. The
            publisher sets it: the exchange has no clock, so it is 0 in a ledger not published,
            and does not count when ledgers are compared.
    """

    run_id: int
    tick: int
    terrain: int
    in_flight: int
    pending: int
    particles: int
    absent: int
    outside: int
    start: int
    stamp_sec: int = field(default=0, compare=False)
    stamp_nanosec: int = field(default=0, compare=False)

    @property
    def total(self) -> int:
        """Sum of all accounts [mm^3]."""
        return (
            self.terrain
            + self.in_flight
            + self.pending
            + self.particles
            + self.absent
            + self.outside
        )

    @property
    def imbalance(self) -> int:
        """Volume lost (negative) or created (positive) since the start [mm^3]; always 0."""
        return self.total - self.start
