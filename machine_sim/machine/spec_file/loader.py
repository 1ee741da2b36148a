"""Reads a machine file and checks its sections against each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import yaml

from machine_sim.machine.cylinder_visuals import cylinder_parts
from machine_sim.machine.errors import MachineError
from machine_sim.machine.shapes.machine_shapes import MachineShapes
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.spec_file.cylinders import read_supply
from machine_sim.machine.spec_file.joints import (
    read_home,
    read_joints,
    read_joystick_axes,
    read_main_body,
)
from machine_sim.machine.spec_file.links import read_imus, read_links
from machine_sim.machine.spec_file.references import read_references
from machine_sim.machine.spec_file.section import Section
from machine_sim.machine.spec_file.shapes import read_shapes
from machine_sim.machine.spec_file.tools import read_tools
from machine_sim.machine.spec_file.tracks import read_tracks
from machine_sim.machine.track_wheels import track_wheels
from machine_sim.machine.urdf import BASE_JOINTS
from msg_bridge.config_files import ConfigError, find_config
from msg_bridge.yaml_text import load_yaml

__all__ = ["find_shapes_file", "load_machine_spec"]

_TRACK_COMMAND_NAMES = ("left_track", "right_track")


def load_machine_spec(path: str | Path) -> MachineSpec:
    """Read a machine file, and the file of shapes that it names.

    Files of the same content give the same object in one process: meshes and descriptions made
    from it are made once.

    Raises:
        MachineError: a file cannot be read, or a key is missing, unknown or out of range.
    """
    path = Path(path)
    text = _read_text(path, "a machine file")
    shapes_file = _find_shapes_file(_parse(path, text), path)
    shapes = _read_text(shapes_file, "a file of shapes") if shapes_file else None
    return _build_spec(path.name, text, shapes_file, shapes)


def find_shapes_file(path: str | Path) -> Path | None:
    """Return the file of shapes that a machine file names; None if it contains its shapes, or has
    none.

    Raises:
        MachineError: a file is missing, or cannot be read.
    """
    path = Path(path)
    return _find_shapes_file(_parse(path, _read_text(path, "a machine file")), path)


def _read_text(path: Path, what: str) -> str:
    """Return the text of a file.

    Raises:
        MachineError: the file cannot be read; the message asks for `what`.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MachineError(f"{path} cannot be read: {error}; give {what}") from error


def _parse(path: Path, text: str) -> Section:
    """Return the contents of a file.

    Raises:
        MachineError: the text is no YAML, or no mapping.
    """
    try:
        values = load_yaml(text)
    except yaml.YAMLError as error:
        raise MachineError(f"{path} cannot be read as YAML: {error}") from error
    with _name_file(path.name):
        return Section(values, "")


@contextmanager
def _name_file(name: str) -> Iterator[None]:
    """Prefix errors of the block with the name of the file that they are about."""
    try:
        yield
    except MachineError as error:
        raise MachineError(f"{name}: {error}") from error


def _find_shapes_file(file: Section, machine_file: Path) -> Path | None:
    """Return the file that the section `shapes` names; None if it is a mapping, or missing.

    The file is searched beside the machine file, then as `find_config` searches.

    Raises:
        MachineError: there is no such file.
    """
    if not (file.has("shapes") and file.is_text("shapes")):
        return None
    with _name_file(machine_file.name):
        name = file.text("shapes")
        path = machine_file.parent / name
        if not path.is_file():
            try:
                path = find_config(name)
            except ConfigError as error:
                raise MachineError(f"shapes: {error}") from error
    return path


@lru_cache(maxsize=16)
def _build_spec(name: str, text: str, shapes_file: Path | None, shapes: str | None) -> MachineSpec:
    """Build the specification from the text of a machine file, and from that of its shapes.

    Args:
        name: name of the machine file, for messages.
        text: its text.
        shapes_file: the file of shapes, for messages; None if the machine file contains them.
        shapes: its text.
    """
    file = _parse(Path(name), text)
    with _name_file(name):
        spec = _read_machine(file)
    if shapes_file is not None:
        section = _parse(shapes_file, shapes or "")
        with _name_file(shapes_file.name):
            spec = replace(spec, shapes=read_shapes(section, spec.links))
    with _name_file(name):
        _check_unique_names(spec)
    return spec


def _read_machine(file: Section) -> MachineSpec:
    """Return the specification in a machine file, without the shapes of another file."""
    supply = read_supply(file.section("hydraulics")) if file.has("hydraulics") else None
    joints, cylinders, motors = read_joints(file.section("joints"), supply)
    links = read_links(file.section("links"), joints)
    has_shapes = file.has("shapes") and not file.is_text("shapes")
    spec = MachineSpec(
        name=file.text("name"),
        links=links,
        joints=joints,
        cylinders=cylinders,
        motors=motors,
        supply=supply,
        home=read_home(file.section("home"), joints),
        tracks=read_tracks(file.section("tracks"), supply),
        main_body=read_main_body(file, joints),
        tools=read_tools(file.section("tools"), joints),
        joystick_axes=read_joystick_axes(file.section("joystick_axes"), joints)
        if file.has("joystick_axes")
        else {},
        imus=read_imus(file.section("imus"), links) if file.has("imus") else (),
        shapes=read_shapes(file.section("shapes"), links) if has_shapes else MachineShapes(),
        references=read_references(file.sections("references")) if file.has("references") else (),
    )
    file.reject_unknown_keys()
    return spec


def _check_unique_names(spec: MachineSpec) -> None:
    """Check that no joint or link has the name of a track, a base joint or a cylinder part.

    Raises:
        MachineError: a name is already in use.
    """
    parts = cylinder_parts(spec)
    reserved_joints = {*_TRACK_COMMAND_NAMES, *BASE_JOINTS, *(part.joint for part in parts)}
    reserved_links = {"map", "base_link", *(f"{name}_link" for name in BASE_JOINTS)}
    reserved_links |= {part.link for part in parts}
    reserved_joints |= {wheel.joint for wheel in track_wheels(spec)}
    reserved_links |= {wheel.link for wheel in track_wheels(spec)}
    frames = [view.name for view in spec.shapes.view_points]
    taken = [
        *sorted(reserved_joints.intersection(spec.joints)),
        *sorted(reserved_links.intersection([*spec.links, *frames])),
        *sorted(set(spec.links).intersection(frames)),
    ]
    if taken:
        raise MachineError(
            f"joint, link or view point name {', '.join(taken)} is reserved for the base, the"
            " tracks or the parts of a cylinder, or is that of a link; choose another name"
        )
