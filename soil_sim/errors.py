"""Errors of the soil: each message says what is wrong and what to change."""

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SoilError", "TerrainError"]


class SoilError(EarthmovingError):
    """Input the soil cannot take; it changed nothing."""


class TerrainError(SoilError):
    """A terrain, or a file of one, that cannot be used."""
