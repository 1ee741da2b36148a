"""A machine as triangles in the map frame, for pictures: its links and track shoes."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from earthmoving_sim.coloured_mesh import ColouredMesh, merge_meshes
from machine_sim.machine import MachineSpec
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.rotations import quaternion_from_matrix, rotation_matrix
from machine_sim.machine.shapes.link_meshes import LinkMesh, link_meshes, shoe_mesh

__all__ = ["machine_mesh"]

Array = NDArray[np.float64]


def machine_mesh(
    machine: MachineSpec,
    position: ArrayLike,
    rotation: Array,
    joints: ArrayLike,
    shoes: Array | None = None,
) -> ColouredMesh:
    """Return the triangles of a machine in a pose; each link and each shoe is one part.

    Glass is opaque.

    Args:
        machine: the machine.
        position: position of base_link [m], map frame, shape (3,).
        rotation: rotation from base_link to map, shape (3, 3).
        joints: angles of its joints [rad].
        shoes: x, z [m] and pitch [rad] of the track shoes in the base frame, shape (2, n, 3),
            left track first; None draws no shoes.
    """
    poses = link_poses(machine, position, quaternion_from_matrix(rotation), joints)
    frames = {
        name: (rotation_matrix(quaternion), origin)
        for name, origin, quaternion in zip(link_frame_names(machine), *poses, strict=True)
    }
    links, shoe = _local_meshes(machine)
    placed = [_placed(mesh, *frames[name], part) for part, (name, mesh) in enumerate(links, 1)]
    if shoes is not None:
        turn, origin = frames["base_link"]
        for side, y in ((0, 0.5 * machine.tracks.gauge), (1, -0.5 * machine.tracks.gauge)):
            for x, z, pitch in shoes[side]:
                at = turn @ np.array([x, y, z]) + origin
                placed.append(_placed(shoe, turn @ _about_y(pitch), at, len(placed) + 1))
    return merge_meshes(*placed)


@lru_cache(maxsize=8)
def _local_meshes(machine: MachineSpec) -> tuple[list[tuple[str, ColouredMesh]], ColouredMesh]:
    """Return the mesh of each link with shapes, by frame name, and that of a shoe, own frames."""
    links = [(name, _coloured(mesh)) for name, mesh in link_meshes(machine).items() if mesh]
    return links, _coloured(shoe_mesh(machine))


def _coloured(mesh: LinkMesh) -> ColouredMesh:
    return merge_meshes(
        *(
            ColouredMesh(
                group.mesh.points,
                group.mesh.normals,
                np.tile(group.material.color, (len(group.mesh.points), 1)),
                group.mesh.triangles.astype(np.intp),
                np.zeros(len(group.mesh.triangles), dtype=np.intp),
            )
            for group in mesh
        )
    )


def _placed(mesh: ColouredMesh, turn: Array, origin: Array, part: int) -> ColouredMesh:
    """Return a mesh rotated, then translated, as part `part` of a picture."""
    return ColouredMesh(
        mesh.points @ turn.T + origin,
        mesh.normals @ turn.T,
        mesh.colours,
        mesh.triangles,
        np.full(len(mesh.triangles), part, dtype=np.intp),
    )


def _about_y(angle: float) -> Array:
    s, c = math.sin(angle), math.cos(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
