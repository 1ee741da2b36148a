"""Poses: validation, and interpolation within a step."""

import numpy as np
import pytest
from support.particle_scenes import STEP, pose, square

from machine_sim.dem import ParticleError
from machine_sim.dem.tools import RigidTool, ToolSet


def test_pose_path_is_a_constant_twist_between_its_ends():
    tools = ToolSet(5)
    tools.add(0, RigidTool([square(1.0)], pose()))
    tools.tools[0].move(pose(1.0, 0.0, 2.0, 0.1), pose(1.5, 0.0, 2.0, 0.4))
    tools.begin_step(STEP)
    np.testing.assert_allclose(tools.twist[0], [100.0, 0, 0, 0, 60.0, 0], atol=1e-9)
    for s in range(6):
        rotation, origin = pose(1.0 + 0.1 * s, 0.0, 2.0, 0.1 + 0.06 * s)
        np.testing.assert_allclose(tools.path[s, 0], [*rotation.reshape(-1), *origin], atol=1e-12)


@pytest.mark.parametrize(
    "rotation", [np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), np.eye(2), np.full((3, 3), np.nan)]
)
def test_invalid_rotation_is_rejected(rotation):
    with pytest.raises(ParticleError):
        RigidTool([square(1.0)], (rotation, np.zeros(3)))


def test_rotation_by_a_right_angle_in_one_step_is_rejected():
    tool = RigidTool([square(1.0)], pose())
    with pytest.raises(ParticleError):
        tool.move(pose(), pose(pitch=np.pi / 2 + 0.01))
