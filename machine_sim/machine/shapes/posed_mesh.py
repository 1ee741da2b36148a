"""The whole machine in a pose as one mesh, to be written as a file."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.rotations import rotation_matrix
from machine_sim.machine.shapes.link_meshes import (
    LinkMesh,
    MaterialGroup,
    link_meshes,
    shoe_mesh,
)
from machine_sim.machine.shapes.materials import Material
from machine_sim.machine.shapes.shape import rotation_from_rpy
from machine_sim.machine.shapes.triangle_mesh import ShadedMesh, merge_shaded
from machine_sim.machine.spec import MachineSpec

__all__ = ["posed_mesh"]

Array = NDArray[np.float64]


def posed_mesh(spec: MachineSpec, shoes: Array) -> LinkMesh:
    """Return all links and shoes in the frame of the base, with the initial joint angles.

    Args:
        spec: specification of the machine.
        shoes: x, z [m] and pitch [rad] of the track shoes in the base frame, shape (2, n, 3).
    """
    groups: dict[tuple[str, Material], list[ShadedMesh]] = defaultdict(list)

    def place(mesh: LinkMesh, turn: Array, origin: Array) -> None:
        for name, material, part in mesh:
            groups[name, material].append(
                ShadedMesh(part.points @ turn.T + origin, part.normals @ turn.T, part.triangles)
            )

    poses = link_poses(spec, np.zeros(3), [0.0, 0.0, 0.0, 1.0], spec.home)
    meshes = link_meshes(spec)
    for name, origin, quaternion in zip(link_frame_names(spec), *poses, strict=True):
        place(meshes.get(name, ()), rotation_matrix(quaternion), origin)
    shoe = shoe_mesh(spec)
    for side, y in ((0, 0.5 * spec.tracks.gauge), (1, -0.5 * spec.tracks.gauge)):
        for x, z, pitch in shoes[side].tolist():
            place(shoe, rotation_from_rpy((0.0, pitch, 0.0)), np.array([x, y, z]))
    return tuple(
        MaterialGroup(name, material, merge_shaded(parts))
        for (name, material), parts in groups.items()
    )
