"""Vector instructions that relax a block of pairs of columns.

The compiler vectorises a loop over the pairs of two rows, too, but with a hundred columns in a row
half of the time passes before the vector instructions begin and in the remainder after them. So the
code is written as LLVM vectors of 16 floats, which the compiler splits where the processor has
narrower ones. Only blocks with a pair that is too steep are changed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from msg_bridge.kernels.llvm_vectors import broadcast, data_pointers, load_vector, store_vector

__all__ = ["BLOCK_SIZE", "relax_block", "steep_pairs"]

BLOCK_SIZE = 16
"""Pairs of columns in a block."""

_FLOATS = ir.VectorType(ir.FloatType(), BLOCK_SIZE)
_BITS = ir.VectorType(ir.IntType(1), BLOCK_SIZE)
_MASK = ir.IntType(BLOCK_SIZE)
_ZEROS = ir.Constant(_FLOATS, [0.0] * BLOCK_SIZE)
_declare: Any = cgutils.get_or_insert_function  # without stubs


class _Pairs(NamedTuple):
    """LLVM values of a block of pairs; x: the first columns, y: their partners.

    Attributes:
        height_x, height_y: heights [m].
        drop: height of x above y [m].
        is_down: whether x is higher than y.
        excess: of the height between them over what is stable [m].
    """

    height_x: Any
    height_y: Any
    drop: Any
    is_down: Any
    excess: Any


@intrinsic
def steep_pairs(typing, heights, tangents, x, y, stable_drop, tolerance):  # type: ignore[no-untyped-def]
    """Return which pairs of a block have an excess of height that is relaxed.

    Args:
        typing: typing context of Numba.
        heights: surface [m], flat, float32.
        tangents: tangent of the angle of repose of each column, flat, float32; or None.
        x, y: flat indices of the first column and of its partner, uint64.
        stable_drop: distance of the columns or, without tangents, the drop between them that is
            stable [m], float32.
        tolerance: excess of height that is not relaxed [m], float32.

    Returns:
        A bit for each pair, uint16.
    """
    signature = types.uint16(heights, tangents, x, y, stable_drop, tolerance)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        heights, tangents, x, y, stable_drop, tolerance = data_pointers(
            context, builder, signature, arguments
        )
        pairs = _load_pairs(builder, heights, tangents, x, y, stable_drop)
        is_steep = builder.fcmp_ordered(
            ">", pairs.excess, broadcast(builder, tolerance, BLOCK_SIZE)
        )
        return builder.bitcast(is_steep, _MASK)

    return signature, generate


@intrinsic
def relax_block(typing, heights, floor, tangents, x, y, stable_drop, fraction, mask):  # type: ignore[no-untyped-def]
    """Let the higher columns of some pairs of a block give a fraction of the excess to the lower.

    Args:
        typing: typing context of Numba.
        heights: surface [m], flat, float32; changed.
        floor: height below which soil does not move [m], flat, float32; or None.
        tangents, x, y, stable_drop: see `steep_pairs`.
        fraction: fraction of the excess, float32.
        mask: bits of the pairs to relax, of those of `steep_pairs`, uint16. No column is in two.

    Returns:
        Bits of the pairs between which soil moved, uint16.
    """
    signature = types.uint16(heights, floor, tangents, x, y, stable_drop, fraction, mask)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        heights, floor, tangents, x, y, stable_drop, fraction, mask = data_pointers(
            context, builder, signature, arguments
        )
        pairs = _load_pairs(builder, heights, tangents, x, y, stable_drop)
        transfer = builder.fmul(broadcast(builder, fraction, BLOCK_SIZE), pairs.excess)
        if floor is not None:
            available = builder.select(
                pairs.is_down,
                builder.fsub(pairs.height_x, _load(builder, floor, x)),
                builder.fsub(pairs.height_y, _load(builder, floor, y)),
            )
            is_short = builder.fcmp_ordered("<", available, transfer)
            transfer = builder.select(is_short, available, transfer)
            is_positive = builder.fcmp_ordered(">", transfer, _ZEROS)
            transfer = builder.select(is_positive, transfer, _ZEROS)
        transfer = builder.select(builder.bitcast(mask, _BITS), transfer, _ZEROS)
        change = _call(builder, "llvm.copysign.v16f32", transfer, pairs.drop)
        store_vector(builder, builder.fsub(pairs.height_x, change), heights, x, align=4)
        # Loaded again: within a row, y may be the first column of another pair.
        store_vector(builder, builder.fadd(_load(builder, heights, y), change), heights, y, align=4)
        return builder.bitcast(builder.fcmp_unordered("!=", transfer, _ZEROS), _MASK)

    return signature, generate


def _load_pairs(
    builder: Any, heights: Any, tangents: Any, x: Any, y: Any, stable_drop: Any
) -> _Pairs:
    height_x, height_y = _load(builder, heights, x), _load(builder, heights, y)
    drop = builder.fsub(height_x, height_y)
    is_down = builder.fcmp_ordered(">", drop, _ZEROS)
    stable = broadcast(builder, stable_drop, BLOCK_SIZE)
    if tangents is not None:
        tangent = builder.select(is_down, _load(builder, tangents, x), _load(builder, tangents, y))
        stable = builder.fmul(stable, tangent)
    excess = builder.fsub(_call(builder, "llvm.fabs.v16f32", drop), stable)
    return _Pairs(height_x, height_y, drop, is_down, excess)


def _load(builder: Any, data: Any, begin: Any) -> Any:
    return load_vector(builder, data, begin, _FLOATS, align=4)


def _call(builder: Any, name: str, *vectors: Any) -> Any:
    kind = ir.FunctionType(_FLOATS, [_FLOATS] * len(vectors))
    return builder.call(_declare(builder.module, kind, name), vectors)
