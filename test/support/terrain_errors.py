"""Terrain errors by code."""

from __future__ import annotations

from contextlib import AbstractContextManager

import pytest

from soil_sim.errors import TerrainError, TerrainErrorCode


def raises_terrain_error(
    *codes: TerrainErrorCode, match: str | None = None
) -> AbstractContextManager[pytest.ExceptionInfo[TerrainError]]:
    """Expect an error with one of the codes, and with a message that `match` matches."""
    return pytest.raises(TerrainError, match=match, check=lambda error: error.code in codes)
