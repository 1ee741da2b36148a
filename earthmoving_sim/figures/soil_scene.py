"""SoilScene: shows a soil without machines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soil_sim.soil import Soil
from viewer.scene.scene import Scene, SoilColor
from viewer.scene.terrain_surface import SurfaceMap
from viewer.scene.terrain_tiles import SurfaceLayers

__all__ = ["RUN_ID", "SoilScene", "show_soil", "soil_colors"]

RUN_ID = 1
"""Number of the run of all scenes here."""


class SoilScene:
    """Sets a scene from a soil.

    Attributes:
        scene: what is shown.
    """

    def __init__(self, soil: Soil) -> None:
        self.scene = Scene()
        with self.scene.lock:
            self.scene.start_run(RUN_ID)
            self.scene.set_soils(soil_colors(soil))
        show_soil(self.scene, soil)

    def on_show(self, show: Callable[[], None]) -> None:
        """Do nothing: the soil does not change."""

    def show(self) -> None:
        """Do nothing: the soil does not change."""

    def close(self) -> None:
        """Do nothing."""


def soil_colors(soil: Soil) -> tuple[SoilColor, ...]:
    """Return names and colours of the kinds of soil, by id."""
    names = (soil.params.soil, *soil.params.additional_soils)
    return tuple(
        SoilColor(name, (kind.colour[0], kind.colour[1], kind.colour[2]))
        for name, kind in zip(names, soil.soil_types, strict=True)
    )


def show_soil(scene: Scene, soil: Soil) -> None:
    """Set the surface of a scene from a soil."""
    columns = soil.columns
    layers = SurfaceLayers(
        columns.height.astype(np.float32),
        columns.loose_depth,
        columns.top_soil,
        columns.top_moisture,
    )
    with scene.lock:
        scene.terrain.receive_map(SurfaceMap(RUN_ID, soil.revision, soil.grid, layers))
        scene.terrain_changed()
