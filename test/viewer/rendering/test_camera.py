"""Cameras of pictures are validated, and sent to the page without what is left to its default."""

import math

import pytest

from viewer.rendering.camera import MachineCamera, PoseCamera
from viewer.rendering.errors import RenderError


def test_values_that_are_not_given_are_left_to_the_page():
    camera = MachineCamera("orbit", "/excavator", azimuth=30.0)
    assert camera.to_message() == {"view": "orbit", "machine": "/excavator", "azimuth": 30.0}


@pytest.mark.parametrize(
    "values",
    [
        {"view": "satellite"},
        {"elevation": 90.0},
        {"distance": 0.0},
        {"fov": 180.0},
        {"azimuth": math.nan},
    ],
)
def test_machine_camera_out_of_range_is_rejected(values):
    with pytest.raises(RenderError):
        MachineCamera(**values)


def test_camera_that_looks_along_its_up_direction_is_rejected():
    with pytest.raises(RenderError):
        PoseCamera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0))
    PoseCamera((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))


def test_camera_at_its_target_is_rejected():
    with pytest.raises(RenderError):
        PoseCamera((1.0, 2.0, 3.0), (1.0, 2.0, 3.0))
