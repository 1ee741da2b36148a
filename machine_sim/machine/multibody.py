"""A machine's links and joints as one multibody of the physics engine."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.rotations import quaternion_from_matrix
from machine_sim.machine.spec import BASE, MachineSpec
from machine_sim.physics_engine import pybullet

__all__ = ["load_multibody"]

Array = NDArray[np.float64]


def load_multibody(
    client: int, urdf: str, spec: MachineSpec, position: Array, rotation: Array
) -> tuple[int, list[int]]:
    """Load a machine into the physics engine, at a pose of its base and with its home angles.

    Args:
        client: id of the physics client.
        urdf: URDF text of the machine.
        spec: specification of the machine.
        position, rotation: pose of the base frame, map frame [m], shapes (3,) and (3, 3).

    Returns:
        Id of the multibody, and the ids of its joints in the order of the specification.
    """
    body = _load_urdf(client, urdf)
    num_joints = pybullet.getNumJoints(body, client)
    ids = {_joint_name(pybullet.getJointInfo(body, i, client)): i for i in range(num_joints)}
    joints = [ids[name] for name in spec.joints]
    for i in range(-1, num_joints):
        # The default damping of the engine is not zero.
        pybullet.changeDynamics(
            body,
            i,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            physicsClientId=client,
        )
    for i, angle in zip(joints, spec.home.tolist(), strict=True):
        pybullet.resetJointState(body, i, angle, 0.0, client)
    # pybullet's base position is that of the centre of mass.
    com = position + rotation @ np.array(spec.links[BASE].center_of_mass)
    pybullet.resetBasePositionAndOrientation(
        body, com.tolist(), quaternion_from_matrix(rotation), physicsClientId=client
    )
    return body, joints


def _load_urdf(client: int, urdf: str) -> int:
    """Load URDF text, which pybullet reads only from a file; return the id of the multibody."""
    handle, name = tempfile.mkstemp(suffix=".urdf")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(urdf)
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_MAINTAIN_LINK_ORDER
        body: int = pybullet.loadURDF(name, flags=flags, physicsClientId=client)
    finally:
        Path(name).unlink()
    return body


def _joint_name(joint_info: tuple[Any, ...]) -> str:
    _, name, *_ = joint_info
    decoded: str = name.decode()
    return decoded
