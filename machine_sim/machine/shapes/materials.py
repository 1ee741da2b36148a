"""Materials of visual shapes: the shared ones, and those that a machine file adds or changes."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MATERIALS", "Material"]

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """Appearance of a surface, as in the metallic-roughness model of glTF 2.0.

    Attributes:
        color: red, green, blue, 0 to 1, sRGB as in URDF and RViz.
        metallic: 0 for paint, plastic and rubber, 1 for bare metal.
        roughness: 0 for a mirror, 1 for a matt surface.
        alpha: opacity, 1 for opaque.
        emission: fraction of the colour that it emits, 0 to 1.
    """

    color: Vec3
    metallic: float = 0.0
    roughness: float = 0.6
    alpha: float = 1.0
    emission: float = 0.0


MATERIALS: dict[str, Material] = {
    "paint": Material((0.95, 0.70, 0.10), 0.0, 0.38),
    "dark_paint": Material((0.13, 0.135, 0.14), 0.0, 0.5),
    "frame_paint": Material((0.24, 0.24, 0.25), 0.0, 0.6),
    "steel": Material((0.46, 0.47, 0.49), 0.75, 0.45),
    "worn_steel": Material((0.36, 0.34, 0.33), 0.6, 0.62),
    "chrome": Material((0.82, 0.84, 0.87), 1.0, 0.14),
    "rubber": Material((0.055, 0.055, 0.06), 0.0, 0.85),
    "plastic": Material((0.10, 0.10, 0.11), 0.0, 0.7),
    "trim": Material((0.62, 0.61, 0.58), 0.0, 0.95),
    "fabric": Material((0.16, 0.16, 0.18), 0.0, 0.95),
    "glass": Material((0.16, 0.22, 0.25), 0.0, 0.05, alpha=0.28),
    "mirror": Material((0.75, 0.80, 0.85), 1.0, 0.05),
    "light": Material((1.0, 0.96, 0.86), 0.0, 0.2, emission=0.35),
    "tail_light": Material((0.62, 0.05, 0.04), 0.0, 0.25, emission=0.15),
    "beacon": Material((0.95, 0.45, 0.05), 0.0, 0.2, emission=0.2),
    "screen": Material((0.10, 0.28, 0.38), 0.0, 0.2, emission=0.6),
}
"""Materials that every machine has; `paint` has the colour of the link by default."""
