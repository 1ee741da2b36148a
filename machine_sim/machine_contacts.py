"""Contacts between the rigid bodies of a node: between its machines, and of machines with bins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from machine_sim.physics_engine import pybullet

__all__ = ["ContactMonitor", "MachineContact"]

_POSITION_ON_A, _NORMAL_FORCE = 5, 9
"""Indices of position [m] and normal force [N] in a record of `pybullet.getContactPoints`."""

_GAP_TIME = 0.5
"""Time without a force after which a contact has ended [s]; a collision bounces."""

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class MachineContact:
    """A contact of two bodies, from the first force to the last.

    Attributes:
        pair: indices of the bodies: machines in the order of the node, then bins.
        start_time: time of its first force since the start of the simulation [s].
        end_time: time of its last force so far [s].
        max_force: maximum of the sum of the normal forces [N].
        position: point with the largest normal force at that time [m], map frame.
        is_over: whether it has ended.
    """

    pair: tuple[int, int]
    start_time: float
    end_time: float
    max_force: float
    position: Vec3
    is_over: bool = False


class ContactMonitor:
    """Follows the contacts of all pairs of bodies of which one at least is a machine.

    Attributes:
        num_contacts: number of contacts that have begun.
    """

    def __init__(
        self, client: int, machines: Sequence[int], bins: Sequence[Sequence[int]] = ()
    ) -> None:
        """
        Args:
            client: physics client of all bodies.
            machines: body of each machine.
            bins: bodies of each bin.
        """
        self._client = client
        bodies = [[machine] for machine in machines] + [list(each) for each in bins]
        self._pairs = [
            (pair, [(a, b) for a in bodies[pair[0]] for b in bodies[pair[1]]])
            for pair in combinations(range(len(bodies)), 2)
            if pair[0] < len(machines)
        ]
        self._contacts: dict[tuple[int, int], MachineContact] = {}
        self._changes: list[MachineContact] = []
        self._ended: list[MachineContact] = []  # since the last call of `take_recent`
        self.num_contacts = 0

    def update(self, time: float) -> None:
        """Read the contacts of the last physics step, which ended at a time since the start [s]."""
        if not self._pairs:
            return
        # One call for all bodies: mostly none of them touch.
        has_points = bool(pybullet.getContactPoints(physicsClientId=self._client))
        for pair, bodies in self._pairs if has_points or self._contacts else ():
            points = [
                point
                for a, b in bodies
                for point in pybullet.getContactPoints(a, b, physicsClientId=self._client)
            ]
            force = sum(point[_NORMAL_FORCE] for point in points)
            known = self._contacts.get(pair)
            if force > 0.0:
                self._record(pair, known, time, force, points)
            elif known is not None and time - known.end_time > _GAP_TIME:
                self._changes.append(replace(known, is_over=True))
                self._ended = [each for each in self._ended if each.pair != pair]
                self._ended.append(self._changes[-1])
                del self._contacts[pair]

    def take_changes(self) -> list[MachineContact]:
        """Return the contacts that have begun or ended since the last call."""
        changes, self._changes = self._changes, []
        return changes

    def take_recent(self) -> list[MachineContact]:
        """Return the contacts that have not ended, and for each other pair the last one that has
        ended since the last call."""
        ended, self._ended = self._ended, []
        present = list(self._contacts.values())
        return [*present, *(each for each in ended if each.pair not in self._contacts)]

    def _record(
        self,
        pair: tuple[int, int],
        known: MachineContact | None,
        time: float,
        force: float,
        points: list[tuple],  # type: ignore[type-arg]
    ) -> None:
        """Begin or continue a contact."""
        if known is not None and force <= known.max_force:
            self._contacts[pair] = replace(known, end_time=time)
            return
        x, y, z = max(points, key=lambda point: point[_NORMAL_FORCE])[_POSITION_ON_A]
        start = time if known is None else known.start_time
        contact = MachineContact(pair, start, time, force, (x, y, z))
        self._contacts[pair] = contact
        if known is None:
            self._changes.append(contact)
            self.num_contacts += 1
