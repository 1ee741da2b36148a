"""Errors of the soil simulation: each message names the invalid value and the change to make."""

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SoilError", "TerrainError"]


class SoilError(EarthmovingError):
    """Invalid input; the state of the soil is unchanged."""


class TerrainError(SoilError):
    """Invalid terrain, or an invalid file of one."""
