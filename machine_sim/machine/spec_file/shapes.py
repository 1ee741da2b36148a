"""Reads the visual shapes of a machine: a section of the machine file, or a file of their own."""

from __future__ import annotations

from collections.abc import Mapping

from machine_sim.machine.errors import MachineError
from machine_sim.machine.shapes.machine_shapes import MachineShapes, ViewPoint
from machine_sim.machine.shapes.materials import MATERIALS, Material
from machine_sim.machine.shapes.shape import SHAPE_KINDS, PlacedShape
from machine_sim.machine.spec import LinkSpec
from machine_sim.machine.spec_file.section import Section
from msg_bridge.contract.suggestions import suggestion

__all__ = ["read_shapes"]


def read_shapes(section: Section, links: Mapping[str, LinkSpec]) -> MachineShapes:
    """Read `materials`, `links` and `view_points`.

    Args:
        section: the shapes.
        links: links of the machine.

    Raises:
        MachineError: an unknown link, kind or material, or a value out of range.
    """
    materials = _read_materials(section.section("materials")) if section.has("materials") else {}
    shapes = {}
    if section.has("links"):
        of_links = section.section("links")
        for name in of_links.names():
            if name not in links:
                raise MachineError(
                    f"{of_links.key_path(name)} is not a link{suggestion(name, links)}; give one of"
                    f" {', '.join(links)}"
                )
            known = {*MATERIALS, *materials}
            shapes[name] = tuple(_read_shape(entry, known) for entry in of_links.sections(name))
    views: tuple[ViewPoint, ...] = ()
    if section.has("view_points"):
        views = _read_view_points(section.section("view_points"), links)
    section.reject_unknown_keys()
    return MachineShapes(shapes, materials, views)


def _read_materials(section: Section) -> dict[str, Material]:
    materials = {}
    for name in section.names():
        entry = section.section(name)
        default = MATERIALS.get(name, Material((1.0, 1.0, 1.0)))
        values = {
            key: entry.fraction(key) if entry.has(key) else getattr(default, key)
            for key in ("metallic", "roughness", "alpha", "emission")
        }
        color = entry.vec3("color") if entry.has("color") else default.color
        materials[name] = Material(color, **values)
        entry.reject_unknown_keys()
    return materials


def _read_shape(section: Section, materials: set[str]) -> PlacedShape:
    kind, material = section.text("kind"), section.text("material")
    if kind not in SHAPE_KINDS:
        raise MachineError(
            f"{section.key_path('kind')} is {kind!r}{suggestion(kind, SHAPE_KINDS)}; give one of"
            f" {', '.join(SHAPE_KINDS)}"
        )
    if material not in materials:
        raise MachineError(
            f"{section.key_path('material')} is {material!r}{suggestion(material, materials)};"
            f" give one of {', '.join(sorted(materials))}, or add it to materials"
        )
    shape = SHAPE_KINDS[kind].from_section(section)
    count, step = 1, (0.0, 0.0, 0.0)
    if section.has("repeat"):
        row = section.section("repeat")
        count, step = row.count("count", low=1), row.vec3("step")
        row.reject_unknown_keys()
    mirror = section.flag("mirror") if section.has("mirror") else False
    section.reject_unknown_keys()
    return PlacedShape(shape, material, mirror, count, step)


def _read_view_points(section: Section, links: Mapping[str, LinkSpec]) -> tuple[ViewPoint, ...]:
    views: list[ViewPoint] = []
    for name in section.names():
        view = section.section(name)
        link = view.text("link")
        if link not in links:
            raise MachineError(
                f"{view.key_path('link')} is {link!r}{suggestion(link, links)}; give one of"
                f" {', '.join(links)}"
            )
        rpy = view.vec3("rpy") if view.has("rpy") else (0.0, 0.0, 0.0)
        point = ViewPoint(name, link, view.vec3("position"), rpy)
        views += [point, point.optical_frame()] if point.is_camera else [point]
        view.reject_unknown_keys()
    return tuple(views)
