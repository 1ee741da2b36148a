"""The plate contacts of a step, plate by plate, laid out for the compiler as pairs are.

Contacts of one plate fill blocks of their own: what is the plate's is then the same for all lanes
of a vector. In a block, quantity q of slot s lies at `q * BLOCK + s`. Places and springs are in
plate axes, (a, b, h) as in `plates`, taken once a step from float64 positions; the substeps go on
in float32 displacements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.jit import kernel
from machine_sim.particles.pairs.simd import GROUP
from machine_sim.particles.plates import plate_coordinates
from machine_sim.particles.pose import to_tool
from machine_sim.particles.store import ParticleStore
from machine_sim.particles.tool import ToolSet
from machine_sim.particles.walls.listing import WallTable

__all__ = ["BLOCK", "WallBlocks", "WallContacts"]

BLOCK = 64
"""Contacts in a block, a multiple of the widest vector's lanes."""

QUANTITIES = 16
"""Place of the centre (3); arm from the tool's origin to it, map axes (3); radius, and its ratio to
the contact radius; mass, friction, rolling friction, bond; spring (3); side."""

_LEAST_AT_PLATE = np.float32(0.5)
"""Smallest radius a plate feels, in full radii. One released into a crowd starts as a point, and
its neighbours would press a point through a plate."""
_PI = np.float32(np.pi)
_ZERO = np.float32(0.0)


class WallBlocks(NamedTuple):
    """Plate contacts of one step, in blocks.

    Attributes:
        plate, size: plate of each block, and its contacts, int64, shape (blocks,).
        row: particle of each slot, uint32.
        tool_row: the record of the plate's tool among the bodies, of each slot, uint32.
        block: quantities, shape (blocks or more, QUANTITIES * BLOCK), float32.
    """

    plate: NDArray[np.int64]
    size: NDArray[np.int64]
    row: NDArray[np.uint32]
    tool_row: NDArray[np.uint32]
    block: NDArray[np.float32]


class WallContacts:
    """Lays out the plate contacts of a step, and keeps the room for them."""

    def __init__(self) -> None:
        self._slot = np.zeros(0, np.int64)
        self._room(32)

    def _room(self, blocks: int) -> None:
        self._blocks = WallBlocks(
            np.zeros(blocks, np.int64),
            np.zeros(blocks, np.int64),
            np.zeros(blocks * BLOCK, np.uint32),
            np.zeros(blocks * BLOCK, np.uint32),
            np.zeros((blocks, QUANTITIES * BLOCK), np.float32),
        )

    def lay_out(  # type: ignore[no-untyped-def]
        self, store: ParticleStore, table: WallTable, tools: ToolSet, body, total
    ) -> WallBlocks:
        """Take over the listed contacts, with their springs.

        Args:
            store: the particles.
            table: where they are listed.
            tools: at the start of the step.
            body, total: records and sums, see `bodies`; the last rows become the tools'.

        Returns:
            The blocks, good until the next call.
        """
        blocks = self._blocks
        if not tools.tools:
            return blocks._replace(plate=blocks.plate[:0], size=blocks.size[:0])
        most = table.count // BLOCK + len(tools.owner)
        if most > len(blocks.plate):
            self._room(2 * most)
            blocks = self._blocks
        if len(self._slot) < table.count:
            self._slot = np.zeros(len(table.row), np.int64)
        count = _lay_out(
            table.listed, table.spring, table.side, store.position, store.radius, store.mass,
            store.tool_friction, store.tool_rolling, store.adhesion, tools.plates, tools.owner,
            tools.path[0], tools.twist, body, total, blocks, self._slot,
        )  # fmt: skip
        return blocks._replace(plate=blocks.plate[:count], size=blocks.size[:count])

    def give_back(self, table: WallTable) -> None:
        """Keep springs and sides in the table, from which the next one is listed."""
        _give_back(table.count, self._slot, self._blocks.block, table.spring, table.side)


@kernel
def _lay_out(  # type: ignore[no-untyped-def]
    listed, spring, side, position, radius, mass, friction, rolling, adhesion, plates, owner, pose,
    twist, body, total, blocks, slot,
):  # fmt: skip
    """Fill the blocks, in the order of plates; returns how many.

    Args:
        listed, spring, side: of the table.
        position ... adhesion: of the particles.
        plates, owner, twist: of the tools; pose: theirs at the start of the step.
        body, total: in and out, see `WallContacts.lay_out`.
        blocks: out.
        slot: out, where each listed contact went.
    """
    row, tool_row, block = blocks.row, blocks.tool_row, blocks.block
    last = body.shape[0] - 1
    for t in range(pose.shape[0]):
        # A tool is a body with a spin: rolling friction holds particles back toward it. What
        # moves otherwise is taken off contact by contact, since it depends on the place.
        for c in range(body.shape[1]):
            body[last - t, c] = _ZERO
        for c in range(total.shape[1]):
            total[last - t, c] = _ZERO
        for axis in range(3):
            body[last - t, 12 + axis] = twist[t, 3 + axis]
    count, free = _blocks_of_plates(listed.plate, owner.size, blocks.plate, blocks.size)
    for c in range(listed.row.size):
        i, k = listed.row[c], listed.plate[c]
        t = owner[k]
        at = free[k]
        free[k] += 1
        slot[c] = at
        row[at], tool_row[at] = i, last - t
        b = block[at // BLOCK]
        s = at % BLOCK
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        b[s + 3 * BLOCK] = x - pose[t, 9]
        b[s + 4 * BLOCK] = y - pose[t, 10]
        b[s + 5 * BLOCK] = z - pose[t, 11]
        x, y, z = to_tool(pose[t], x, y, z)
        b[s], b[s + BLOCK], b[s + 2 * BLOCK] = plate_coordinates(plates, k, x, y, z)
        r = max(body[i, 3], _LEAST_AT_PLATE * radius[i])
        b[s + 6 * BLOCK], b[s + 7 * BLOCK] = r, r / body[i, 3]
        b[s + 8 * BLOCK] = mass[i]
        b[s + 9 * BLOCK], b[s + 10 * BLOCK] = friction[i], rolling[i]
        b[s + 11 * BLOCK] = _PI * r * r * adhesion[i]
        for axis in range(3):
            b[s + (12 + axis) * BLOCK] = spring[c, axis]
        b[s + 15 * BLOCK] = side[c]
    for n in range(count):
        _fill_up(n * BLOCK, blocks.size[n], row, tool_row, block[n])
    return count


@kernel
def _blocks_of_plates(listed, many, plate, size):  # type: ignore[no-untyped-def]
    """Give each of `many` plates blocks enough for its contacts.

    Args:
        listed: plate of each contact.
        many: how many plates there are.
        plate, size: out, of each block.

    Returns:
        How many blocks, and the first slot of each plate.
    """
    contacts, first = np.zeros(many, np.int64), np.zeros(many, np.int64)
    for k in listed:
        contacts[k] += 1
    blocks = 0
    for k in range(many):
        first[k] = blocks * BLOCK
        left = contacts[k]
        while left > 0:
            plate[blocks], size[blocks] = k, min(left, BLOCK)
            left -= BLOCK
            blocks += 1
    return blocks, first


@kernel
def _fill_up(begin, size, row, tool_row, b):  # type: ignore[no-untyped-def]
    """Fill up the last group of a block with copies of its last contact that weigh nothing."""
    s = size
    while s % GROUP != 0:
        row[begin + s], tool_row[begin + s] = row[begin + s - 1], tool_row[begin + s - 1]
        for q in range(QUANTITIES):
            b[s + q * BLOCK] = b[s - 1 + q * BLOCK]
        b[s + 8 * BLOCK] = b[s + 11 * BLOCK] = _ZERO
        s += 1


@kernel
def _give_back(count, slot, block, spring, side):  # type: ignore[no-untyped-def]
    for c in range(count):
        b = block[slot[c] // BLOCK]
        s = slot[c] % BLOCK
        for axis in range(3):
            spring[c, axis] = b[s + (12 + axis) * BLOCK]
        side[c] = b[s + 15 * BLOCK]
