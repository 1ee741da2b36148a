"""The ledger: where every cubic millimetre of soil is at the end of a tick."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Ledger"]


@dataclass(frozen=True)
class Ledger:
    """A consistent cut through all accounts, each counted by its own holder [mm^3 bank].

    Attributes:
        tick: the tick that just ended.
        terrain: sum over columns above the floor.
        in_flight: rows published and not yet acknowledged by their source: excavated soil counts
            plus, deposited and outside soil minus, since its source still counts the particle.
        pending: parcels received by machines and not yet turned into particles.
        particles: live particles, frozen ones included.
        absent: what machines held that left without settling.
        outside: what left the map.
        start: the sum when the run began.
    """

    tick: int
    terrain: int
    in_flight: int
    pending: int
    particles: int
    absent: int
    outside: int
    start: int

    @property
    def total(self) -> int:
        """Sum of all accounts."""
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
        """What was lost (negative) or made from nothing (positive): 0, always."""
        return self.total - self.start
