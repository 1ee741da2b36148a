"""The particles themselves: one array per quantity, with room to grow.

Rows keep the order of release unless `reorder` is called; `particle_id` is what lasts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.kernels import kernel

__all__ = ["ParticleError", "ParticleState"]

_COLUMN_TYPES: dict[str, tuple[str, tuple[int, ...]]] = {
    "position": ("f8", (3,)),
    "velocity": ("f8", (3,)),
    "angular_velocity": ("f4", (3,)),
    "radius": ("f4", ()),
    "contact_radius": ("f4", ()),
    "mass": ("f4", ()),
    "inverse_mass": ("f4", ()),
    "volume_mm3": ("i8", ()),
    "soil": ("u1", ()),
    "moisture": ("u1", ()),
    "particle_id": ("u4", ()),
    "friction": ("f4", ()),
    "rolling_friction": ("f4", ()),
    "cohesion": ("f4", ()),
    "tool_friction": ("f4", ()),
    "tool_rolling_friction": ("f4", ()),
    "adhesion": ("f4", ()),
    "frozen": ("?", ()),
    "penetration_limited": ("?", ()),
    "settle_timer": ("f4", ()),
    "ground_spring": ("f4", (3,)),
    "sleep_state": ("i2", ()),
    "wake_reference": ("f8", (3,)),
    "sleep_timer": ("f4", ()),
    "pair_list_row": ("i4", ()),
    "plate_list_row": ("i4", ()),
}


_DUPLICATE_ID, _UNKNOWN_ID = 1, 2


class ParticleError(EarthmovingError):
    """Particles that cannot be made, or ids that are not alive; nothing was changed."""


class ParticleState:
    """Struct of arrays over the live particles; attributes are views of their rows.

    Attributes:
        position: centres [m], map frame, shape (n, 3), float64.
        velocity: [m/s], map frame, shape (n, 3), float64.
        spin: angular velocity [rad/s], map axes, shape (n, 3), float32.
        radius: full radius [m], shape (n,), float32.
        contact_radius: radius felt by contacts [m], grows to `radius`; 0 until the first step.
        mass: [kg], shape (n,), float32.
        inverse_mass: [1/kg], 0 while frozen.
        volume_mm3: the account: bank volume [mm^3], shape (n,), int64.
        soil, moisture: soil type and moisture code, uint8.
        particle_id: unique, never used twice, from 1, uint32.
        friction, rolling: coefficients between particles; of a pair the smaller counts.
        cohesion: pressure that holds two together [Pa], on the smaller's cross section.
        tool_friction, tool_rolling_friction, adhesion: the same at a tool.
        frozen: landed and not yet answered: does not move, supports others, still counts.
        soft: beside a tool, or not yet out of the ground there; see `soil_contact`.
        settle_timer: how long it has been slow on the ground [s].
        ground_spring: tangential spring of its ground contact [m], shape (n, 3).
        resting: 0 for awake; what it rests in otherwise, see `sleep`.
        place: where it rests in a tool [m], tool frame; of one awake, where it was when those that
            sleep against it last counted on it, map frame, see `waking`. Shape (n, 3).
        sleep_timer: how long it has hardly moved [s].
        pair_list_row, plate_list_row: its row in the pair and plate list of the last step, -1 if it has none.
        next_id: the id of the next particle.
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
    pair_list_row: NDArray[np.int32]
    plate_list_row: NDArray[np.int32]

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.count = 0
        self.next_id = 1
        self._columns = _allocate(min(capacity, 1024))
        self._rows_by_id: NDArray[np.intp] | None = None
        self._update_views()

    @property
    def total_volume_mm3(self) -> int:
        """Bank volume of all particles [mm^3], frozen ones included, exact."""
        return int(self.volume_mm3.sum())

    def add(self, count: int, **columns: ArrayLike) -> NDArray[np.uint32]:
        """Append particles; columns not given are zero.

        Returns:
            Their ids, ascending, shape (count,).

        Raises:
            ParticleError: more than `capacity`, or no ids left.
        """
        if self.count + count > self.capacity:
            raise ParticleError(
                f"{self.count} + {count} particles are more than the capacity of {self.capacity};"
                " raise `capacity` or make larger particles"
            )
        if self.next_id + count > 2**32:
            raise ParticleError("particle ids are used up; reset the simulation")
        start, end = self.count, self.count + count
        if end > len(self._columns["frozen"]):
            room = _allocate(min(self.capacity, max(end, 2 * start)))
            for name, column in self._columns.items():
                room[name][:start] = column[:start]
            self._columns = room
        for name, column in self._columns.items():
            column[start:end] = columns.get(name, 0)
        ids = np.arange(self.next_id, self.next_id + count, dtype=np.uint32)
        self._columns["particle_id"][start:end] = ids
        self._columns["pair_list_row"][start:end] = -1
        self._columns["plate_list_row"][start:end] = -1
        self.next_id += count
        self.count = end
        # Ids ascend: the new ones come last.
        by_id = self._rows_by_id
        self._update_views()
        if by_id is not None:
            self._rows_by_id = np.concatenate([by_id, np.arange(start, end)])
        return ids

    def rows(self, ids: ArrayLike) -> NDArray[np.intp]:
        """Rows of particles, in the order of `ids`.

        Raises:
            ParticleError: an id that is not alive, or one given twice.
        """
        wanted = np.atleast_1d(np.asarray(ids))
        if wanted.size == 0:
            return np.zeros(0, dtype=np.intp)
        wanted = wanted.astype(np.int64)
        if self._rows_by_id is None:
            self._rows_by_id = np.argsort(self.particle_id, kind="stable")
        rows = np.empty(wanted.size, dtype=np.intp)
        fault = _find_rows(wanted, self.particle_id, self._rows_by_id, rows)
        if fault == _DUPLICATE_ID:
            raise ParticleError("a particle id is given twice; give each id once")
        if fault == _UNKNOWN_ID:
            raise ParticleError("no live particle has one of the ids given; ids are never reused")
        return rows

    def remove(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Take particles out; the others keep their order.

        Returns:
            The rows these had.
        """
        keep = np.ones(self.count, dtype=np.bool_)
        keep[rows] = False
        kept = np.flatnonzero(keep)
        by_id = self._rows_by_id
        self.reorder(kept)
        if by_id is not None:
            self._rows_by_id = (np.cumsum(keep) - 1)[by_id[keep[by_id]]]
        return kept

    def reorder(self, order: NDArray[np.intp]) -> None:
        """Make row `order[k]` row k; rows not named are dropped."""
        for column in self._columns.values():
            column[: order.size] = column.take(order, axis=0)  # thrice as quick as column[order]
        self.count = order.size
        self._update_views()

    def _update_views(self) -> None:
        """Let the attributes show the live rows."""
        self._rows_by_id = None
        for name, column in self._columns.items():
            setattr(self, name, column[: self.count])


@kernel
def _find_rows(wanted, particle_id, order, rows):  # type: ignore[no-untyped-def]
    """Find ids in `particle_id`, which `order` sorts.

    Args:
        rows: out, of each.

    Returns:
        What is wrong with them, 0 if nothing.
    """
    named = np.zeros(order.size, dtype=np.bool_)
    for k in range(wanted.size):
        low, high = 0, order.size
        while low < high:
            middle = (low + high) // 2
            if particle_id[order[middle]] < wanted[k]:
                low = middle + 1
            else:
                high = middle
        if low == order.size or particle_id[order[low]] != wanted[k]:
            return _UNKNOWN_ID
        if named[low]:
            return _DUPLICATE_ID
        named[low] = True
        rows[k] = order[low]
    return 0


def _allocate(capacity: int) -> dict[str, NDArray[Any]]:
    return {
        name: np.zeros((capacity, *shape), dtype=dtype)
        for name, (dtype, shape) in _COLUMN_TYPES.items()
    }
