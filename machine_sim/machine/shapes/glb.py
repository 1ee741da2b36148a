"""Meshes as binary glTF 2.0 (GLB) with materials of the metallic-roughness model.

The file has one node with one mesh, whose primitives are the material groups. Indices have 16 bits
where they suffice: the description of a machine contains its meshes as text.
"""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.shapes.link_meshes import LinkMesh, MaterialGroup
from machine_sim.machine.shapes.materials import Material

__all__ = ["glb_bytes", "glb_data_uri"]

_Y_UP = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
"""Quaternion x, y, z, w from a frame with z up, as in ROS, to one with y up, as in glTF."""

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125
"""Component types of accessors, glTF 2.0, section 3.6.2.2."""
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_MAX_UINT16_VERTICES = 65535

_MAGIC, _VERSION, _JSON, _BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
"""Header and chunk types of a GLB, glTF 2.0, section 4.4."""


class _Buffer:
    """The binary chunk, with its views and accessors."""

    def __init__(self) -> None:
        self.data = b""
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: NDArray[Any], component: int, kind: str, target: int) -> int:
        """Append an array and return the index of its accessor."""
        data = array.tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append({**view, "target": target})
        self.data += data + b"\0" * (-len(data) % 4)
        count = array.size if kind == "SCALAR" else len(array)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": component,
            "count": count,
            "type": kind,
        }
        if kind == "VEC3":
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def glb_bytes(mesh: LinkMesh) -> bytes:
    """Return a mesh as GLB; the node turns the link's axes to those with y up.

    A program that shows glTF in a frame with z up rotates the scene by +90 degrees about x, which
    undoes the rotation of the node.
    """
    buffer = _Buffer()
    primitives = [_primitive(group, number, buffer) for number, group in enumerate(mesh)]
    document = {
        "asset": {"version": "2.0", "generator": "earthmoving_sim"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [float(part) for part in _Y_UP]}],
        "meshes": [{"primitives": primitives}],
        "materials": [_material(group.name, group.material) for group in mesh],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    chunks = _chunk(_JSON, text + b" " * (-len(text) % 4)) + _chunk(_BIN, buffer.data)
    return struct.pack("<III", _MAGIC, _VERSION, 12 + len(chunks)) + chunks


def glb_data_uri(mesh: LinkMesh) -> str:
    """Return a mesh as data URI of a GLB."""
    return "data:model/gltf-binary;base64," + base64.b64encode(glb_bytes(mesh)).decode("ascii")


def _primitive(group: MaterialGroup, material: int, buffer: _Buffer) -> dict[str, Any]:
    mesh = group.mesh
    is_small = len(mesh.points) <= _MAX_UINT16_VERTICES
    component, dtype = (_UINT16, "<u2") if is_small else (_UINT32, "<u4")
    position = buffer.add(mesh.points.astype("<f4"), _FLOAT, "VEC3", _ARRAY_BUFFER)
    normal = buffer.add(mesh.normals.astype("<f4"), _FLOAT, "VEC3", _ARRAY_BUFFER)
    indices = mesh.triangles.astype(dtype)
    return {
        "attributes": {"POSITION": position, "NORMAL": normal},
        "indices": buffer.add(indices, component, "SCALAR", _ELEMENT_ARRAY_BUFFER),
        "material": material,
    }


def _material(name: str, material: Material) -> dict[str, Any]:
    color = [_linear(channel) for channel in material.color]
    return {
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [*color, material.alpha],
            "metallicFactor": material.metallic,
            "roughnessFactor": material.roughness,
        },
        "emissiveFactor": [material.emission * channel for channel in color],
        "alphaMode": "BLEND" if material.alpha < 1.0 else "OPAQUE",
    }


def _chunk(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", len(data), kind) + data


def _linear(channel: float) -> float:
    """Return an sRGB channel as linear light, which glTF's factors are."""
    return channel / 12.92 if channel <= 0.04045 else float(((channel + 0.055) / 1.055) ** 2.4)
