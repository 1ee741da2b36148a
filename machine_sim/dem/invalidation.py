"""Invalidation of derived data: what must be rebuilt after each change of particles or tools.

A particle engine keeps data from step to step that it derives from the particles:

- `NEIGHBOUR_LIST`: the Verlet list of pairs that may touch within several steps
- `CONTACT_BLOCKS`: the listed pairs that may touch now, copied into blocks with their springs
- `BODY_RECORDS`: the float32 records of *all* rows; those of moving rows are loaded in each step
- `INITIAL_RADII`: contact radii of particles that have just been released

| change                  | neighbour list    | contact blocks | body records | initial radii |
|-------------------------|-------------------|----------------|--------------|---------------|
| `PARTICLES_ADDED`       | inserts the rows  | rebuild        | (moving)     |               |
| `GROWING_ADDED`         | inserts the rows  | rebuild        | (moving)     | set           |
| `PARTICLES_REMOVED`     | removes the rows  | rebuild        | rebuild      |               |
| `PARTICLES_FROZEN`      |                   | rebuild        | rebuild      |               |
| `PARTICLES_UNFROZEN`    | rebuild           | rebuild        | (moving)     |               |
| `PARTICLES_WOKEN`       | rebuild           | rebuild        | (moving)     |               |
| `PARTICLES_ASLEEP`      |                   | rebuild        | rebuild      |               |
| `ROWS_REORDERED`        | rebuild           | rebuild        | rebuild      |               |
| `LIST_EXPIRED`          | rebuild           | rebuild        |              |               |
| `BUFFERS_REALLOCATED`   |                   | rebuild        | rebuild      |               |

The reasons: pairs of two particles that do not move are not listed, so that one that begins to
move needs a new list; one that stops moving only leaves superfluous pairs. A record holds an
inverse mass of 0 for a particle that does not move, and is not loaded again while it rests. Contact
blocks refer to the list by index and hold effective masses from the records.

Removing a tool wakes all particles, which is the change `PARTICLES_WOKEN`; its plates are removed
from the plate list at once. Adding or moving a tool makes nothing stale: plate contacts are listed
in each step.

Before the list changes, the springs in the contact blocks must return to the list. The engine does
that when the blocks become stale.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, auto

__all__ = [
    "BODY_RECORDS",
    "CONTACT_BLOCKS",
    "INITIAL_RADII",
    "NEIGHBOUR_LIST",
    "STALE_AFTER",
    "Change",
    "Invalidation",
]

NEIGHBOUR_LIST = "neighbour list"
CONTACT_BLOCKS = "contact blocks"
BODY_RECORDS = "body records"
INITIAL_RADII = "initial radii"
"""Derived data. Strings, as members of an enumeration take longer to look up than to check."""


class Change(Enum):
    """A change of the particles, or of the arrays that hold derived data."""

    PARTICLES_ADDED = auto()
    GROWING_ADDED = auto()
    PARTICLES_REMOVED = auto()
    PARTICLES_FROZEN = auto()
    PARTICLES_UNFROZEN = auto()
    PARTICLES_WOKEN = auto()
    PARTICLES_ASLEEP = auto()
    ROWS_REORDERED = auto()
    LIST_EXPIRED = auto()
    BUFFERS_REALLOCATED = auto()


_LIST = frozenset({NEIGHBOUR_LIST, CONTACT_BLOCKS})
_RECORDS = frozenset({BODY_RECORDS, CONTACT_BLOCKS})

STALE_AFTER: Mapping[Change, frozenset[str]] = {
    Change.PARTICLES_ADDED: frozenset({CONTACT_BLOCKS}),
    Change.GROWING_ADDED: frozenset({CONTACT_BLOCKS, INITIAL_RADII}),
    Change.PARTICLES_REMOVED: _RECORDS,
    Change.PARTICLES_FROZEN: _RECORDS,
    Change.PARTICLES_UNFROZEN: _LIST,
    Change.PARTICLES_WOKEN: _LIST,
    Change.PARTICLES_ASLEEP: _RECORDS,
    Change.ROWS_REORDERED: _LIST | _RECORDS,
    Change.LIST_EXPIRED: _LIST,
    Change.BUFFERS_REALLOCATED: _RECORDS,
}
"""Data that each change makes stale: the table of the module."""


class Invalidation:
    """Which derived data is stale. All but initial radii is stale at first.

    Attributes:
        stale: the names of that data.
    """

    def __init__(self) -> None:
        self.stale = set(_LIST | _RECORDS)

    def record(self, change: Change) -> None:
        """Mark as stale what a change affects."""
        self.stale |= STALE_AFTER[change]

    def mark_rebuilt(self, *derived: str) -> None:
        """Record that this data is valid again."""
        self.stale.difference_update(derived)
