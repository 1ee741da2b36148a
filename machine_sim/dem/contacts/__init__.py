"""Particles against tool plates: which may touch within a step, the forces, and who got through.

    listing (kept from step to step) -> contacts (of a step, plate by plate) -> forces
    count_tunnelled

Each contact remembers on which side of its plate the particle is. The side changes only around
the plate's edge: a centre pressed through the middle of a plate is still pushed back.
"""
