"""Intrinsic matrices of a rendered picture: a pinhole without distortion and with square pixels.

As in OpenCV and REP 104 a pixel's coordinates are those of its centre, from (0, 0) at the upper
left, so the optical axis passes between the pixels of an image with an even size::

    u = f X / Z + (width - 1) / 2        x right
    v = f Y / Z + (height - 1) / 2       y down, z forward
"""

from __future__ import annotations

import math

from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from viewer.rendering.picture import Picture, PictureSize

__all__ = ["focal_length", "to_camera_info", "to_image"]

_CHANNELS = 3


def focal_length(size: PictureSize, fov: float) -> float:
    """Return the focal length [pixels] of a picture with a vertical angle of view [deg]."""
    return 0.5 * size.height / math.tan(0.5 * math.radians(fov))


def to_camera_info(size: PictureSize, fov: float, frame_id: str, stamp: Time) -> CameraInfo:
    """Return the camera info of a picture.

    Args:
        size: of the picture.
        fov: vertical angle of view [deg].
        frame_id: optical frame of the camera.
        stamp: simulation time.
    """
    f = focal_length(size, fov)
    cx, cy = 0.5 * (size.width - 1), 0.5 * (size.height - 1)
    return CameraInfo(
        header=Header(stamp=stamp, frame_id=frame_id),
        width=size.width,
        height=size.height,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=[f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def to_image(picture: Picture, frame_id: str, stamp: Time) -> Image:
    """Return an rgb8 picture as a message.

    Args:
        picture: in the format rgb.
        frame_id: optical frame of the camera.
        stamp: simulation time.
    """
    image = Image(
        header=Header(stamp=stamp, frame_id=frame_id),
        width=picture.size.width,
        height=picture.size.height,
        encoding="rgb8",
        is_bigendian=0,
        step=_CHANNELS * picture.size.width,
    )
    image.data.frombytes(picture.data)
    return image
