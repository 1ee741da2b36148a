"""Parameters of soil as particles."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["ParticleParams"]


@dataclass(frozen=True)
class ParticleParams(Parameters):
    """How particles look, touch, and come to rest."""

    mode: str = parameter(
        "spheres",
        "Soil as turning spheres (DEM), or as in the 2014 reference: rigid cubes in pybullet, whose"
        " speed is clamped.",
        choices=("spheres", "cubes"),
    )
    capacity: int = parameter(
        20_000,
        "Most particles alive at once; from half of that on soil is released in larger ones, and"
        " waits when there is no room.",
        low=1,
        high=10_000_000,
    )
    threads: int = parameter(
        1,
        "Cores that one step may use. More pay from some 10 000 particles awake on, where the cores"
        " have nothing else to do. The result is the same to the bit.",
        low=1,
        high=8,
    )
    nominal_volume: int = parameter(
        500_000, "Nominal bank volume of one particle.", unit="mm^3", low=100, high=2**32 - 1
    )
    gravity: float = parameter(9.81, "Gravity, downward.", unit="m/s^2", low=0.0, high=30.0)
    substeps: int = parameter(4, "Contact substeps per physics step.", low=1, high=100)
    substeps_per_contact: float = parameter(
        5.6, "Substeps a free collision lasts: sets the stiffness.", low=5.0, high=50.0
    )
    restitution: float = parameter(
        0.7, "Rebound speed over impact speed of two particles.", low=0.3, high=0.95
    )
    boundary_restitution: float = parameter(
        0.4, "The same at tools and on the terrain.", low=0.3, high=0.95
    )
    ground_friction: float = parameter(
        0.7, "Coulomb friction between particles and the terrain.", low=0.0, high=2.0
    )
    ground_rolling_friction: float = parameter(
        0.4, "Rolling resistance on the terrain, in radii.", low=0.0, high=2.0
    )
    verlet_skin: float = parameter(
        0.15, "Reach of the neighbour list beyond touching, in mean diameters.", low=0.02, high=1.0
    )
    growth_time: float = parameter(
        0.08,
        "Time a released particle takes to full size where it has room.",
        unit="s",
        low=0.0,
        high=2.0,
    )
    release_radius_fraction: float = parameter(
        0.5, "Contact radius of a released particle over its full radius.", low=0.1, high=1.0
    )
    allow_sleeping: bool = parameter(
        True, "Whether particles at rest are left alone until disturbed."
    )
    allow_load_locking: bool = parameter(
        True, "Whether soil at rest in a tool rides in it as one body; needs `sleeping`."
    )
    sleep_speed: float = parameter(
        0.01, "A particle that is slower falls asleep.", unit="m/s", low=0.0, high=1.0
    )
    sleep_time: float = parameter(0.5, "How long it must be slower.", unit="s", low=0.0, high=60.0)
    wake_speed: float = parameter(
        0.05,
        "Soil that rides in a tool wakes where one that touches it is faster, seen from it.",
        unit="m/s",
        low=0.0,
        high=5.0,
    )
    wake_gravity_change: float = parameter(
        0.1,
        "Soil in a tool wakes when the gravity it feels has changed by this part since it came"
        " to rest; 0.1 is a tilt of 6 degrees.",
        low=0.0,
        high=2.0,
    )
    settle_speed: float = parameter(
        0.3, "A particle on the ground that is slower comes to rest.", unit="m/s", low=0.0, high=2.0
    )
    settle_time: float = parameter(
        0.05, "How long it must be slower before it lands.", unit="s", low=0.0, high=10.0
    )
    tool_clearance: float = parameter(
        0.05, "A particle closer to a tool plate does not land.", unit="m", low=0.0, high=2.0
    )
