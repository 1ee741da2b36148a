"""Marks of the columns that slope failure leaves out or spares, for kernels."""

from __future__ import annotations

__all__ = ["FREE", "LEE", "TOOL_INSIDE"]

FREE = 0
"""The column gives and receives soil."""

TOOL_INSIDE = 1
"""A tool is in the column: it neither gives nor receives soil."""

LEE = 2
"""The column is in the lee of a tool that pushes soil: it receives none, and may give some."""
