"""Text in a picture: what is shown, the simulation time and the load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

__all__ = ["draw_overlay"]

_RELATIVE_SIZE = 0.026
"""Size of the text as a fraction of the height of the picture."""

_BACKGROUND = (18, 20, 24, 150)
_INK = (245, 246, 248, 255)


def draw_overlay(pixels: NDArray[np.uint8], lines: list[str]) -> NDArray[np.uint8]:
    """Return a picture with lines of text in its lower left corner.

    Args:
        pixels: red, green, blue, shape (height, width, 3).
        lines: the text.
    """
    if not lines:
        return pixels
    height = pixels.shape[0]
    size = max(round(_RELATIVE_SIZE * height), 9)
    font = ImageFont.load_default(size)
    image = Image.fromarray(pixels).convert("RGBA")
    layer = Image.new("RGBA", image.size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(layer)
    spacing, margin = round(1.45 * size), round(0.7 * size)
    width = max(draw.textlength(line, font=font) for line in lines)
    top = height - margin - spacing * len(lines) - margin
    box = (margin, top, margin + width + 2 * margin, height - margin)
    draw.rounded_rectangle(box, radius=margin, fill=_BACKGROUND)
    for number, line in enumerate(lines):
        position = (2 * margin, top + 0.5 * margin + number * spacing)
        draw.text(position, line, font=font, fill=_INK)
    return np.asarray(Image.alpha_composite(image, layer).convert("RGB"))
