"""Particles against particles: who is near whom, who may touch, and the forces.

    cells -> listing -> neighbours (the pair list, kept by relisting) -> contacts -> forces

`skins` is how far a list looks ahead; `dormant` keeps what friction remembers of pairs at rest.
"""
