"""Products of rotation matrices and vectors in kernels."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from machine_sim.machine.rotated_vectors import product_column, rotate_to_frame, rotate_to_map
from msg_bridge.kernels import kernel

MATRICES = np.random.default_rng(3).normal(size=(200, 3, 3))
VECTOR = (0.7, -1.3, 2.9)


@kernel
def _to_map(matrix, x, y, z):  # type: ignore[no-untyped-def]
    return rotate_to_map(matrix, x, y, z)


@kernel
def _to_frame(matrix, x, y, z):  # type: ignore[no-untyped-def]
    return rotate_to_frame(matrix, x, y, z)


@kernel
def _column(matrix, x, y, z):  # type: ignore[no-untyped-def]
    return product_column(matrix, x, y, z)


def fused(a: float, b: float, c: float) -> float:
    """Return a b + c, rounded once."""
    return float(Fraction(a) * Fraction(b) + Fraction(c))


def test_products_are_those_of_matrix_and_vector() -> None:
    for matrix in MATRICES:
        assert _to_map(matrix, *VECTOR) == pytest.approx(matrix.dot(VECTOR), abs=1e-14)
        assert _to_frame(matrix, *VECTOR) == pytest.approx(matrix.T.dot(VECTOR), abs=1e-14)
        assert _column(matrix, *VECTOR) == pytest.approx(matrix.dot(VECTOR), abs=1e-14)


def test_products_have_the_same_bits_on_every_processor() -> None:
    x, y, z = VECTOR
    for matrix in MATRICES:
        to_map = [fused(c, z, fused(a, x, b * y)) for a, b, c in matrix.tolist()]
        assert list(_to_map(matrix, x, y, z)) == to_map
        to_frame = [fused(c, z, fused(b, y, a * x)) for a, b, c in matrix.T.tolist()]
        assert list(_to_frame(matrix, x, y, z)) == to_frame
        column = [fused(c, z, fused(b, y, a * x)) for a, b, c in matrix.tolist()]
        assert list(_column(matrix, x, y, z)) == column
