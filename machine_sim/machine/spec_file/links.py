"""Reads the links and the inertial measurement units of a machine file."""

from __future__ import annotations

from collections.abc import Mapping

from machine_sim.machine.box import Box
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import BASE, ImuMount, Joint, LinkSpec
from machine_sim.machine.spec_file.section import Section

__all__ = ["read_imus", "read_links"]


def read_links(section: Section, joints: Mapping[str, Joint]) -> dict[str, LinkSpec]:
    """Read `links`: the base, then the children of the joints, in the joints' order."""
    names = [BASE, *(joint.child for joint in joints.values())]
    links = {name: _read_link(section.section(name)) for name in names}
    section.reject_unknown_keys()
    return links


def read_imus(section: Section, links: Mapping[str, LinkSpec]) -> tuple[ImuMount, ...]:
    """Read `imus`: link and position of each unit, by name."""
    mounts = []
    for name in section.names():
        mount = section.section(name)
        link = mount.text("link")
        if link not in links:
            raise MachineError(f"imus.{name}.link is {link!r}; give one of {', '.join(links)}")
        mounts.append(ImuMount(name, link, mount.vec3("position")))
        mount.reject_unknown_keys()
    return tuple(mounts)


def _read_link(section: Section) -> LinkSpec:
    link = LinkSpec(
        mass=section.number("mass", positive=True),
        center_of_mass=section.vec3("center_of_mass"),
        inertia_box=section.vec3("inertia_box", positive=True),
        boxes=tuple(_read_box(box) for box in section.sections("boxes")),
        color=section.vec3("color"),
    )
    section.reject_unknown_keys()
    return link


def _read_box(section: Section) -> Box:
    size = section.vec3("size", positive=True)
    box = Box(size, section.vec3("center"), section.number("pitch"))
    section.reject_unknown_keys()
    return box
