"""Check that machines and bins do not overlap at their initial poses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

from machine_sim.machine import MachineError, TrackedMachine
from machine_sim.physics_engine import pybullet
from machine_sim.simulated_bin import SimulatedBin

__all__ = ["check_overlaps"]

_MAX_INITIAL_PENETRATION = 0.05
"""Maximum initial interpenetration of two bodies [m]."""

_CONTACT_DISTANCE = 8
"""Index of the distance [m] in a record of `pybullet.getContactPoints`."""


def check_overlaps(
    client: int, machines: Sequence[TrackedMachine], bins: Sequence[SimulatedBin]
) -> None:
    """Check that no two machines or bins overlap.

    Args:
        client: physics client of all bodies.
        machines: machines at their initial poses.
        bins: bins at their poses.

    Raises:
        MachineError: two bodies overlap by more than `_MAX_INITIAL_PENETRATION`.
    """
    pybullet.performCollisionDetection(client)
    objects: list[tuple[str, list[int]]] = []
    for machine in machines:
        x, y, _ = machine.base_pose[0]
        objects.append((f"the {machine.spec.name} at ({x:.1f}, {y:.1f}) m", [machine.body]))
    objects += [(f"the bin at {each.spec.position} m", each.bodies) for each in bins]
    for (name_a, bodies_a), (name_b, bodies_b) in combinations(objects, 2):
        for a, b in product(bodies_a, bodies_b):
            contacts = pybullet.getContactPoints(a, b, physicsClientId=client)
            if any(contact[_CONTACT_DISTANCE] < -_MAX_INITIAL_PENETRATION for contact in contacts):
                raise MachineError(f"{name_a} and {name_b} overlap; move one of them")
