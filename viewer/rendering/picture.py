"""Picture: what the page has drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.rendering.errors import RenderError

__all__ = ["FORMATS", "MAX_SIZE", "MIN_SIZE", "Picture", "PictureSize"]

FORMATS = ("rgb", "png", "jpeg")
"""Encodings of a picture. rgb: 8 bit, row by row from the top."""

MIN_SIZE, MAX_SIZE = 16, 4096
"""Smallest and largest width and height [pixels]."""


@dataclass(frozen=True)
class PictureSize:
    """Width and height [pixels]."""

    width: int
    height: int

    def __post_init__(self) -> None:
        """Validate the values.

        Raises:
            RenderError: one is out of range.
        """
        if not all(MIN_SIZE <= value <= MAX_SIZE for value in (self.width, self.height)):
            raise RenderError(
                f"a picture has {MIN_SIZE} to {MAX_SIZE} pixels in width and height, not {self}"
            )

    def __str__(self) -> str:
        """Return the size as WIDTHxHEIGHT."""
        return f"{self.width}x{self.height}"

    @classmethod
    def parse(cls, text: str) -> PictureSize:
        """Return the size in a text such as 1280x720.

        Raises:
            RenderError: the text is no size.
        """
        width, separator, height = text.lower().partition("x")
        if not separator or not (width.isdecimal() and height.isdecimal()):
            raise RenderError(f"{text!r} is no size; give WIDTHxHEIGHT, such as 1280x720")
        return cls(int(width), int(height))


@dataclass(frozen=True)
class Picture:
    """One picture.

    Attributes:
        size: width and height.
        format: one of `FORMATS`.
        data: the encoded picture.
        position: of the camera [m], map frame.
        rotation: quaternion x, y, z, w of the camera's optical frame (x right, y down, z forward)
            in the map frame.
        fov: vertical angle of view [deg].
        time: simulation time [s].
    """

    size: PictureSize
    format: str
    data: bytes
    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]
    fov: float
    time: float = 0.0

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """Red, green, blue of a picture in the format rgb, shape (height, width, 3)."""
        assert self.format == "rgb"
        return np.frombuffer(self.data, np.uint8).reshape(self.size.height, self.size.width, 3)

    @classmethod
    def from_message(
        cls, message: dict[str, Any], size: PictureSize, form: str, time: float = 0.0
    ) -> Picture:
        """Return the picture in a message of the page.

        Args:
            message: the message.
            size: size that was requested.
            form: format that was requested.
            time: simulation time [s].

        Raises:
            RenderError: it is another one than was requested.
        """
        data = message.get("data")
        got = (message.get("width"), message.get("height"))
        if not isinstance(data, bytes) or got != (size.width, size.height):
            raise RenderError(f"the page sent a picture of {got} pixels instead of {size}")
        if form == "rgb" and len(data) != 3 * size.width * size.height:
            raise RenderError(f"the page sent {len(data)} bytes for a picture of {size}")
        x, y, z = map(float, message["position"])
        qx, qy, qz, qw = map(float, message["rotation"])
        return cls(size, form, data, (x, y, z), (qx, qy, qz, qw), float(message["fov"]), time)
