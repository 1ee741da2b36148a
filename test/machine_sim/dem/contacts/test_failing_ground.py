"""The ground ahead of a tool that digs moves as the wedge of soil that fails there."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, drive_steps, engine, pose

from machine_sim.dem.contacts.failing_ground import failing_ground_velocity

SPEED = 0.5
STEEP = np.array([0.96, 0.0, 0.28])
"""Normal of a face that a tool meets as it moves toward -x."""


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.0])
def test_face_moves_forward_and_up_as_fast_as_the_tool_moves_into_it(yaw: float) -> None:
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    velocity = failing_ground_velocity.py_func(
        tuple(turn @ STEEP), tuple(turn @ [-SPEED, 0.3, -1.0])
    )
    expected = 0.96 * SPEED * np.array([-np.cos(np.pi / 6), 0.0, 0.5])
    assert velocity == pytest.approx(turn @ expected, abs=1e-12)


@pytest.mark.parametrize(
    ("normal", "tool_velocity"),
    [
        ((0.0, 0.0, 1.0), (-SPEED, 0.0, -SPEED)),  # level ground
        (tuple(STEEP), (SPEED, 0.0, 0.0)),  # the tool moves away
        (tuple(STEEP), (0.0, SPEED, -SPEED)),  # along the face
    ],
)
def test_other_ground_is_at_rest(
    normal: tuple[float, float, float], tool_velocity: tuple[float, float, float]
) -> None:
    assert failing_ground_velocity.py_func(normal, tool_velocity) == (0.0, 0.0, 0.0)


def force_on_plate(*, is_milling: bool) -> NDArray[np.float64]:
    """Return the mean force of particles on a plate that presses them against a face of 63 degrees.

    [N], shape (3,).
    """
    world = engine(slope=-2.0, allow_sleeping=False)
    y, z = np.meshgrid(np.arange(-0.4, 0.5, 0.16), np.arange(0.1, 0.9, 0.16), indexing="ij")
    at = np.column_stack([0.1 - 0.5 * z.ravel(), y.ravel(), z.ravel()])
    world.add(at, np.zeros_like(at), 2 * LITRE, grow=False)
    plate = np.array([(-0.5, -0.6, 1.0), (0.0, -0.6, 0.0), (0.0, 0.6, 0.0), (-0.5, 0.6, 1.0)])
    way = [pose(0.22 - SPEED * STEP * k) for k in range(round(0.2 / STEP))]
    world.add_tool(0, [plate], way[0], is_milling=is_milling)
    forces = [world.tool_wrench(0)[0].copy() for _ in drive_steps(world, way)]
    return np.mean(forces[len(forces) // 2 :], axis=0)


def test_failing_ground_lifts_what_a_tool_presses_against_it() -> None:
    up_along_face = np.array([-1.0, 0.0, 2.0]) / np.sqrt(5.0)
    assert force_on_plate(is_milling=False) @ up_along_face > 500.0
    # A drum pushes the particles up along a face at rest, which brakes them.
    assert force_on_plate(is_milling=True) @ up_along_face < -500.0
