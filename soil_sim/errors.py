"""Errors of the soil simulation: each message names the invalid value and the change to make."""

from enum import StrEnum

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SoilError", "TerrainError", "TerrainErrorCode"]


class SoilError(EarthmovingError):
    """Invalid input; the state of the soil is unchanged."""


class TerrainErrorCode(StrEnum):
    """Reason of a `TerrainError`, for programs; the message is for people."""

    # Files.
    NO_FILE = "no_file"
    """There is no file at the path, or it is a folder."""
    UNREADABLE = "unreadable"
    """A file cannot be read, or does not fit into memory."""
    UNWRITABLE = "unwritable"
    """A file cannot be written."""
    INVALID_FILE = "invalid_file"
    """A file is damaged, truncated or not of the format that its suffix names."""
    UNSUPPORTED = "unsupported"
    """A suffix or data type is not supported, or the format cannot store the content."""
    KEYS = "keys"
    """Header keys or arrays of a file are missing, unknown, repeated or contradictory."""

    # Heights and their grid.
    SHAPE = "shape"
    """An array is not rectangular, too small, or of another shape than its grid."""
    HEIGHT = "height"
    """A height is missing, not finite or beyond the limit."""
    HEIGHT_UNIT = "height_unit"
    """Heights are in another unit than metres, and no vertical scale is given."""
    HEIGHT_RANGE = "height_range"
    """The height range of a PNG is missing or invalid, or a height lies outside of it."""
    CELL_SIZE = "cell_size"
    """The cell size is missing, invalid, not in metres or another one than that of the terrain."""
    GEOREFERENCE = "georeference"
    """A georeference is invalid, not north-up or at odds with that of the terrain."""
    OFF_MAP = "off_map"
    """A piece, a point or a design lies outside of the map."""
    UNSTABLE_SLOPE = "unstable_slope"
    """A slope is too steep and too high to be stable."""

    # Layers of soil ids and moisture.
    LAYER = "layer"
    """A layer is missing, unknown or another one than requested."""
    LAYER_VALUE = "layer_value"
    """A soil id or moisture is missing or out of range."""

    ARGUMENT = "argument"
    """An argument is out of range, or does not apply to the terrain or the format."""


class TerrainError(SoilError):
    """Invalid terrain, or an invalid file of one.

    Attributes:
        code: the reason.
    """

    def __init__(self, message: str, code: TerrainErrorCode) -> None:
        super().__init__(message)
        self.code = code
