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

from machine_sim.dem.contacts.plate_contact_list import PlateContactTable
from machine_sim.dem.contacts.simd import GROUP_SIZE
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools.plates import plate_coordinates
from machine_sim.dem.tools.pose import to_tool_frame
from machine_sim.dem.tools.tool_set import ToolSet
from msg_bridge.kernels import kernel

__all__ = ["BLOCK_SIZE", "PlateContactBlocks", "PlateContacts"]

BLOCK_SIZE = 64
"""Contacts in a block, a multiple of the widest vector's lanes."""

NUM_QUANTITIES = 16
"""Place of the centre (3); arm from the tool's origin to it, map axes (3); radius, and its ratio to
the contact radius; mass, friction, rolling friction, bond; spring (3); side."""

_MIN_PLATE_RADIUS_FRACTION = np.float32(0.5)
"""Smallest radius a plate feels, in full radii. One released into a crowd starts as a point, and
its neighbours would press a point through a plate."""
_PI = np.float32(np.pi)
_ZERO = np.float32(0.0)


class PlateContactBlocks(NamedTuple):
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


class PlateContacts:
    """Lays out the plate contacts of a step, and keeps the room for them."""

    def __init__(self) -> None:
        self._slot = np.zeros(0, np.int64)
        self._reserve(32)

    def _reserve(self, blocks: int) -> None:
        self._blocks = PlateContactBlocks(
            np.zeros(blocks, np.int64),
            np.zeros(blocks, np.int64),
            np.zeros(blocks * BLOCK_SIZE, np.uint32),
            np.zeros(blocks * BLOCK_SIZE, np.uint32),
            np.zeros((blocks, NUM_QUANTITIES * BLOCK_SIZE), np.float32),
        )

    def fill_blocks(  # type: ignore[no-untyped-def]
        self, state: ParticleState, table: PlateContactTable, tools: ToolSet, body, force_sums
    ) -> PlateContactBlocks:
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
        most = table.count // BLOCK_SIZE + len(tools.tool_of_plate)
        if most > len(blocks.plate):
            self._reserve(2 * most)
            blocks = self._blocks
        if len(self._slot) < table.count:
            self._slot = np.zeros(len(table.row), np.int64)
        count = _fill_blocks(
            table.candidates, table.spring, table.side, state.position, state.radius, state.mass,
            state.tool_friction, state.tool_rolling_friction, state.adhesion, tools.plates, tools.tool_of_plate,
            tools.path[0], tools.twist, body, force_sums, blocks, self._slot,
        )  # fmt: skip
        return blocks._replace(plate=blocks.plate[:count], size=blocks.size[:count])

    def store_history(self, table: PlateContactTable) -> None:
        """Keep springs and sides in the table, from which the next one is listed."""
        _store_history(table.count, self._slot, self._blocks.block, table.spring, table.side)


@kernel
def _fill_blocks(  # type: ignore[no-untyped-def]
    candidates, spring, side, position, radius, mass, friction, rolling_friction, adhesion, plates, tool_of_plate, pose,
    twist, body, force_sums, blocks, slot,
):  # fmt: skip
    """Fill the blocks, in the order of plates; returns how many.

    Args:
        listed, spring, side: of the table.
        position ... adhesion: of the particles.
        plates, owner, twist: of the tools; pose: theirs at the start of the step.
        body, total: in and out, see `PlateContacts.lay_out`.
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
        for c in range(force_sums.shape[1]):
            force_sums[last - t, c] = _ZERO
        for axis in range(3):
            body[last - t, 12 + axis] = twist[t, 3 + axis]
    count, free = _allocate_blocks(candidates.plate, tool_of_plate.size, blocks.plate, blocks.size)
    for c in range(candidates.row.size):
        i, k = candidates.row[c], candidates.plate[c]
        t = tool_of_plate[k]
        at = free[k]
        free[k] += 1
        slot[c] = at
        row[at], tool_row[at] = i, last - t
        b = block[at // BLOCK_SIZE]
        s = at % BLOCK_SIZE
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        b[s + 3 * BLOCK_SIZE] = x - pose[t, 9]
        b[s + 4 * BLOCK_SIZE] = y - pose[t, 10]
        b[s + 5 * BLOCK_SIZE] = z - pose[t, 11]
        x, y, z = to_tool_frame(pose[t], x, y, z)
        b[s], b[s + BLOCK_SIZE], b[s + 2 * BLOCK_SIZE] = plate_coordinates(plates, k, x, y, z)
        r = max(body[i, 3], _MIN_PLATE_RADIUS_FRACTION * radius[i])
        b[s + 6 * BLOCK_SIZE], b[s + 7 * BLOCK_SIZE] = r, r / body[i, 3]
        b[s + 8 * BLOCK_SIZE] = mass[i]
        b[s + 9 * BLOCK_SIZE], b[s + 10 * BLOCK_SIZE] = friction[i], rolling_friction[i]
        b[s + 11 * BLOCK_SIZE] = _PI * r * r * adhesion[i]
        for axis in range(3):
            b[s + (12 + axis) * BLOCK_SIZE] = spring[c, axis]
        b[s + 15 * BLOCK_SIZE] = side[c]
    for n in range(count):
        _pad_last_group(n * BLOCK_SIZE, blocks.size[n], row, tool_row, block[n])
    return count


@kernel
def _allocate_blocks(candidates, num_plates, plate, size):  # type: ignore[no-untyped-def]
    """Give each of `many` plates blocks enough for its contacts.

    Args:
        listed: plate of each contact.
        many: how many plates there are.
        plate, size: out, of each block.

    Returns:
        How many blocks, and the first slot of each plate.
    """
    contacts, first = np.zeros(num_plates, np.int64), np.zeros(num_plates, np.int64)
    for k in candidates:
        contacts[k] += 1
    blocks = 0
    for k in range(num_plates):
        first[k] = blocks * BLOCK_SIZE
        left = contacts[k]
        while left > 0:
            plate[blocks], size[blocks] = k, min(left, BLOCK_SIZE)
            left -= BLOCK_SIZE
            blocks += 1
    return blocks, first


@kernel
def _pad_last_group(begin, size, row, tool_row, b):  # type: ignore[no-untyped-def]
    """Fill up the last group of a block with copies of its last contact that weigh nothing."""
    s = size
    while s % GROUP_SIZE != 0:
        row[begin + s], tool_row[begin + s] = row[begin + s - 1], tool_row[begin + s - 1]
        for q in range(NUM_QUANTITIES):
            b[s + q * BLOCK_SIZE] = b[s - 1 + q * BLOCK_SIZE]
        b[s + 8 * BLOCK_SIZE] = b[s + 11 * BLOCK_SIZE] = _ZERO
        s += 1


@kernel
def _store_history(count, slot, block, spring, side):  # type: ignore[no-untyped-def]
    for c in range(count):
        b = block[slot[c] // BLOCK_SIZE]
        s = slot[c] % BLOCK_SIZE
        for axis in range(3):
            spring[c, axis] = b[s + (12 + axis) * BLOCK_SIZE]
        side[c] = b[s + 15 * BLOCK_SIZE]
