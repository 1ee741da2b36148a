"""A dozer blade: cuts with its edge, pushes soil ahead of its plate, and carries none."""

from __future__ import annotations

from machine_sim.tool_soil.tools.plate_cutting import PlateCutting

__all__ = ["BladeInteraction"]


class BladeInteraction(PlateCutting):
    """How a blade acts on soil: plate cutting without a payload."""
