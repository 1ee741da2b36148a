"""Figure: pictures with their captions and measured values."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Figure", "FigurePicture"]


@dataclass(frozen=True)
class FigurePicture:
    """A picture of a figure.

    Attributes:
        path: the file.
        caption: what it shows.
    """

    path: Path
    caption: str


@dataclass
class Figure:
    """A figure.

    Attributes:
        number: its number in the reference of 2014.
        title: its caption there.
        text: what is shown here, and how it was made.
        pictures: the pictures.
        measurements: measured values with their units, by name.
    """

    number: int
    title: str
    text: str
    pictures: list[FigurePicture] = field(default_factory=list)
    measurements: dict[str, str] = field(default_factory=dict)
