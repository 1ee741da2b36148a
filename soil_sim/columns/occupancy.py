"""Marks of the columns that tools are in, for kernels."""

from __future__ import annotations

__all__ = ["FREE", "TOOL_INSIDE"]

FREE = 0
"""The column gives and receives soil."""

TOOL_INSIDE = 1
"""A tool is in the column: it neither gives nor receives soil, and none slides past it."""
