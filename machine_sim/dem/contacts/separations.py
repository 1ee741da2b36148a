"""Separations of pairs of particles, computed for four pairs at a time.

Positions are float64 and separations float32, and the compiler does not vectorise loads by row
numbers: a pair at a time takes twice as long.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from machine_sim.dem.contacts.simd import GROUP_SIZE

__all__ = ["gather_separations"]

_declare: Any = cgutils.get_or_insert_function  # without stubs
_SIZE = 4
"""Elements of the vectors: three components, and one that is zero."""
_POSITION = ir.VectorType(ir.DoubleType(), _SIZE)
_SEPARATION = ir.VectorType(ir.FloatType(), _SIZE)
_MASK = ir.VectorType(ir.IntType(1), _SIZE)
_INDICES = ir.VectorType(ir.IntType(32), _SIZE)


@intrinsic
def gather_separations(typing, position, first, second, pair, out, stride, slot):  # type: ignore[no-untyped-def]
    """Write the vectors from the first to the second centres of four pairs [m].

    Args:
        typing: typing context of Numba.
        position: centres [m], shape (n, 3), float64.
        first, second: rows of the particles of each pair, uint32.
        pair: number of the first of the four pairs.
        out: component q is written to `out[q * stride + slot]` and the three elements after it,
            float32.
        stride: distance between components in `out`.
        slot: position of the first pair in `out`.
    """
    signature = types.void(position, first, second, pair, out, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        position, first, second, out = (
            context.make_array(signature.args[n])(context, builder, values[n]).data
            for n in (0, 1, 2, 4)
        )
        pair, stride, slot = values[3], values[5], values[6]
        separations = []
        for k in range(GROUP_SIZE):
            at = builder.add(pair, ir.Constant(pair.type, k))
            i, j = (_load_centre(builder, position, rows, at) for rows in (first, second))
            separations.append(builder.fptrunc(builder.fsub(j, i), _SEPARATION))
        for component, column in enumerate(_transpose(builder, separations)):
            offset = builder.mul(ir.Constant(stride.type, component), stride)
            target = builder.gep(out, [builder.add(offset, slot)])
            builder.store(column, builder.bitcast(target, _SEPARATION.as_pointer()), align=4)
        return context.get_dummy_value()

    return signature, generate


def _load_centre(builder: Any, position: Any, rows: Any, at: Any) -> Any:
    """Load the centre of the particle in row `rows[at]`, and nothing behind it."""
    row = builder.zext(builder.load(builder.gep(rows, [at])), ir.IntType(64))
    centre = builder.gep(position, [builder.mul(row, ir.Constant(row.type, 3))])
    pointer = builder.bitcast(centre, _POSITION.as_pointer())
    kind = ir.FunctionType(_POSITION, [pointer.type, ir.IntType(32), _MASK, _POSITION])
    load = _declare(builder.module, kind, f"llvm.masked.load.v{_SIZE}f64.p0")
    mask, zeros = ir.Constant(_MASK, [1, 1, 1, 0]), ir.Constant(_POSITION, [0.0] * _SIZE)
    return builder.call(load, [pointer, ir.Constant(ir.IntType(32), 8), mask, zeros])


def _transpose(builder: Any, rows: list[Any]) -> list[Any]:
    """Return the x, y and z of four vectors."""

    def shuffle(a: Any, b: Any, numbers: list[int]) -> Any:
        return builder.shuffle_vector(a, b, ir.Constant(_INDICES, numbers))

    xy, z = [0, 4, 1, 5], [2, 6, 3, 7]
    xy_front, xy_back = shuffle(rows[0], rows[1], xy), shuffle(rows[2], rows[3], xy)
    z_front, z_back = shuffle(rows[0], rows[1], z), shuffle(rows[2], rows[3], z)
    front, back = [0, 1, 4, 5], [2, 3, 6, 7]
    return [
        shuffle(xy_front, xy_back, front),
        shuffle(xy_front, xy_back, back),
        shuffle(z_front, z_back, front),
    ]
