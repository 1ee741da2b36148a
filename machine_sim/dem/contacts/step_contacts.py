"""All contacts of a step, as its last stages get them: sleep."""

from __future__ import annotations

from typing import NamedTuple

from machine_sim.dem.contacts.ground_contacts import GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates

__all__ = ["StepContacts"]


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
