"""Sizes of pictures, and pictures that a page sends."""

import numpy as np
import pytest

from viewer.rendering.errors import RenderError
from viewer.rendering.picture import Picture, PictureSize

SIZE = PictureSize(20, 16)


def message(**changes):
    values = {
        "width": 20,
        "height": 16,
        "data": bytes(range(240)) * 4,
        "position": [1.0, 2.0, 3.0],
        "rotation": [0.0, 0.0, 0.0, 1.0],
        "fov": 45.0,
    }
    return {**values, **changes}


def test_size_is_read_from_text():
    assert PictureSize.parse("1280x720") == PictureSize(1280, 720)


@pytest.mark.parametrize("text", ["", "1280", "x720", "-4x8", "1e3x10", "9x9", "8000x10"])
def test_text_that_is_no_size_is_rejected(text):
    with pytest.raises(RenderError):
        PictureSize.parse(text)


def test_pixels_are_row_by_row_from_the_top():
    pixels = Picture.from_message(message(), SIZE, "rgb").pixels
    assert pixels.shape == (16, 20, 3)
    assert np.array_equal(pixels[0, 1], [3, 4, 5])


@pytest.mark.parametrize(
    "changes", [{"width": 21}, {"data": b"short"}, {"data": "text"}, {"height": None}]
)
def test_picture_of_another_size_is_rejected(changes):
    with pytest.raises(RenderError):
        Picture.from_message(message(**changes), SIZE, "rgb")
