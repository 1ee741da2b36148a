"""Parameters of soil as particles."""

from __future__ import annotations

from dataclasses import dataclass

from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["ParticleParams"]


@dataclass(frozen=True)
class ParticleParams(Parameters):
    """Size, contacts, sleep and settling of particles."""

    mode: str = parameter(
        "spheres",
        "Soil as spheres with rotation (DEM), or as in the 2014 reference: rigid cubes in pybullet"
        " with velocity clamps.",
        choices=("spheres", "cubes"),
    )
    capacity: int = parameter(
        20_000,
        "Maximum number of particles. Above half of it soil is released in larger particles; when"
        " it is reached, soil waits.",
        low=1,
        high=10_000_000,
    )
    threads: int = parameter(
        1,
        "Maximum number of threads in a step. More than one is faster from some 10 000 moving"
        " particles on, on idle cores. The result is bit-identical.",
        low=1,
        high=8,
    )
    nominal_volume: int = parameter(
        1_000_000, "Nominal bank volume of a particle.", unit="mm^3", low=100, high=2**32 - 1
    )
    gravity: float = parameter(GRAVITY, "Gravity, downward.", unit="m/s^2", low=0.0, high=30.0)
    substeps: int = parameter(
        4,
        "Contact substeps per physics step, at most `substeps_per_contact`: contacts are listed"
        " once in a step.",
        low=1,
        high=50,
    )
    substeps_per_contact: float = parameter(
        5.6, "Duration of a free collision in substeps; sets the stiffness.", low=5.0, high=50.0
    )
    restitution: float = parameter(
        0.7,
        "Rebound speed over impact speed of two particles, in the mean of normal impacts; a single"
        " one deviates by up to 0.05 (at 0.4: 0.1) with its phase in the substep.",
        low=0.3,
        high=0.95,
    )
    boundary_restitution: float = parameter(
        0.4,
        "Rebound speed over impact speed at tools and on the terrain; a single impact deviates by"
        " up to 0.12 with its phase in the substep.",
        low=0.3,
        high=0.95,
    )
    ground_friction: float = parameter(
        0.7, "Coulomb friction between particles and the terrain.", low=0.0, high=2.0
    )
    ground_rolling_friction: float = parameter(
        0.4, "Rolling friction between particles and the terrain, in radii.", low=0.0, high=2.0
    )
    verlet_skin: float = parameter(
        0.15,
        "Skin of the neighbour list of a particle at rest, in mean diameters.",
        low=0.02,
        high=1.0,
    )
    growth_time: float = parameter(
        0.08,
        "Time in which a released particle grows to full size where it has room.",
        unit="s",
        low=0.0,
        high=2.0,
    )
    release_radius_fraction: float = parameter(
        0.5, "Contact radius of a released particle over its full radius.", low=0.1, high=1.0
    )
    allow_sleeping: bool = parameter(
        True, "Whether particles at rest sleep, without integration, until they are disturbed."
    )
    allow_load_locking: bool = parameter(
        True,
        "Whether soil at rest in a tool moves with the tool as one body; needs `allow_sleeping`.",
    )
    sleep_speed: float = parameter(
        0.01, "Speed below which a particle falls asleep.", unit="m/s", low=0.0, high=1.0
    )
    sleep_time: float = parameter(
        0.5,
        "Time below `sleep_speed` after which a particle falls asleep.",
        unit="s",
        low=0.0,
        high=60.0,
    )
    wake_speed: float = parameter(
        0.05,
        "Relative speed of a particle that wakes the locked soil it touches in a tool.",
        unit="m/s",
        low=0.0,
        high=5.0,
    )
    wake_gravity_change: float = parameter(
        0.1,
        "Change of the apparent gravity in a tool, over gravity, that wakes its locked soil; 0.1 is"
        " a tilt of 6 degrees.",
        low=0.0,
        high=2.0,
    )
    settle_speed: float = parameter(
        0.3,
        "Speed below which a particle on the ground is at rest.",
        unit="m/s",
        low=0.0,
        high=2.0,
    )
    settle_time: float = parameter(
        0.05,
        "Time below `settle_speed` on the ground after which a particle is settled.",
        unit="s",
        low=0.0,
        high=10.0,
    )
    tool_clearance: float = parameter(
        0.05,
        "Minimum distance of a settled particle from tool plates.",
        unit="m",
        low=0.0,
        high=2.0,
    )

    def __post_init__(self) -> None:
        """Validate the parameters.

        Raises:
            ParameterError: more substeps than a collision lasts: particles that bounce within a
                step would meet others that are not listed as their contacts.
        """
        super().__post_init__()
        if self.substeps > self.substeps_per_contact:
            raise ParameterError(
                f"substeps is {self.substeps}, more than substeps_per_contact,"
                f" {self.substeps_per_contact:g}; increase substeps_per_contact as well"
            )
