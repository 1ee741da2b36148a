"""DEPOSIT_REQUEST rows: particles that have settled and are to become terrain."""

from __future__ import annotations

from machine_sim.dem import SoilEngine
from msg_bridge.contract.rows import DEPOSIT_REQUEST, Rows, empty_rows, no_rows
from msg_bridge.kernels import fixed_signature_kernel

__all__ = ["request_deposits"]


def request_deposits(particles: SoilEngine, max_count: int) -> Rows:
    """Freeze settled particles, at most a number, and return DEPOSIT_REQUEST rows for them."""
    ids = particles.settled()[:max_count]
    if ids.size == 0:
        return no_rows(DEPOSIT_REQUEST)
    requests = empty_rows(DEPOSIT_REQUEST, ids.size)
    _fill_requests(requests, particles.rows_of(ids), particles.boxed_columns)
    particles.freeze(ids)
    return requests


@fixed_signature_kernel
def _fill_requests(requests, rows, boxed_particles):  # type: ignore[no-untyped-def]
    """Fill DEPOSIT_REQUEST rows for the particles in some rows of `ParticleColumns`, boxed."""
    particles = boxed_particles.table
    for k in range(rows.size):
        request, i = requests[k], rows[k]
        request.x, request.y = particles.position[i, 0], particles.position[i, 1]
        request.z = particles.position[i, 2]
        request.volume_mm3 = particles.volume_mm3[i]
        request.particle_id = particles.particle_id[i]
        request.soil, request.moisture = particles.soil[i], particles.moisture[i]
