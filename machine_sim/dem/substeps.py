"""The substeps of a physics step: contact forces, then explicit integration, several times over."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.dem.contacts import ground_block as ground
from machine_sim.dem.contacts import pair_block as pair
from machine_sim.dem.contacts import plate_block as plate
from machine_sim.dem.contacts.ground_forces import ground_forces
from machine_sim.dem.contacts.pair_forces import pair_forces
from machine_sim.dem.contacts.plate_forces import plate_forces
from machine_sim.dem.contacts.simd import GROUP_SIZE
from machine_sim.dem.integrate import (
    SCRATCH_SIZE,
    advance_locked_loads,
    integrate_bodies,
    pad_rows,
)
from machine_sim.dem.partition import NUM_CHUNKS, aligned_bounds, interleave
from msg_bridge.kernels import helper, threaded_helper

__all__ = ["LockedRows", "SubstepParams", "run_substeps"]


class SubstepParams(NamedTuple):
    """Physics of the substeps.

    Attributes:
        num_substeps: number of substeps in a step.
        gravity: acceleration of gravity, downward [m/s^2].
        ground_friction, ground_rolling_friction: coefficients at the ground.
    """

    num_substeps: int
    gravity: np.float32
    ground_friction: np.float32
    ground_rolling_friction: np.float32


class LockedRows(NamedTuple):
    """Particles that move with a tool as one body.

    Attributes:
        rows: their rows, int64, shape (n,).
        tool: number of the tool of each, int64, shape (n,).
    """

    rows: NDArray[np.int64]
    tool: NDArray[np.int64]


@threaded_helper
def run_substeps(  # type: ignore[no-untyped-def]
    params, pair_params, surface_params, rows, locked, body, force_sums, position, pair_contacts,
    plate_contacts, num_ground_contacts, ground_blocks, tools,
):  # fmt: skip
    """Advance all particles by `params.num_substeps` substeps of semi-implicit Euler.

    Args:
        params: `SubstepParams`.
        pair_params: `ContactParameters` of contacts between particles.
        surface_params: `ContactParameters` of contacts with plates and with the ground.
        rows: particles moved by forces, int64.
        locked: `LockedRows`.
        body, force_sums: see `body_records`; the sums are zero before and after.
        position: centres of all particles at the start of the step [m], shape (n, 3).
        pair_contacts: `PairContactBlocks`; every other part is a region boundary, see `partition`.
        plate_contacts: `PlateContactBlocks`.
        num_ground_contacts, ground_blocks: contacts with the ground, `GroundContactBlocks`.
        tools: `ToolMotion`; the wrench is summed over the substeps.
    """
    dt = pair_params.substep
    num_all_parts = pair_contacts.begin.size
    padded_rows = pad_rows(rows)
    # Memory is allocated once: for few particles that takes as long as the work on a chunk.
    pair_scratch = np.empty((num_all_parts, pair.SCRATCH_SIZE), np.float32)
    plate_scratch = np.empty(plate.SCRATCH_SIZE, np.float32)
    ground_scratch = np.empty((NUM_CHUNKS, ground.SCRATCH_SIZE), np.float32)
    integration_scratch = np.empty((NUM_CHUNKS, SCRATCH_SIZE), np.float32)
    for step in range(params.num_substeps):
        # First all regions at once, then all region boundaries.
        for is_region_boundary in range(2):
            num_parts = (num_all_parts + 1 - is_region_boundary) // 2
            for r in prange(num_parts):
                _add_pair_forces(
                    2 * interleave(r, num_parts) + is_region_boundary, pair_contacts, body,
                    force_sums, pair_params, pair_scratch,
                )  # fmt: skip
        plate_forces(plate_contacts, body, force_sums, tools, step, surface_params, plate_scratch)
        for c in prange(NUM_CHUNKS):
            _add_ground_forces(
                c, num_ground_contacts, ground_blocks, body, force_sums, surface_params, params,
                ground_scratch,
            )  # fmt: skip
        for c in prange(NUM_CHUNKS):
            _integrate_chunk(
                c, padded_rows, body, force_sums, params.gravity, dt, integration_scratch
            )
        advance_locked_loads(locked, body, force_sums, position, tools, step, dt)


# The work on a part or a chunk is in helpers, which count no references to arrays: in a loop over
# parts or chunks these counts take as long as the work on a few particles.


@helper(forceinline=True)
def _add_pair_forces(part, contacts, body, force_sums, params, scratch):  # type: ignore[no-untyped-def]
    """Add the forces of the pair contacts of a part of the pair list."""
    pair_forces(
        contacts.begin[part], contacts.size[part], contacts, body, force_sums, params, scratch[part]
    )


@helper(forceinline=True)
def _add_ground_forces(  # type: ignore[no-untyped-def]
    chunk, num_contacts, blocks, body, force_sums, surface, params, scratch
):
    """Add the forces of a chunk of the contacts with the ground."""
    low, high = aligned_bounds(num_contacts, chunk, ground.BLOCK_SIZE)
    ground_forces(
        low, high, blocks, body, force_sums, surface, params.ground_friction,
        params.ground_rolling_friction, scratch[chunk],
    )  # fmt: skip


@helper(forceinline=True)
def _integrate_chunk(chunk, rows, body, force_sums, gravity, dt, scratch):  # type: ignore[no-untyped-def]
    """Integrate a chunk of the rows that are moved by forces."""
    low, high = aligned_bounds(rows.size, chunk, GROUP_SIZE)
    integrate_bodies(rows[low:high], body, force_sums, gravity, dt, scratch[chunk])
