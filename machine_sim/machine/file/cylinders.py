"""The cylinders in a machine file, and what feeds them."""

from __future__ import annotations

from machine_sim.machine.errors import MachineError
from machine_sim.machine.file.section import Section
from machine_sim.machine.hydraulics import Cylinder, HydraulicSupply
from machine_sim.machine.linkage import CylinderLinkage, Point, Rocker

__all__ = ["read_cylinder", "read_supply", "strongest"]


def read_cylinder(
    name: str, section: Section, joint: Point, lower: float, upper: float
) -> Cylinder:
    rocker = _rocker(section.section("rocker")) if section.has("rocker") else None
    rod = _point(section, "rod") if section.has("rod") else None
    try:
        linkage = CylinderLinkage(joint, _point(section, "barrel"), rod, rocker, lower, upper)
    except MachineError as error:
        raise MachineError(f"joints.{name}.cylinder: {error}") from error
    cylinder = Cylinder(
        linkage,
        bore=section.number("bore", positive=True),
        rod_diameter=section.number("rod_diameter", positive=True),
        count=section.count("count", low=1),
        spread=section.number("spread", low=0.0),
        cushion=section.number("cushion", positive=True),
    )
    section.done()
    if cylinder.rod_diameter >= cylinder.bore:
        raise MachineError(
            f"joints.{name}.cylinder.rod_diameter is {cylinder.rod_diameter}; give less than the"
            f" bore of {cylinder.bore} m"
        )
    if linkage.longest >= 2.0 * linkage.shortest:
        raise MachineError(
            f"joints.{name}.cylinder grows from {linkage.shortest:.3f} to {linkage.longest:.3f} m,"
            " more than its rod is long; move a pin, or narrow the joint's limits"
        )
    return cylinder


def _rocker(section: Section) -> Rocker:
    rocker = Rocker(
        pin=_point(section, "pin"),
        length=section.number("length", positive=True),
        coupler=section.number("coupler", positive=True),
        ear=_point(section, "ear"),
    )
    section.done()
    return rocker


def _point(section: Section, key: str) -> Point:
    x, z = section.vector(key, 2)
    return x, z


def strongest(cylinder: Cylinder, supply: HydraulicSupply) -> float:
    """Greatest torque within the joint's limits [N m], driven either way."""
    linkage = cylinder.linkage
    step = (linkage.upper - linkage.lower) / 100
    lever = max(abs(linkage.lever(linkage.lower + k * step)) for k in range(101))
    push = cylinder.force_limit(supply.relief_pressure, supply.return_pressure, pushes=True)
    return lever * push


def read_supply(section: Section) -> HydraulicSupply:
    supply = HydraulicSupply(
        relief_pressure=section.number("relief_pressure", positive=True),
        hold_pressure=section.number("hold_pressure", positive=True),
        return_pressure=section.number("return_pressure", low=0.0),
        pump_flow=section.number("pump_flow", positive=True),
        pump_power=section.number("pump_power", positive=True),
    )
    section.done()
    if not supply.return_pressure < supply.relief_pressure <= supply.hold_pressure:
        raise MachineError(
            "hydraulics: give return_pressure below relief_pressure, and hold_pressure no lower"
            " than that"
        )
    return supply
