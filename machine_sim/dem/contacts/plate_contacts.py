"""The plate contacts of a step, plate by plate, in blocks (see `plate_block`).

Contacts of one plate fill blocks of their own, so that the data of the plate are the same for all
lanes of a vector. Positions and springs are in plate axes (a, b, h), computed once per step from
float64 positions; the substeps continue with float32 displacements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.body_records import (
    ANGULAR_VELOCITY,
    BODY_RECORD_SIZE,
    CONTACT_RADIUS,
    clear_force_sums,
    tool_record_row,
)
from machine_sim.dem.contacts import plate_block as plate
from machine_sim.dem.contacts.plate_contact_list import PlateContactTable
from machine_sim.dem.contacts.simd import GROUP_SIZE
from machine_sim.dem.tools.plates import plate_coordinates
from machine_sim.dem.tools.pose import ANGULAR, ORIGIN, to_tool_frame
from machine_sim.dem.vec3 import load_row, subtract
from msg_bridge.kernels import BoxedTable, box_table, helper, kernel

__all__ = [
    "MIN_PLATE_RADIUS_FRACTION",
    "PlateContactBlocks",
    "PlateContacts",
    "fill_plate_blocks",
    "store_plate_history",
]

MIN_PLATE_RADIUS_FRACTION = 0.5
"""Minimum radius of a particle in contacts with plates, in full radii. A particle released among
others starts as a point, and its neighbours would press a point through a plate."""
_PI = np.float32(np.pi)
_ZERO = np.float32(0.0)


class PlateContactBlocks(NamedTuple):
    """Plate contacts of one step, in blocks.

    Attributes:
        plate: plate of each block, int64, shape (blocks,).
        size: number of contacts in each block, int64, shape (blocks,).
        row: row of the particle in each slot, uint32.
        tool_row: row of the record of the plate's tool, of each slot, uint32.
        block: quantities, see `plate_block`, float32, shape (blocks or more, NUM_QUANTITIES *
            BLOCK_SIZE).
    """

    plate: NDArray[np.int64]
    size: NDArray[np.int64]
    row: NDArray[np.uint32]
    tool_row: NDArray[np.uint32]
    block: NDArray[np.float32]


class PlateContactMemory(NamedTuple):
    """Memory for plate contacts.

    Attributes:
        blocks: the blocks.
        slot: slot of each listed contact, int64.
    """

    blocks: PlateContactBlocks
    slot: NDArray[np.int64]


class PlateContacts:
    """Memory for the plate contacts of a step, laid out in blocks.

    Attributes:
        memory, boxed_memory: the arrays, for kernels.
    """

    def __init__(self) -> None:
        self._allocate(32, 0)

    def _allocate(self, num_blocks: int, num_slots: int) -> None:
        blocks = PlateContactBlocks(
            plate=np.zeros(num_blocks, np.int64),
            size=np.zeros(num_blocks, np.int64),
            row=np.zeros(num_blocks * plate.BLOCK_SIZE, np.uint32),
            tool_row=np.zeros(num_blocks * plate.BLOCK_SIZE, np.uint32),
            block=np.zeros((num_blocks, plate.NUM_QUANTITIES * plate.BLOCK_SIZE), np.float32),
        )
        self.memory = PlateContactMemory(blocks, np.zeros(num_slots, np.int64))
        self.boxed_memory: BoxedTable = box_table(self.memory)

    def reserve(self, table: PlateContactTable, num_plates: int) -> None:
        """Make room for as many contacts as a table can hold, with a number of plates."""
        max_blocks = len(table.row) // plate.BLOCK_SIZE + num_plates
        if max_blocks > len(self.memory.blocks.plate) or len(table.row) > len(self.memory.slot):
            self._allocate(2 * max_blocks, len(table.row))


@kernel
def fill_plate_blocks(  # type: ignore[no-untyped-def]
    candidates, spring, side, particles, tools, body, force_sums, blocks, slot,
):  # fmt: skip
    """Copy the listed contacts, with their springs, into blocks, in the order of plates.

    Args:
        candidates, spring, side: the listed contacts, see `PlateContactTable`.
        particles: `ParticleColumns`.
        tools: `ToolMotion`.
        body, force_sums: see `body_records`; the records of the tools are filled.
        blocks: out, `PlateContactBlocks`.
        slot: out, slot of each listed contact.

    Returns:
        The blocks that are filled, `PlateContactBlocks`.
    """
    pose, tool_of_plate, plates = tools.path[0], tools.tool_of_plate, tools.plates
    row, plate_of_contact = candidates.row, candidates.plate
    slot_row, slot_tool_row, block = blocks.row, blocks.tool_row, blocks.block
    position, full_radius, mass = particles.position, particles.radius, particles.mass
    friction, adhesion = particles.tool_friction, particles.adhesion
    rolling_friction = particles.tool_rolling_friction
    _fill_tool_records(tools.twist, body, force_sums)
    count, next_slot = _allocate_blocks(
        plate_of_contact, tool_of_plate.size, blocks.plate, blocks.size
    )
    for c in range(row.size):
        i, k = row[c], plate_of_contact[c]
        t = tool_of_plate[k]
        at = next_slot[k]
        next_slot[k] += 1
        slot[c] = at
        slot_row[at], slot_tool_row[at] = i, tool_record_row(body.shape[0], t)
        b = block[at // plate.BLOCK_SIZE]
        s = at % plate.BLOCK_SIZE
        centre = load_row(position, i, 0)
        plate.store(b, plate.LEVER_ARM, s, subtract(centre, load_row(pose, t, ORIGIN)))
        x, y, z = to_tool_frame(pose[t], centre[0], centre[1], centre[2])
        plate.store(b, plate.CENTRE, s, plate_coordinates(plates, k, x, y, z))
        contact_radius = body[i, CONTACT_RADIUS]
        radius = max(contact_radius, np.float32(MIN_PLATE_RADIUS_FRACTION) * full_radius[i])
        b[plate.RADIUS + s] = radius
        b[plate.RADIUS_RATIO + s] = radius / contact_radius
        b[plate.MASS + s] = mass[i]
        b[plate.FRICTION + s] = friction[i]
        b[plate.ROLLING_FRICTION + s] = rolling_friction[i]
        b[plate.ADHESION_FORCE + s] = _PI * radius * radius * adhesion[i]
        plate.store(b, plate.TANGENTIAL_SPRING, s, load_row(spring, c, 0))
        b[plate.SIDE + s] = side[c]
    for n in range(count):
        _pad_last_group(n * plate.BLOCK_SIZE, blocks.size[n], slot_row, slot_tool_row, block[n])
    return PlateContactBlocks(
        blocks.plate[:count], blocks.size[:count], slot_row, slot_tool_row, block
    )


@helper(forceinline=True)
def _fill_tool_records(twist, body, force_sums):  # type: ignore[no-untyped-def]
    """Fill the records of the tools.

    Rolling resistance drives particles toward a tool's angular velocity. The rest of the tool's
    motion is subtracted contact by contact, since it depends on the position: it is zero here.
    """
    for t in range(twist.shape[0]):
        row = tool_record_row(body.shape[0], t)
        for column in range(BODY_RECORD_SIZE):
            body[row, column] = _ZERO
        clear_force_sums(force_sums, row)
        for axis in range(3):
            body[row, ANGULAR_VELOCITY + axis] = twist[t, ANGULAR + axis]


@kernel(forceinline=True)
def _allocate_blocks(plate_of_contact, num_plates, plate_of_block, size):  # type: ignore[no-untyped-def]
    """Give each plate enough blocks for its contacts.

    Args:
        plate_of_contact: plate of each contact.
        num_plates: number of plates.
        plate_of_block, size: out, plate and number of contacts of each block.

    Returns:
        Number of blocks, and the first slot of each plate.
    """
    num_contacts, first_slot = np.zeros(num_plates, np.int64), np.zeros(num_plates, np.int64)
    for k in plate_of_contact:
        num_contacts[k] += 1
    num_blocks = 0
    for k in range(num_plates):
        first_slot[k] = num_blocks * plate.BLOCK_SIZE
        num_left = num_contacts[k]
        while num_left > 0:
            plate_of_block[num_blocks], size[num_blocks] = k, min(num_left, plate.BLOCK_SIZE)
            num_left -= plate.BLOCK_SIZE
            num_blocks += 1
    return num_blocks, first_slot


@helper(forceinline=True)
def _pad_last_group(begin, size, row, tool_row, b):  # type: ignore[no-untyped-def]
    """Pad the last group of a block with copies of its last contact that exert no force.

    Args:
        begin: first slot of the block.
        size: number of its contacts.
        row, tool_row: see `PlateContactBlocks`.
        b: quantities of the block.
    """
    s = size
    while s % GROUP_SIZE != 0:
        row[begin + s], tool_row[begin + s] = row[begin + s - 1], tool_row[begin + s - 1]
        for q in range(plate.NUM_QUANTITIES):
            b[q * plate.BLOCK_SIZE + s] = b[q * plate.BLOCK_SIZE + s - 1]
        b[plate.MASS + s] = b[plate.ADHESION_FORCE + s] = _ZERO
        s += 1


@kernel
def store_plate_history(count, slot, block, spring, side):  # type: ignore[no-untyped-def]
    """Write springs and sides back to the table, from which the next step takes them.

    Args:
        count: number of listed contacts.
        slot: slot of each.
        block: quantities of the blocks.
        spring, side: out, see `PlateContactTable`.
    """
    for c in range(count):
        b, s = block[slot[c] // plate.BLOCK_SIZE], slot[c] % plate.BLOCK_SIZE
        spring[c, 0], spring[c, 1], spring[c, 2] = plate.load(b, plate.TANGENTIAL_SPRING, s)
        side[c] = b[plate.SIDE + s]
