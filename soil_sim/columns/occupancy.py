"""Marks of the columns that tools are in, or tracks stand on, for kernels."""

from __future__ import annotations

__all__ = ["FREE", "TOOL_INSIDE", "TRACK_ABOVE"]

FREE = 0
"""The column gives and receives soil."""

TOOL_INSIDE = 1
"""A tool is in the column: it neither gives nor receives soil, and none slides past it."""

TRACK_ABOVE = 2
"""A track stands on the column: no soil slides into it. Its own soil may fail, as at the edge of a
pit."""
