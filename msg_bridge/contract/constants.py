"""Constants that soil and machines share."""

from __future__ import annotations

__all__ = ["GRAVITY", "MAX_MAP_CELLS", "MOISTURE_LEVELS"]

GRAVITY = 9.81
"""Gravitational acceleration, downward [m/s^2]."""

MOISTURE_LEVELS = 101
"""Number of moistures that a soil can have: 0 to 100 whole per cents of saturation."""

MAX_MAP_CELLS = 513 * 513
"""Number of columns up to which a terrain is published as one map; larger ones as tiles."""
