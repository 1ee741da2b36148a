"""The substeps of a physics step: contact forces, then explicit integration, several times over."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from machine_sim.dem.contacts import ground_block as ground
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
from msg_bridge.kernels import threaded_helper

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
    begin, size = pair_contacts.begin, pair_contacts.size
    padded_rows = pad_rows(rows)
    # Memory is allocated once: for few particles that takes as long as the work on a chunk.
    ground_scratch = np.empty((NUM_CHUNKS, ground.SCRATCH_SIZE), np.float32)
    integration_scratch = np.empty((NUM_CHUNKS, SCRATCH_SIZE), np.float32)
    for step in range(params.num_substeps):
        # First all regions at once, then all region boundaries.
        for is_region_boundary in range(2):
            num_parts = (begin.size + 1 - is_region_boundary) // 2
            for r in prange(num_parts):
                part = 2 * interleave(r, num_parts) + is_region_boundary
                pair_forces(begin[part], size[part], pair_contacts, body, force_sums, pair_params)
        plate_forces(plate_contacts, body, force_sums, tools, step, surface_params)
        for c in prange(NUM_CHUNKS):
            low, high = aligned_bounds(num_ground_contacts, c, ground.BLOCK_SIZE)
            ground_forces(
                low, high, ground_blocks, body, force_sums, surface_params,
                params.ground_friction, params.ground_rolling_friction, ground_scratch[c],
            )  # fmt: skip
        for c in prange(NUM_CHUNKS):
            low, high = aligned_bounds(padded_rows.size, c, GROUP_SIZE)
            integrate_bodies(
                padded_rows[low:high], body, force_sums, params.gravity, dt, integration_scratch[c]
            )
        advance_locked_loads(locked, body, force_sums, position, tools, step, dt)
