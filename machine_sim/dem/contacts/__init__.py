"""Contacts of particles: which may touch within a step, and their forces in each substep.

In the order of the algorithm:

- `contact_law`: force and torque of one contact
- `ground_contacts`: contacts with the terrain, listed in each step; `ground_recovery`: recovery of
  particles that sank, and settle timers
- `plate_contact_list`: particles and tool plates that may touch within a step
- `boundary_contacts`: both lists
- `pair_contacts`, `plate_contacts`, `ground_contact_blocks`: contacts copied into blocks for
  vectorised evaluation
- `pair_block`, `plate_block`, `ground_block`: layouts of these blocks; `block_vectors`: access to
  them
- `pair_selection`: which listed pairs may touch within a step
- `simd`: vectorised gather and scatter between particle records and blocks
- `pair_forces`, `plate_forces`, `ground_forces`: forces in each substep
- `step_contacts`: all contacts of a step, for the stages after the substeps
- `tunnelling`: count of particles that passed through a plate

A contact with a plate stores on which side of the plate the particle is. The side changes only
beside the plate: a centre that is pressed through the middle of a plate is still pushed back.
"""

from machine_sim.dem.contacts.contact_law import ContactParameters, contact_parameters
from machine_sim.dem.contacts.ground_contacts import GroundContactList, GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks, PairContacts
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates, PlateContactList
from machine_sim.dem.contacts.plate_contacts import PlateContactBlocks, PlateContacts
from machine_sim.dem.contacts.tunnelling import count_tunnelled

__all__ = [
    "ContactParameters",
    "GroundContactList",
    "GroundContacts",
    "PairContactBlocks",
    "PairContacts",
    "PlateCandidates",
    "PlateContactBlocks",
    "PlateContactList",
    "PlateContacts",
    "contact_parameters",
    "count_tunnelled",
]
