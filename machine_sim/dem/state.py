"""The state of the particles: one array per quantity, with spare capacity.

Rows are in the order of release until `reorder` is called; the particle ids are permanent.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.particle_columns import (
    COLUMN_TYPES,
    ParticleColumns,
    allocate_columns,
    remove_rows,
    view_rows,
)
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.kernels import BoxedTable, box_table, kernel

__all__ = ["ASLEEP_ON_MAP", "AWAKE", "ParticleError", "ParticleState"]

AWAKE = 0
"""Sleep state of a particle that moves by forces (unless it is frozen)."""
ASLEEP_ON_MAP = 1
"""Sleep state of a particle at rest relative to the map; higher ones are for tools, see
`sleep.sleep_state`."""

_DUPLICATE_ID, _UNKNOWN_ID = 1, 2
_INITIAL_CAPACITY = 1024
_NO_ROWS = np.zeros(0, np.int64)


class ParticleError(EarthmovingError):
    """Particles or tools that are invalid, or ids that do not exist; nothing was changed."""


class ParticleState:
    """Struct of arrays; each attribute is a view of the rows in use, made when it is first read.

    Attributes:
        position: centres [m], map frame, shape (n, 3), float64.
        velocity: [m/s], map frame, shape (n, 3), float64.
        angular_velocity: [rad/s], map axes, shape (n, 3), float32.
        radius: full radius [m], shape (n,), float32.
        contact_radius: radius that contacts use [m], grows to `radius`; 0 until the first step.
        mass: [kg], shape (n,), float32.
        inverse_mass: [1/kg], 0 while frozen.
        volume_mm3: bank volume [mm^3], exact, shape (n,), int64.
        soil, moisture: soil type id, and moisture [% of saturation], uint8.
        particle_id: unique, never reused, from 1, uint32.
        friction, rolling_friction: coefficients between particles; the smaller of a pair counts.
        cohesion: pressure that holds two particles together [Pa], on the smaller cross section.
        tool_friction, tool_rolling_friction, adhesion: the same at a tool.
        frozen: whether its deposit is requested and not answered yet: it does not move, supports
            others, and its volume still counts.
        penetration_limited: whether the ground's force is limited to a small penetration, see
            `contacts.ground_contacts`.
        settle_timer: time for which it has been slow on the ground [s].
        ground_spring: tangential spring of its ground contact [m], shape (n, 3).
        ground_overlap: overlap with the ground at the end of the last step [m]; 0 out of reach.
        sleep_state: awake, asleep on the map or locked to a tool, see `sleep.sleep_state`, int16.
        wake_reference: of a particle locked to a tool, its position [m] in the tool frame; of an
            awake one, its position [m] in the map frame when the particles that sleep against it
            last had a valid support, see `sleep.wake_conditions`. Shape (n, 3).
        sleep_timer: time for which it has hardly moved [s].
        pair_list_row, plate_list_row: its row in the pair list and in the plate list of the last
            step, -1 if it is not listed.
        boxed: the columns above as a table for kernels, boxed; it remains the same table where
            particles are added, removed or reordered.
        count: number of particles.
        capacity: maximum number of particles.
        next_id: id of the next particle.
        total_volume_mm3: bank volume of all particles [mm^3], frozen ones included, exact.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    radius: NDArray[np.float32]
    contact_radius: NDArray[np.float32]
    mass: NDArray[np.float32]
    inverse_mass: NDArray[np.float32]
    volume_mm3: NDArray[np.int64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    particle_id: NDArray[np.uint32]
    frozen: NDArray[np.bool_]
    penetration_limited: NDArray[np.bool_]
    angular_velocity: NDArray[np.float32]
    friction: NDArray[np.float32]
    rolling_friction: NDArray[np.float32]
    cohesion: NDArray[np.float32]
    tool_friction: NDArray[np.float32]
    tool_rolling_friction: NDArray[np.float32]
    adhesion: NDArray[np.float32]
    settle_timer: NDArray[np.float32]
    sleep_state: NDArray[np.int16]
    wake_reference: NDArray[np.float64]
    sleep_timer: NDArray[np.float32]
    ground_spring: NDArray[np.float32]
    ground_overlap: NDArray[np.float32]
    pair_list_row: NDArray[np.int32]
    plate_list_row: NDArray[np.int32]
    boxed: BoxedTable
    total_volume_mm3: int

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.count = 0
        self.next_id = 1
        self._rows_by_id: NDArray[np.intp] | None = None
        self._made_when_read: list[str] = []
        self._set_columns(allocate_columns(min(capacity, _INITIAL_CAPACITY)))

    def __getstate__(self) -> dict[str, Any]:
        """Pickle what the other attributes are made from."""
        names = ("capacity", "count", "next_id", "_rows_by_id", "_columns")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state that was pickled."""
        vars(self).update(state, _made_when_read=[])
        self._set_columns(self._columns)

    @property
    def columns(self) -> ParticleColumns:
        """The columns as a table."""
        return ParticleColumns(*(getattr(self, name) for name in ParticleColumns._fields))

    def add(self, count: int, **columns: ArrayLike) -> NDArray[np.uint32]:
        """Append particles; columns that are not given are zero.

        Returns:
            Ids of the new particles, ascending, shape (count,).

        Raises:
            ParticleError: more particles than `capacity`, or no ids left.
        """
        if self.count + count > self.capacity:
            raise ParticleError(
                f"{self.count} + {count} particles exceed the capacity of {self.capacity};"
                " raise `capacity` or make larger particles"
            )
        if self.next_id + count > 2**32:
            raise ParticleError("all particle ids are used; reset the simulation")
        start, end = self.count, self.count + count
        if end > len(self._columns["frozen"]):
            self._reallocate(min(self.capacity, max(end, 2 * start)))
        for name, column in self._columns.items():
            column[start:end] = columns.get(name, 0)
        ids = np.arange(self.next_id, self.next_id + count, dtype=np.uint32)
        self._columns["particle_id"][start:end] = ids
        self._columns["pair_list_row"][start:end] = -1
        self._columns["plate_list_row"][start:end] = -1
        self.next_id += count
        self.count = end
        # The new ids are the largest, so that the order by id is known.
        if self._rows_by_id is not None:
            self._rows_by_id = np.concatenate([self._rows_by_id, np.arange(start, end)])
        self._update_views()
        return ids

    def rows(self, ids: ArrayLike) -> NDArray[np.intp]:
        """Return the rows of particles, in the order of `ids`.

        Raises:
            ParticleError: an id that does not exist, or one given twice.
        """
        wanted = np.atleast_1d(np.asarray(ids))
        if wanted.size == 0:
            return np.zeros(0, dtype=np.intp)
        wanted = wanted.astype(np.int64)
        if self._rows_by_id is None:
            self._rows_by_id = np.argsort(self.particle_id, kind="stable")
        rows = np.empty(wanted.size, dtype=np.intp)
        error = _find_rows(wanted, self.particle_id, self._rows_by_id, rows)
        if error == _DUPLICATE_ID:
            raise ParticleError("a particle id is given twice; give each id once")
        if error == _UNKNOWN_ID:
            raise ParticleError("a particle id does not exist; ids are never reused")
        return rows

    def remove(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Remove particles; the others keep their order.

        Returns:
            Former rows of the remaining particles, ascending.
        """
        kept = np.empty(self.count, np.intp)
        order = _NO_ROWS if self._rows_by_id is None else self._rows_by_id
        self.count = remove_rows(rows, self.count, self._boxed_columns, self.boxed, order, kept)
        if self._rows_by_id is not None:
            self._rows_by_id = order[: self.count]
        self._drop_views()
        return kept[: self.count]

    def renumber(self, ids: NDArray[np.uint32], next_id: int) -> None:
        """Give all particles other ids, shape (n,), and the next one that is added `next_id`."""
        self.particle_id[:] = ids
        self.next_id = next_id
        self._rows_by_id = None

    def reorder(self, order: NDArray[np.intp]) -> None:
        """Make row `order[k]` row k; rows that are not named are removed."""
        for column in self._columns.values():
            column[: order.size] = column.take(order, axis=0)  # three times as fast as indexing
        self._rows_by_id = None
        self.count = order.size
        self._update_views()

    def _reallocate(self, capacity: int) -> None:
        """Move the columns to arrays with room for more rows."""
        columns = allocate_columns(capacity)
        for name, column in self._columns.items():
            columns[name][: self.count] = column[: self.count]
        self._set_columns(columns)

    def _set_columns(self, columns: dict[str, NDArray[Any]]) -> None:
        self._columns = columns
        table = ParticleColumns(**columns)
        self._boxed_columns = box_table(table)
        if "boxed" not in vars(self):
            self.boxed = box_table(table)
        self._update_views()

    def _update_views(self) -> None:
        """Make the table for kernels one of the rows in use, and the attributes views of these."""
        view_rows(self.count, self._boxed_columns, self.boxed)
        self._drop_views()

    def _drop_views(self) -> None:
        """Discard the attributes that are made of the rows in use when they are first read."""
        for name in self._made_when_read:
            delattr(self, name)
        self._made_when_read.clear()


class _RowView:
    """Attribute that is made when it is first read: a view of the rows in use of a column."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, state: ParticleState, owner: type) -> NDArray[Any]:
        view: NDArray[Any] = state._columns[self._name][: state.count]
        vars(state)[self._name] = view
        state._made_when_read.append(self._name)
        return view


class _TotalVolume:
    """Attribute that is made when it is first read: the volume of all particles."""

    def __get__(self, state: ParticleState, owner: type) -> int:
        total = int(state.volume_mm3.sum())
        state.total_volume_mm3 = total
        state._made_when_read.append("total_volume_mm3")
        return total


for _name in COLUMN_TYPES:
    setattr(ParticleState, _name, _RowView(_name))
ParticleState.total_volume_mm3 = _TotalVolume()  # type: ignore[assignment]


@kernel
def _find_rows(ids, particle_id, order, rows):  # type: ignore[no-untyped-def]
    """Find the rows of some ids by bisection.

    Args:
        ids: ids to find.
        particle_id: id of each row.
        order: rows in the order of their ids.
        rows: out, shape (ids,).

    Returns:
        An error code, 0 if all were found.
    """
    is_found = np.zeros(order.size, dtype=np.bool_)
    for k in range(ids.size):
        low, high = 0, order.size
        while low < high:
            middle = (low + high) // 2
            if particle_id[order[middle]] < ids[k]:
                low = middle + 1
            else:
                high = middle
        if low == order.size or particle_id[order[low]] != ids[k]:
            return _UNKNOWN_ID
        if is_found[low]:
            return _DUPLICATE_ID
        is_found[low] = True
        rows[k] = order[low]
    return 0
