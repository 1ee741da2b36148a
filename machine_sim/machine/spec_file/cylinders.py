"""Reads the hydraulic cylinders of a machine file and their supply."""

from __future__ import annotations

from machine_sim.machine.cylinder_linkage import CylinderLinkage, Point, Rocker
from machine_sim.machine.errors import MachineError
from machine_sim.machine.hydraulic_cylinder import Cylinder
from machine_sim.machine.hydraulic_supply import HydraulicSupply
from machine_sim.machine.spec_file.section import Section

__all__ = ["max_joint_torque", "read_cylinder", "read_supply"]


def read_cylinder(
    name: str,
    section: Section,
    joint: Point,
    lower: float,
    upper: float,
    supply: HydraulicSupply,
) -> Cylinder:
    """Read the cylinders of one joint.

    Args:
        name: name of the joint, for messages.
        section: the section `cylinder` of the joint.
        joint: pin of the joint in the frame of the barrel's link, x and z [m].
        lower, upper: angle limits of the joint [rad].
        supply: pump and valves of the machine.
    """
    rocker = _read_rocker(section.section("rocker")) if section.has("rocker") else None
    rod = _read_point(section, "rod") if section.has("rod") else None
    try:
        linkage = CylinderLinkage(joint, _read_point(section, "barrel"), rod, rocker, lower, upper)
    except MachineError as error:
        raise MachineError(f"joints.{name}.cylinder: {error}") from error
    cylinder = Cylinder(
        linkage,
        bore=section.number("bore", positive=True),
        rod_diameter=section.number("rod_diameter", positive=True),
        count=section.count("count", low=1),
        spread=section.number("spread", low=0.0),
        cushion_length=section.number("cushion_length", positive=True),
        max_flow=section.number("max_flow", positive=True)
        if section.has("max_flow")
        else supply.pump_flow,
    )
    section.reject_unknown_keys()
    if cylinder.rod_diameter >= cylinder.bore:
        raise MachineError(
            f"joints.{name}.cylinder.rod_diameter is {cylinder.rod_diameter} m; give less than the"
            f" bore, {cylinder.bore} m"
        )
    if linkage.max_length >= 2.0 * linkage.min_length:
        raise MachineError(
            f"joints.{name}.cylinder extends from {linkage.min_length:.3f} to"
            f" {linkage.max_length:.3f} m, which is more than its rod allows; move a pin, or narrow"
            " the joint's limits"
        )
    return cylinder


def _read_rocker(section: Section) -> Rocker:
    rocker = Rocker(
        pin=_read_point(section, "pin"),
        length=section.number("length", positive=True),
        coupler_length=section.number("coupler_length", positive=True),
        coupler_pin=_read_point(section, "coupler_pin"),
    )
    section.reject_unknown_keys()
    return rocker


def _read_point(section: Section, key: str) -> Point:
    x, z = section.vector(key, 2)
    return x, z


def max_joint_torque(cylinder: Cylinder, supply: HydraulicSupply) -> float:
    """Return the maximum torque over the joint's range [N m], at the main relief pressure."""
    linkage = cylinder.linkage
    step = (linkage.upper - linkage.lower) / 100
    lever_arm = max(abs(linkage.lever_arm(linkage.lower + k * step)) for k in range(101))
    force = cylinder.force_limit(
        supply.main_relief_pressure, supply.return_pressure, is_extending=True
    )
    return lever_arm * force


def read_supply(section: Section) -> HydraulicSupply:
    """Read `hydraulics`: engine, pumps and valves."""
    supply = HydraulicSupply(
        main_relief_pressure=section.number("main_relief_pressure", positive=True),
        port_relief_pressure=section.number("port_relief_pressure", positive=True),
        return_pressure=section.number("return_pressure", low=0.0),
        pump_flow=section.number("pump_flow", positive=True),
        pump_power=section.number("pump_power", positive=True),
        engine_power=section.number("engine_power", positive=True),
        engine_droop=section.fraction("engine_droop"),
        engine_response_time=section.number("engine_response_time", positive=True),
        valve_dead_band=section.fraction("valve_dead_band"),
        valve_delay=section.number("valve_delay", low=0.0),
        valve_opening_time=section.number("valve_opening_time", positive=True),
    )
    section.reject_unknown_keys()
    if not supply.return_pressure < supply.main_relief_pressure <= supply.port_relief_pressure:
        raise MachineError(
            f"hydraulics: return_pressure {supply.return_pressure:g}, main_relief_pressure"
            f" {supply.main_relief_pressure:g} and port_relief_pressure"
            f" {supply.port_relief_pressure:g} Pa are not in ascending order; give them so"
        )
    return supply
