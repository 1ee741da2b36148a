"""Vectorised gather and scatter between particle records and scratch blocks.

The arithmetic of contacts and of the integration needs each quantity of many bodies side by side,
while particles are records, and the compiler does not vectorise the transposition between the two.
Here four contacts or bodies at a time are transposed in registers. The code is written as LLVM
vectors of 16 floats, which the compiler splits where the processor has narrower ones.

A record of 16 floats is treated as four *lanes* of four floats. The layouts of `body_records` are
built in here:

    lane   columns   body record              force sums
    0      0-3       displacement, -          force, rolling limit
    1      4-7       velocity, -              torque over radius, -
    2      8-11      surface velocity, -      -
    3      12-15     angular velocity, -      limit-weighted angular velocity, -
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from msg_bridge.kernels import helper

__all__ = [
    "CLOSING_VELOCITY",
    "CONTACT_RADIUS_SUM",
    "FORCE",
    "GROUP_SIZE",
    "INVERSE_MASS_SUM",
    "RELATIVE_DISPLACEMENT",
    "RELATIVE_VELOCITY",
    "ROLLING_LIMIT",
    "SURFACE_VELOCITY_SUM",
    "TORQUE_OVER_RADIUS",
    "VECTOR_SIZE",
    "add_forces",
    "gather_approach",
    "gather_motion",
    "gather_records",
    "gather_relative_motion",
    "round_up",
    "scatter_forces",
    "scatter_records",
]

GROUP_SIZE = 4
"""Contacts or bodies that are gathered or scattered together."""
VECTOR_SIZE = 16
"""Floats in the widest vector of a processor. Loops over slots run over whole vectors: what a loop
computes in slots that are not in use is not read, and costs less than a remainder slot by slot."""

# Quantities of a scratch block, each a float per slot; vectors take three in a row.
RELATIVE_DISPLACEMENT, RELATIVE_VELOCITY, SURFACE_VELOCITY_SUM = 0, 3, 6
"""Quantities that `gather_relative_motion` and `gather_motion` write."""
CLOSING_VELOCITY, INVERSE_MASS_SUM, CONTACT_RADIUS_SUM = 0, 3, 4
"""Quantities that `gather_approach` writes."""
FORCE, TORQUE_OVER_RADIUS, ROLLING_LIMIT = 0, 3, 6
"""Quantities that `scatter_forces` and `add_forces` read."""

_NUM_LANES = 4
_RECORD_SIZE = 4 * _NUM_LANES
_FLOAT_TYPE = ir.FloatType()
_LANE_TYPE = ir.VectorType(_FLOAT_TYPE, 4)
_RECORD_TYPE = ir.VectorType(_FLOAT_TYPE, _RECORD_SIZE)
_INDEX_TYPE = ir.IntType(32)
_FUSE = ("contract",)
"""The products may be fused with the sums, here and nowhere else."""


@helper(forceinline=True)
def round_up(count, size):  # type: ignore[no-untyped-def]
    """Return the smallest multiple of `size` that is not below `count`."""
    return (count + size - 1) // size * size


@intrinsic
def gather_relative_motion(typing, body, first, second, contact, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Write the motion of the second bodies of four contacts relative to the first ones.

    Quantity q is written to `scratch[q * stride + slot]` and the three elements after it.

    Args:
        typing: typing context of Numba.
        body: body records, shape (n, 16), float32.
        first, second: rows of the bodies of each contact, uint32.
        contact: number of the first of the four contacts.
        scratch: out, relative displacement and velocity, and the sum of the surface velocities.
        stride: distance between quantities in `scratch`.
        slot: position of the first contact in `scratch`.
    """
    signature = types.void(body, first, second, contact, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array = _array_data(context, builder, signature, values)
        contact, out = values[3], _quantity_pointer(builder, array(4), values[5], values[6])
        # The motion of the first body is subtracted, its surface velocity (lane 2) added.
        sign = _constant([-1.0] * 8 + [1.0] * 4 + [0.0] * 4)
        _store_motion(builder, _combine_pairs(builder, array, contact, sign), out)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def gather_approach(typing, body, first, second, pair, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Write how the second bodies of four pairs approach the first ones, and how near they may be.

    Args:
        typing: typing context of Numba.
        body, first, second, stride, slot: as for `gather_relative_motion`.
        pair: number of the first of the four pairs.
        scratch: out, relative velocity, and the sums of inverse masses and of contact radii.
    """
    signature = types.void(body, first, second, pair, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array = _array_data(context, builder, signature, values)
        pair, out = values[3], _quantity_pointer(builder, array(4), values[5], values[6])
        # The velocity of the first body (lane 1) is subtracted, all else added.
        sign = _constant([1.0] * 4 + [-1.0] * 3 + [1.0] * 9)
        columns = _transpose_lanes(builder, _combine_pairs(builder, array, pair, sign))
        for component, column in enumerate(columns):
            _store(builder, _lane(builder, column, 1), out(CLOSING_VELOCITY + component))
        _store(builder, _lane(builder, columns[3], 0), out(CONTACT_RADIUS_SUM))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def gather_motion(typing, body, row, contact, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Write the motion of the bodies of four contacts with something at rest.

    Args:
        typing: typing context of Numba.
        body: body records, shape (n, 16), float32.
        row: row of the body of each contact, uint32.
        contact, scratch, stride, slot: as for `gather_relative_motion`.
    """
    signature = types.void(body, row, contact, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        pointers, out = _group_pointers(context, builder, signature, values)
        _store_motion(builder, [_load(builder, each) for each in pointers], out)
        return context.get_dummy_value()

    return signature, generate


@intrinsic(prefer_literal=True)
def gather_records(typing, records, row, first, scratch, stride, slot, columns):  # type: ignore[no-untyped-def]
    """Write columns of four records, column q to `scratch[q * stride + slot]` and on.

    Args:
        typing: typing context of Numba.
        records: body records or force sums, shape (n, 16), float32.
        row: rows, uint32.
        first: index in `row` of the first of the four records.
        scratch: out, 16 quantities.
        stride: distance between quantities in `scratch`.
        slot: position of the first record in `scratch`.
        columns: bit q is set for each column q that is written, a constant.
    """
    signature = types.void(records, row, first, scratch, stride, slot, columns)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        pointers, out = _group_pointers(context, builder, signature, values)
        rows = [_load(builder, each) for each in pointers]
        for component, column in enumerate(_transpose_lanes(builder, rows)):
            for q in range(component, _RECORD_SIZE, 4):
                if columns.literal_value >> q & 1:
                    _store(builder, _lane(builder, column, q // 4), out(q))
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def scatter_records(typing, records, row, first, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Write four records from `scratch`; the arguments are those of `gather_records`."""
    signature = types.void(records, row, first, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        pointers, source = _group_pointers(context, builder, signature, values)
        columns = [
            _concatenate_lanes(
                builder,
                *(_four_floats(builder, source(4 * lane + c)) for lane in range(_NUM_LANES)),
            )
            for c in range(4)
        ]
        for pointer, record in zip(pointers, _transpose_lanes(builder, columns), strict=True):
            _store(builder, record, pointer)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def add_forces(typing, force_sums, row, contact, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Add the forces of four contacts with something at rest to the sums of their bodies.

    Args:
        typing: typing context of Numba.
        force_sums: updated, shape (n, 16), float32.
        row: row of the body of each contact, uint32.
        contact, scratch, stride, slot: as for `scatter_forces`.
    """
    signature = types.void(force_sums, row, contact, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        pointers, source = _group_pointers(context, builder, signature, values)
        columns = _force_columns(builder, source, sums_rotation=False)
        for pointer, row in zip(pointers, _transpose_lanes(builder, columns), strict=True):
            _store(builder, builder.fadd(_load(builder, pointer), row), pointer)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def scatter_forces(typing, body, force_sums, first, second, contact, scratch, stride, slot):  # type: ignore[no-untyped-def]
    """Add the forces of four contacts to the sums of their bodies, one contact after another.

    The force acts on the second body and its opposite on the first; torque over radius and rolling
    limit act on both. Each body's limit-weighted angular velocity grows by the rolling limit times
    the angular velocity of the other.

    Args:
        typing: typing context of Numba.
        body: body records, shape (n, 16), float32.
        force_sums: updated, shape (n, 16), float32.
        first, second: rows of the bodies of each contact, uint32.
        contact: number of the first of the four contacts.
        scratch: force, torque over radius and rolling limit; quantity q is read from
            `scratch[q * stride + slot]` and the three elements after it.
        stride: distance between quantities in `scratch`.
        slot: position of the first contact in `scratch`.
    """
    signature = types.void(body, force_sums, first, second, contact, scratch, stride, slot)

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array = _array_data(context, builder, signature, values)
        contact, source = values[4], _quantity_pointer(builder, array(5), values[6], values[7])
        columns = _force_columns(builder, source, sums_rotation=True)
        angular_velocity = _blend_mask(range(12, 16))
        ones, signs = _constant([1.0] * 16), _constant([-1.0] * 3 + [1.0] * 13)
        for k, row in enumerate(_transpose_lanes(builder, columns)):
            i, j = (_load_row(builder, array(n), contact, k) for n in (2, 3))
            for own, other, sign in ((i, j, signs), (j, i, ones)):
                record = _load(builder, _record_pointer(builder, array(0), other))
                factor = builder.shuffle_vector(sign, record, angular_velocity)
                sums = _record_pointer(builder, array(1), own)
                _store(builder, _multiply_add(builder, row, factor, _load(builder, sums)), sums)
        return context.get_dummy_value()

    return signature, generate


def _array_data(context: Any, builder: Any, signature: Any, values: Any) -> Callable[[int], Any]:
    """Return a function from the number of an array argument to its data pointer."""
    return lambda n: context.make_array(signature.args[n])(context, builder, values[n]).data


def _combine_pairs(builder: Any, array: Any, contact: Any, sign: Any) -> list[Any]:
    """Return, of four contacts, `sign` times the record of the first body plus that of the second.

    `array` gives the arguments body, first, second. The signs are +1 or -1: products are exact.
    """
    rows = []
    for k in range(GROUP_SIZE):
        i = _record_pointer(builder, array(0), _load_row(builder, array(1), contact, k))
        j = _record_pointer(builder, array(0), _load_row(builder, array(2), contact, k))
        rows.append(_multiply_add(builder, _load(builder, i), sign, _load(builder, j)))
    return rows


def _quantity_pointer(builder: Any, data: Any, stride: Any, slot: Any) -> Callable[[int], Any]:
    """Return a function from a quantity q to the pointer to `data[q * stride + slot]`."""
    return lambda q: builder.gep(
        data, [builder.add(builder.mul(ir.Constant(stride.type, q), stride), slot)]
    )


def _store_motion(builder: Any, records: Sequence[Any], out: Callable[[int], Any]) -> None:
    """Write displacements, velocities and surface velocities of four records to a scratch block."""
    quantities = (RELATIVE_DISPLACEMENT, RELATIVE_VELOCITY, SURFACE_VELOCITY_SUM)
    for component, column in enumerate(_transpose_lanes(builder, records)[:3]):
        for lane, quantity in enumerate(quantities):
            _store(builder, _lane(builder, column, lane), out(quantity + component))


def _force_columns(builder: Any, source: Callable[[int], Any], *, sums_rotation: bool) -> list[Any]:
    """Return what four contacts add to the force sums, component by component of the lanes.

    With `sums_rotation` the lane of the limit-weighted angular velocity has the rolling limits,
    which are still to be multiplied by angular velocities; otherwise zeros.
    """
    force = [_four_floats(builder, source(FORCE + c)) for c in range(3)]
    torque = [_four_floats(builder, source(TORQUE_OVER_RADIUS + c)) for c in range(3)]
    limit = _four_floats(builder, source(ROLLING_LIMIT))
    zeros = ir.Constant(_LANE_TYPE, [0.0] * 4)
    weight = limit if sums_rotation else zeros
    return [
        *(_concatenate_lanes(builder, force[c], torque[c], zeros, weight) for c in range(3)),
        _concatenate_lanes(builder, limit, zeros, zeros, zeros),
    ]


def _four_floats(builder: Any, pointer: Any) -> Any:
    return builder.load(builder.bitcast(pointer, _LANE_TYPE.as_pointer()), align=4)


def _group_pointers(
    context: Any, builder: Any, signature: Any, values: Any
) -> tuple[list[Any], Callable[[int], Any]]:
    """Return pointers for the arguments records, row, first, scratch, stride, slot.

    Returns:
        The pointers to the records of four rows, and a function as of `_quantity_pointer`.
    """
    array, first = _array_data(context, builder, signature, values), values[2]
    pointers = [
        _record_pointer(builder, array(0), _load_row(builder, array(1), first, k))
        for k in range(GROUP_SIZE)
    ]
    return pointers, _quantity_pointer(builder, array(3), values[4], values[5])


def _load_row(builder: Any, rows: Any, contact: Any, k: int) -> Any:
    """Load `rows[contact + k]` as a 64-bit integer."""
    pointer = builder.gep(rows, [builder.add(contact, ir.Constant(contact.type, k))])
    return builder.zext(builder.load(pointer), ir.IntType(64))


def _record_pointer(builder: Any, data: Any, row: Any) -> Any:
    """Return the pointer to the record of a row."""
    pointer = builder.gep(data, [builder.mul(row, ir.Constant(row.type, _RECORD_SIZE))])
    return builder.bitcast(pointer, _RECORD_TYPE.as_pointer())


def _load(builder: Any, pointer: Any) -> Any:
    return builder.load(pointer, align=4)


def _store(builder: Any, value: Any, pointer: Any) -> None:
    builder.store(value, builder.bitcast(pointer, value.type.as_pointer()), align=4)


def _multiply_add(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c."""
    return builder.fadd(builder.fmul(a, b, flags=_FUSE), c, flags=_FUSE)


def _constant(values: Sequence[float]) -> Any:
    return ir.Constant(_RECORD_TYPE, list(values))


def _blend_mask(second: range) -> Any:
    """Return a shuffle mask that takes the elements numbered in `second` from the second vector."""
    return _shuffle_mask([n + 16 * (n in second) for n in range(16)])


def _shuffle_mask(numbers: Sequence[int]) -> Any:
    return ir.Constant(ir.VectorType(_INDEX_TYPE, len(numbers)), list(numbers))


def _lane(builder: Any, vector: Any, lane: int) -> Any:
    """Return a lane of a record."""
    return builder.shuffle_vector(vector, vector, _shuffle_mask(range(4 * lane, 4 * lane + 4)))


def _concatenate_lanes(builder: Any, *lanes: Any) -> Any:
    """Return a vector of 16 floats from four lanes."""
    low, high = (builder.shuffle_vector(*lanes[n : n + 2], _shuffle_mask(range(8))) for n in (0, 2))
    return builder.shuffle_vector(low, high, _shuffle_mask(range(16)))


def _transpose_lanes(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Transpose, in each lane of four records, the 4 x 4 floats."""

    def shuffle_in_lanes(a: Any, b: Any, pattern: Sequence[int]) -> Any:
        numbers = [4 * lane + n % 4 + 16 * (n // 4) for lane in range(_NUM_LANES) for n in pattern]
        return builder.shuffle_vector(a, b, _shuffle_mask(numbers))

    low, high = (0, 4, 1, 5), (2, 6, 3, 7)
    ab_low, ab_high = (shuffle_in_lanes(rows[0], rows[1], half) for half in (low, high))
    cd_low, cd_high = (shuffle_in_lanes(rows[2], rows[3], half) for half in (low, high))
    front, back = (0, 1, 4, 5), (2, 3, 6, 7)
    return [
        shuffle_in_lanes(ab_low, cd_low, front),
        shuffle_in_lanes(ab_low, cd_low, back),
        shuffle_in_lanes(ab_high, cd_high, front),
        shuffle_in_lanes(ab_high, cd_high, back),
    ]
