"""CONVERSION rows by their kind."""

from __future__ import annotations

from msg_bridge.contract.rows import Rows

__all__ = ["split_kind"]


def split_kind(conversions: Rows, kind: int) -> tuple[Rows, Rows]:
    """Return the CONVERSION rows of a `ConversionKind`, and the others.

    If all rows are of the kind, or none is, they are the same array and not a copy.
    """
    kinds = conversions["kind"]
    count = kinds.tobytes().count(kind)  # a byte each; for a few rows faster than NumPy
    if count == 0:
        return conversions[:0], conversions
    if count == conversions.size:
        return conversions, conversions[:0]
    is_of_kind = kinds == kind
    return conversions[is_of_kind], conversions[~is_of_kind]
