"""Intrinsic matrices of rendered pictures."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from viewer.cameras.camera_info import focal_length, to_camera_info, to_image
from viewer.rendering.picture import Picture, PictureSize

SIZE = PictureSize(640, 480)
STAMP = Time(sec=3, nanosec=20_000_000)


def project(info, point):
    """Return the pixel of a point in the optical frame."""
    u, v, w = np.array(info.p).reshape(3, 4) @ [*point, 1.0]
    return u / w, v / w


def test_points_at_the_edges_of_the_view_are_at_the_edges_of_the_image():
    info = to_camera_info(SIZE, 60.0, "cab_camera_optical", STAMP)
    height = np.tan(np.radians(30.0))
    # The upper edge of the first row is half a pixel before its centre.
    assert project(info, (0.0, -height, 1.0))[1] == pytest.approx(-0.5)
    assert project(info, (0.0, height, 1.0))[1] == pytest.approx(479.5)
    width = height * 640 / 480
    assert project(info, (2.0 * width, 0.0, 2.0))[0] == pytest.approx(639.5)


def test_optical_axis_is_in_the_middle_of_the_image():
    info = to_camera_info(SIZE, 60.0, "cab_camera_optical", STAMP)
    assert project(info, (0.0, 0.0, 5.0)) == (319.5, 239.5)


def test_matrices_agree_and_there_is_no_distortion():
    info = to_camera_info(SIZE, 45.0, "cab_camera_optical", STAMP)
    k, p = np.array(info.k).reshape(3, 3), np.array(info.p).reshape(3, 4)
    assert np.array_equal(p[:, :3], k)
    assert k[0, 0] == k[1, 1] == pytest.approx(focal_length(SIZE, 45.0))
    assert np.array_equal(np.array(info.r).reshape(3, 3), np.eye(3))
    assert list(info.d) == [0.0] * 5
    assert (info.width, info.height, info.distortion_model) == (640, 480, "plumb_bob")


def test_image_has_the_pixels_row_by_row():
    size = PictureSize(20, 16)
    data = bytes(range(240)) * 4
    picture = Picture(size, "rgb", data, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 60.0, 3.02)
    image = to_image(picture, "cab_camera_optical", STAMP)
    assert (image.width, image.height, image.step, image.encoding) == (20, 16, 60, "rgb8")
    assert bytes(image.data) == data
    assert (image.header.frame_id, image.header.stamp) == ("cab_camera_optical", STAMP)
