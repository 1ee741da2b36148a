"""Products of rotation matrices and vectors in kernels, to the bits of those of NumPy.

NumPy's `dot` of a 3 x 3 matrix and a vector rounds the sums of products with fused multiply-adds,
as its BLAS does on x86-64 processors that have them. These helpers do the same in the same order:
what a kernel computes can be computed outside of it too. On other processors they give these bits
still, and `dot` others in the last place.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic

from msg_bridge.kernels import helper

__all__ = ["product_column", "rotate_to_frame", "rotate_to_map"]


@intrinsic
def _fused_multiply_add(context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.fma(*values)

    return types.float64(types.float64, types.float64, types.float64), generate


@helper(forceinline=True)
def rotate_to_map(rotation, x, y, z):  # type: ignore[no-untyped-def]
    """Return `rotation.dot((x, y, z))` as three floats; the matrix has shape (3, 3)."""
    return (
        _row_product(rotation[0, 0], rotation[0, 1], rotation[0, 2], x, y, z),
        _row_product(rotation[1, 0], rotation[1, 1], rotation[1, 2], x, y, z),
        _row_product(rotation[2, 0], rotation[2, 1], rotation[2, 2], x, y, z),
    )


@helper(forceinline=True)
def rotate_to_frame(rotation, x, y, z):  # type: ignore[no-untyped-def]
    """Return `rotation.T.dot((x, y, z))` as three floats; the matrix has shape (3, 3)."""
    return (
        _column_product(rotation[0, 0], rotation[1, 0], rotation[2, 0], x, y, z),
        _column_product(rotation[0, 1], rotation[1, 1], rotation[2, 1], x, y, z),
        _column_product(rotation[0, 2], rotation[1, 2], rotation[2, 2], x, y, z),
    )


@helper(forceinline=True)
def product_column(rotation, x, y, z):  # type: ignore[no-untyped-def]
    """Return the column of `rotation.dot(other)` for the column x, y, z of the other (3, 3)."""
    return (
        _column_product(rotation[0, 0], rotation[0, 1], rotation[0, 2], x, y, z),
        _column_product(rotation[1, 0], rotation[1, 1], rotation[1, 2], x, y, z),
        _column_product(rotation[2, 0], rotation[2, 1], rotation[2, 2], x, y, z),
    )


@helper(forceinline=True)
def _row_product(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return a x + b y + c z in the order of a matrix times a vector."""
    return _fused_multiply_add(c, z, _fused_multiply_add(a, x, b * y))


@helper(forceinline=True)
def _column_product(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return a x + b y + c z in the order of a product of two matrices, or of a transposed matrix
    and a vector."""
    return _fused_multiply_add(c, z, _fused_multiply_add(b, y, a * x))
