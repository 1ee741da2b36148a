"""Reads the pair of tracks of a machine file."""

from __future__ import annotations

from machine_sim.machine.hydraulic_supply import HydraulicSupply
from machine_sim.machine.spec import TrackSpec
from machine_sim.machine.spec_file.motors import read_travel_motor
from machine_sim.machine.spec_file.section import Section

__all__ = ["read_tracks"]


def read_tracks(section: Section, supply: HydraulicSupply | None) -> TrackSpec:
    """Read `tracks`: dimensions, drive and ground contact of one track.

    Args:
        section: the section `tracks`.
        supply: pump and valves of the machine, for tracks with hydraulic motors.
    """
    tracks = TrackSpec(
        axle_distance=section.number("axle_distance", positive=True),
        sprocket_radius=section.number("sprocket_radius", positive=True),
        shoe_count=section.count("shoe_count", low=12),
        gauge=section.number("gauge", positive=True),
        shoe_width=section.number("shoe_width", positive=True),
        shoe_thickness=section.number("shoe_thickness", positive=True),
        belt_mass=section.number("belt_mass", positive=True),
        max_speed=section.number("max_speed", positive=True),
        max_acceleration=section.number("max_acceleration", positive=True),
        max_deceleration=section.number("max_deceleration", positive=True),
        max_tractive_effort=section.number("max_tractive_effort", positive=True),
        friction=section.number("friction", low=0.0),
        normal_stiffness=section.number("normal_stiffness", positive=True),
        normal_damping=section.number("normal_damping", low=0.0),
        tangential_stiffness=section.number("tangential_stiffness", positive=True),
        tangential_damping=section.number("tangential_damping", low=0.0),
        motor=read_travel_motor(section.section("motor"), supply) if section.has("motor") else None,
    )
    section.reject_unknown_keys()
    return tracks
