"""Vector code for the two loops that the compiler does not vectorise: gather and scatter.

The contact maths wants each quantity of many contacts side by side; particles are records. Between
the two, four contacts at a time are transposed in registers. Written as LLVM vectors of 16 floats,
which the compiler splits where the processor has narrower ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["GROUP_SIZE", "gather_relative_motion", "scatter_forces"]

GROUP_SIZE = 4
"""Contacts that are gathered or scattered together."""

_LANES = 4
"""Groups of four floats in a record."""
_FLOAT_TYPE = ir.FloatType()
_FOUR_FLOATS = ir.VectorType(_FLOAT_TYPE, 4)
_RECORD_TYPE = ir.VectorType(_FLOAT_TYPE, 16)
_INDEX_TYPE = ir.IntType(32)
_FUSE = ("contract",)


@intrinsic
def gather_relative_motion(typing, body, first, second, at, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Motion of four contacts' second particles relative to their first, by quantity.

    Args:
        body: records, shape (n, 16): displacement, -, velocity, -, surface speed, -, and others.
        first, second: rows of the contacts.
        at: the first of four contacts.
        scratch: out; component c of quantity q goes to `(3 q + c) * stride + slot` and the three
            places behind it. Of surface speed, which turning gives, it is the sum of both.
        stride, slot: see there.
    """
    signature = types.void(body, first, second, at, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array = _arrays(context, builder, signature, values)
        at, out = values[3], _quantity_pointer(builder, array(4), values[5], values[6])
        # The first's share is taken off, and in the third lane added.
        sign = _constant([-1.0] * 8 + [1.0] * 4 + [0.0] * 4)
        rows = []
        for k in range(GROUP_SIZE):
            i = _record_pointer(builder, array(0), _load_row(builder, array(1), at, k))
            j = _record_pointer(builder, array(0), _load_row(builder, array(2), at, k))
            rows.append(_multiply_add(builder, _load(builder, i), sign, _load(builder, j)))
        for component, column in enumerate(_transpose_lanes(builder, rows)[:3]):
            for lane in range(3):
                _store(builder, _lane(builder, column, lane), out(3 * lane + component))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def scatter_forces(typing, body, force_sums, first, second, at, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Add the forces of four contacts to the sums of their particles, one contact after another.

    Args:
        body: records, shape (n, 16), with the spin in the last lane.
        total: sums, shape (n, 16): force, limit, turning force, -, -, and in the last lane the
            spin of the others times the limit.
        first, second: rows of the contacts.
        at: the first of four contacts.
        scratch: force on the second (quantities 0-2), turning force on both (3-5), limit (6), at
            `q * stride + slot` and the three places behind it.
        stride, slot: see there.
    """
    signature = types.void(body, force_sums, first, second, at, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array = _arrays(context, builder, signature, values)
        at, source = values[4], _quantity_pointer(builder, array(5), values[6], values[7])
        force = [builder.load(builder.bitcast(source(q), _FOUR_FLOATS.as_pointer()), align=4)
                 for q in range(7)]  # fmt: skip
        none = ir.Constant(_FOUR_FLOATS, [0.0] * 4)
        limit = force[6]
        columns = [
            _concatenate_lanes(builder, force[c], force[3 + c], none, limit) for c in range(3)
        ]
        columns.append(_concatenate_lanes(builder, limit, none, none, none))
        angular_velocity = _blend_mask(range(12, 16))
        ones, signs = _constant([1.0] * 16), _constant([-1.0] * 3 + [1.0] * 13)
        for k, row in enumerate(_transpose_lanes(builder, columns)):
            i, j = (_load_row(builder, array(n), at, k) for n in (2, 3))
            for own, other, sign in ((i, j, signs), (j, i, ones)):
                record = _load(builder, _record_pointer(builder, array(0), other))
                share = builder.shuffle_vector(sign, record, angular_velocity)
                place = _record_pointer(builder, array(1), own)
                _store(builder, _multiply_add(builder, row, share, _load(builder, place)), place)
        return context.get_dummy_value()

    return signature, generate


def _arrays(context: Any, builder: Any, signature: Any, values: Any) -> Callable[[int], Any]:
    """Data pointer of an argument that is an array."""
    return lambda n: context.make_array(signature.args[n])(context, builder, values[n]).data


def _quantity_pointer(builder: Any, data: Any, stride: Any, slot: Any) -> Callable[[int], Any]:
    """Pointer to a slot of quantity q."""
    return lambda q: builder.gep(
        data, [builder.add(builder.mul(ir.Constant(stride.type, q), stride), slot)]
    )


def _load_row(builder: Any, rows: Any, at: Any, k: int) -> Any:
    place = builder.gep(rows, [builder.add(at, ir.Constant(at.type, k))])
    return builder.zext(builder.load(place), ir.IntType(64))


def _record_pointer(builder: Any, data: Any, row: Any) -> Any:
    """Pointer to a record."""
    place = builder.gep(data, [builder.mul(row, ir.Constant(row.type, 4 * _LANES))])
    return builder.bitcast(place, _RECORD_TYPE.as_pointer())


def _load(builder: Any, place: Any) -> Any:
    return builder.load(place, align=4)


def _store(builder: Any, value: Any, place: Any) -> None:
    builder.store(value, builder.bitcast(place, value.type.as_pointer()), align=4)


def _multiply_add(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c."""
    return builder.fadd(builder.fmul(a, b, flags=_FUSE), c, flags=_FUSE)


def _constant(values: Sequence[float]) -> Any:
    return ir.Constant(_RECORD_TYPE, list(values))


def _blend_mask(second: range) -> Any:
    """Shuffle that takes the floats numbered in `second` from its second vector."""
    return _shuffle([n + 16 * (n in second) for n in range(16)])


def _shuffle(numbers: Sequence[int]) -> Any:
    return ir.Constant(ir.VectorType(_INDEX_TYPE, len(numbers)), list(numbers))


def _lane(builder: Any, vector: Any, lane: int) -> Any:
    return builder.shuffle_vector(vector, vector, _shuffle(range(4 * lane, 4 * lane + 4)))


def _concatenate_lanes(builder: Any, *lanes: Any) -> Any:
    """One vector of 16 from four of 4."""
    low, high = (builder.shuffle_vector(*lanes[n : n + 2], _shuffle(range(8))) for n in (0, 2))
    return builder.shuffle_vector(low, high, _shuffle(range(16)))


def _transpose_lanes(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Four vectors of four lanes: the 4 x 4 floats of each lane transposed."""

    def in_lanes(a: Any, b: Any, pattern: Sequence[int]) -> Any:
        numbers = [4 * lane + n % 4 + 16 * (n // 4) for lane in range(_LANES) for n in pattern]
        return builder.shuffle_vector(a, b, _shuffle(numbers))

    low, high = (0, 4, 1, 5), (2, 6, 3, 7)
    ab_low, cd_low = in_lanes(rows[0], rows[1], low), in_lanes(rows[2], rows[3], low)
    ab_high, cd_high = in_lanes(rows[0], rows[1], high), in_lanes(rows[2], rows[3], high)
    front, back = (0, 1, 4, 5), (2, 3, 6, 7)
    return [
        in_lanes(ab_low, cd_low, front),
        in_lanes(ab_low, cd_low, back),
        in_lanes(ab_high, cd_high, front),
        in_lanes(ab_high, cd_high, back),
    ]
