"""All contacts of a step, as its last stages get them: sleep, for example."""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.dem.contacts.ground_contacts import GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from msg_bridge.kernels import BoxedTable

__all__ = ["BoundaryContacts", "StepContactTables", "StepContacts"]


class BoundaryContacts(NamedTuple):
    """Numbers of contacts with plates and with the ground that were listed for a step."""

    num_plate_contacts: int
    num_ground_contacts: int


class StepContactTables(NamedTuple):
    """Tables with the contacts of a step, for kernels.

    Attributes:
        memory: `StepMemory`, boxed, as the others.
        pairs: `PairContactData`.
        plates, num_plate_contacts: `PlateContactArrays`, and the number of contacts in it.
        ground, num_ground_contacts: `GroundData`, and the number of contacts in it.
    """

    memory: BoxedTable
    pairs: BoxedTable
    plates: BoxedTable
    num_plate_contacts: int
    ground: BoxedTable
    num_ground_contacts: int


class StepContacts(NamedTuple):
    """Contacts of a step, for kernels.

    Attributes:
        pair_contacts: contacts of two particles.
        plate_contacts: particles near plates.
        ground_contacts: particles near the ground.
    """

    pair_contacts: PairContactBlocks
    plate_contacts: PlateCandidates
    ground_contacts: GroundContacts
