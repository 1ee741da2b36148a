"""Read the URDF that a machine publishes.

Beside plain URDF, a mesh may be a data URI with binary glTF, and an element `<earthmoving>` has
what URDF cannot express: crawler tracks, the rated power of the engine and the relief pressures.
What is not known is left out, so that the page shows the rest.
"""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Iterator
from xml.etree import ElementTree

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode
from viewer.scene.machine_model import (
    HydraulicsModel,
    JointModel,
    MachineModel,
    Mimic,
    Origin,
    TrackModel,
    Vector,
    Visual,
)

__all__ = ["MAX_URDF_LENGTH", "parse_urdf"]

MAX_URDF_LENGTH = 64 * 2**20
"""Maximum length of a URDF [characters]."""

_MAX_ELEMENTS = 20_000

_GLB_PREFIXES = ("data:model/gltf-binary;base64,", "data:application/octet-stream;base64,")
_JOINT_TYPES = ("fixed", "revolute", "continuous", "prismatic")
_DEFAULT_COLOR = (0.6, 0.6, 0.6, 1.0)
_SHOE_COLOR = (0.2, 0.2, 0.2, 1.0)

Color = tuple[float, float, float, float]


def parse_urdf(text: str) -> MachineModel:
    """Return the machine that a URDF describes.

    Raises:
        CodecError: VALUE: it is no URDF, too large, or a number is missing or not finite.
    """
    if len(text) > MAX_URDF_LENGTH:
        raise _error(f"it has {len(text)} characters; give at most {MAX_URDF_LENGTH}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise _error("it declares entities; give plain XML")
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise _error(str(error)) from None
    if robot.tag != "robot" or sum(1 for _ in robot.iter()) > _MAX_ELEMENTS:
        raise _error(f"give one element <robot> with at most {_MAX_ELEMENTS} elements")
    try:
        return _machine(robot)
    except (ValueError, KeyError) as error:
        raise _error(repr(error)) from None


def _machine(robot: ElementTree.Element) -> MachineModel:
    materials = {
        str(each.get("name")): color
        for each in robot.iter("material")
        if (color := _color_element(each)) is not None
    }
    extension = robot.find("earthmoving")
    tracks: tuple[TrackModel, ...] = ()
    rated_power, hydraulics, shoe = None, None, None
    if extension is not None:
        tracks = tuple(_track(each) for each in extension.findall("track"))
        engine = extension.find("engine")
        if engine is not None and engine.get("rated_power"):
            rated_power = _number(engine.attrib["rated_power"])
        hydraulics = _hydraulics(extension.find("hydraulics"))
        mesh = extension.find("shoe/mesh")
        shoe = None if mesh is None else _glb(mesh.get("filename", ""))
    return MachineModel(
        name=robot.get("name", "machine"),
        links={
            each.attrib["name"]: tuple(_visuals(each, materials)) for each in robot.findall("link")
        },
        joints=tuple(_joint(each) for each in robot.findall("joint")),
        tracks=tracks,
        rated_power=rated_power,
        hydraulics=hydraulics,
        shoe=shoe,
    )


def _visuals(link: ElementTree.Element, materials: dict[str, Color]) -> Iterator[Visual]:
    for element in link.findall("visual"):
        geometry = element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            continue
        origin, color = _origin(element), _color(element, materials)
        if shape.tag == "box":
            yield Visual("box", origin, color, size=_vector(shape.attrib["size"]))
        elif shape.tag == "cylinder":
            radius, length = _number(shape.attrib["radius"]), _number(shape.attrib["length"])
            yield Visual("cylinder", origin, color, radius=radius, length=length)
        elif shape.tag == "sphere":
            yield Visual("sphere", origin, color, radius=_number(shape.attrib["radius"]))
        elif shape.tag == "mesh":
            glb = _glb(shape.get("filename", ""))
            if glb is not None:
                scale = _vector(shape.attrib["scale"]) if "scale" in shape.attrib else None
                yield Visual("mesh", origin, color, glb=glb, scale=scale)


def _glb(name: str) -> bytes | None:
    """Return the binary glTF in a data URI; None for another file."""
    for prefix in _GLB_PREFIXES:
        if name.startswith(prefix):
            try:
                return base64.b64decode(name[len(prefix) :], validate=True)
            except binascii.Error as error:
                raise ValueError(f"a mesh is no base64: {error}") from None
    return None


def _joint(element: ElementTree.Element) -> JointModel:
    kind = element.attrib["type"]
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ValueError(f"the joint {element.get('name')} lacks its parent or child")
    axis, limit, mimic = element.find("axis"), element.find("limit"), element.find("mimic")
    lower, upper = (
        None if limit is None or limit.get(name) is None else _number(limit.attrib[name])
        for name in ("lower", "upper")
    )
    return JointModel(
        name=element.attrib["name"],
        type=kind if kind in _JOINT_TYPES else "fixed",
        parent=parent.attrib["link"],
        child=child.attrib["link"],
        origin=_origin(element),
        axis=(1.0, 0.0, 0.0) if axis is None else _vector(axis.attrib["xyz"]),
        lower=lower,
        upper=upper,
        mimic=None
        if mimic is None
        else Mimic(
            mimic.attrib["joint"],
            _number(mimic.get("multiplier", "1")),
            _number(mimic.get("offset", "0")),
        ),
    )


def _track(element: ElementTree.Element) -> TrackModel:
    values = element.attrib
    return TrackModel(
        joint=values["joint"],
        link=values["link"],
        y=_number(values["y"]),
        x_front=_number(values["x_front"]) if "x_front" in values else None,
        axle_distance=_number(values["axle_distance"]),
        axle_height=_number(values["axle_height"]) if "axle_height" in values else None,
        radius=_number(values["radius"]),
        shoe_count=int(values["shoe_count"]),
        shoe_size=_vector(values["shoe_size"]),
        color=_rgba(values["color"]) if "color" in values else _SHOE_COLOR,
    )


def _hydraulics(element: ElementTree.Element | None) -> HydraulicsModel | None:
    if element is None:
        return None
    main, port = (
        _number(element.attrib[name]) for name in ("main_relief_pressure", "port_relief_pressure")
    )
    if min(main, port) <= 0.0:
        raise ValueError("a relief pressure is not positive")
    return HydraulicsModel(main, port)


def _origin(element: ElementTree.Element) -> Origin:
    origin = element.find("origin")
    if origin is None:
        return Origin()
    return Origin(_vector(origin.get("xyz", "0 0 0")), _vector(origin.get("rpy", "0 0 0")))


def _color(visual: ElementTree.Element, materials: dict[str, Color]) -> Color:
    material = visual.find("material")
    if material is None:
        return _DEFAULT_COLOR
    own = _color_element(material)
    return own or materials.get(str(material.get("name")), _DEFAULT_COLOR)


def _color_element(material: ElementTree.Element) -> Color | None:
    color = material.find("color")
    return None if color is None else _rgba(color.attrib["rgba"])


def _rgba(text: str) -> Color:
    values = [_number(word) for word in text.split()]
    if len(values) == 3:
        values.append(1.0)
    red, green, blue, opacity = values
    return red, green, blue, opacity


def _vector(text: str) -> Vector:
    x, y, z = (_number(word) for word in text.split())
    return x, y, z


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not finite")
    return value


def _error(reason: str) -> CodecError:
    return CodecError(f"the robot description cannot be read: {reason[:300]}", ErrorCode.VALUE)
