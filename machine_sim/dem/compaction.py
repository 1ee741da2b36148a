"""Loops over values that the compiler does not vectorise, a vector at a time.

Most are for stream compaction: appending the marked ones of some values to a list. A loop that
appends value by value, with or without a branch, takes ten times as long. Processors with AVX-512
compress a vector in two instructions; for others the compiler expands it.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from msg_bridge.kernels.llvm_vectors import broadcast, data_pointers, load_vector, store_vector

__all__ = [
    "COMPACTION_SIZE",
    "append_marked",
    "append_pairs",
    "copy_vector",
    "find_value",
    "move_rows",
]

COMPACTION_SIZE = 16
"""Values that are read together. Arrays of values and marks have as many elements to spare."""

_declare: Any = cgutils.get_or_insert_function  # without stubs
_INT = ir.IntType(32)
_ROWS = ir.VectorType(_INT, COMPACTION_SIZE)
_MARKS = ir.VectorType(ir.IntType(8), COMPACTION_SIZE)
_MASK = ir.VectorType(ir.IntType(1), COMPACTION_SIZE)


@intrinsic
def append_marked(typing, values, mark, begin, out, count):  # type: ignore[no-untyped-def]
    """Append the marked ones of the values from number `begin` on to a list.

    Args:
        typing: typing context of Numba.
        values: uint32, shape (n + COMPACTION_SIZE,).
        mark: not 0 for those to be appended, uint8, shape (n + COMPACTION_SIZE,).
        begin: number of the first of `COMPACTION_SIZE` values, int64.
        out: the list, uint32; nothing is written behind the values that are appended.
        count: number of values in the list, int64.

    Returns:
        Number of values in the list then.
    """
    signature = types.int64(values, mark, begin, out, count)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        values, mark, begin, out, count = data_pointers(context, builder, signature, arguments)
        mask, number = _load_mask(builder, mark, begin)
        row = _load(builder, values, begin, _ROWS)
        _store_first(builder, _compress(builder, row, mask), number, out, count)
        return builder.add(count, number)

    return signature, generate


@intrinsic
def append_pairs(typing, own, values, mark, begin, first, second, count):  # type: ignore[no-untyped-def]
    """Append the pairs of `own`, uint32, with the marked ones of some values to two lists.

    The other arguments and the result are those of `append_marked`. Up to `COMPACTION_SIZE`
    elements of the lists behind the pairs are overwritten.
    """
    signature = types.int64(own, values, mark, begin, first, second, count)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        own, values, mark, begin, first, second, count = data_pointers(
            context, builder, signature, arguments
        )
        mask, number = _load_mask(builder, mark, begin)
        row = _load(builder, values, begin, _ROWS)
        _store(builder, broadcast(builder, own, COMPACTION_SIZE), first, count)
        _store(builder, _compress(builder, row, mask), second, count)
        return builder.add(count, number)

    return signature, generate


@intrinsic
def copy_vector(typing, source, begin, target, at):  # type: ignore[no-untyped-def]
    """Copy `COMPACTION_SIZE` elements of `source` from `begin` on to `target[at:]`.

    Args:
        typing: typing context of Numba.
        source, target: arrays of the same type, one axis.
        begin, at: int64.
    """
    signature = types.void(source, begin, target, at)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        source, begin, target, at = data_pointers(context, builder, signature, arguments)
        kind = ir.VectorType(source.type.pointee, COMPACTION_SIZE)
        _store(builder, _load(builder, source, begin, kind), target, at)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def find_value(typing, values, begin, count, wanted):  # type: ignore[no-untyped-def]
    """Return the number of a value among the first `count` ones, without a branch.

    Args:
        typing: typing context of Numba.
        values: uint32.
        begin: number of the first value, int64.
        count: number of values that are compared, up to `COMPACTION_SIZE`, int64.
        wanted: the value, uint32.

    Returns:
        Number of the first one that is equal, `COMPACTION_SIZE` where there is none, int64.
    """
    signature = types.int64(values, begin, count, wanted)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        values, begin, count, wanted = data_pointers(context, builder, signature, arguments)
        pointer = builder.bitcast(builder.gep(values, [begin]), _ROWS.as_pointer())
        mask = _first(builder, count)
        kind = ir.FunctionType(_ROWS, [pointer.type, _INT, _MASK, _ROWS])
        load = _declare(builder.module, kind, f"llvm.masked.load.v{COMPACTION_SIZE}i32.p0")
        undefined = ir.Constant(_ROWS, ir.Undefined)
        row = builder.call(load, [pointer, ir.Constant(_INT, 4), mask, undefined])
        equal = builder.and_(
            mask, builder.icmp_unsigned("==", row, broadcast(builder, wanted, COMPACTION_SIZE))
        )
        bits = builder.zext(builder.bitcast(equal, ir.IntType(COMPACTION_SIZE)), begin.type)
        end = ir.Constant(begin.type, 1 << COMPACTION_SIZE)
        return builder.cttz(builder.or_(bits, end), ir.Constant(ir.IntType(1), 1))

    return signature, generate


@intrinsic
def move_rows(typing, array, source, target, count):  # type: ignore[no-untyped-def]
    """Copy rows of a contiguous array to other rows of it, with which they may overlap.

    Args:
        typing: typing context of Numba.
        array: array of any type and number of axes.
        source, target: first row that is copied, and the one it is copied to, int64.
        count: number of rows, int64.
    """
    signature = types.void(array, source, target, count)

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        row_size = builder.extract_value(array.strides, 0)
        start = builder.bitcast(array.data, cgutils.voidptr_t)
        source, target = (
            builder.gep(start, [builder.mul(row, row_size)]) for row in arguments[1:3]
        )
        size = builder.mul(arguments[3], row_size)
        cgutils.raw_memmove(builder, target, source, size, 1)
        return context.get_dummy_value()

    return signature, generate


def _load(builder: Any, data: Any, begin: Any, kind: Any) -> Any:
    return load_vector(builder, data, begin, kind, align=1)


def _store(builder: Any, vector: Any, data: Any, begin: Any) -> None:
    store_vector(builder, vector, data, begin, align=1)


def _load_mask(builder: Any, mark: Any, begin: Any) -> tuple[Any, Any]:
    """Return a vector of which values are marked, and the number of these."""
    zeros = ir.Constant(_MARKS, [0] * COMPACTION_SIZE)
    mask = builder.icmp_unsigned("!=", _load(builder, mark, begin, _MARKS), zeros)
    bits = builder.bitcast(mask, ir.IntType(COMPACTION_SIZE))
    return mask, builder.zext(builder.ctpop(bits), begin.type)


def _compress(builder: Any, row: Any, mask: Any) -> Any:
    """Return a vector whose first elements are those of `row` in the mask."""
    kind = ir.FunctionType(_ROWS, [_ROWS, _MASK, _ROWS])
    name = f"llvm.experimental.vector.compress.v{COMPACTION_SIZE}i32"
    compress = _declare(builder.module, kind, name)
    return builder.call(compress, [row, mask, ir.Constant(_ROWS, ir.Undefined)])


def _first(builder: Any, number: Any) -> Any:
    """Return the mask of the first `number` elements."""
    numbers = ir.Constant(_ROWS, list(range(COMPACTION_SIZE)))
    return builder.icmp_unsigned(
        "<", numbers, broadcast(builder, builder.trunc(number, _INT), COMPACTION_SIZE)
    )


def _store_first(builder: Any, row: Any, number: Any, out: Any, count: Any) -> None:
    """Store the first `number` elements of a vector to `out[count:]`."""
    mask = _first(builder, number)
    pointer = builder.bitcast(builder.gep(out, [count]), _ROWS.as_pointer())
    kind = ir.FunctionType(ir.VoidType(), [_ROWS, pointer.type, _INT, _MASK])
    name = f"llvm.masked.store.v{COMPACTION_SIZE}i32.p0"
    store = _declare(builder.module, kind, name)
    builder.call(store, [row, pointer, ir.Constant(_INT, 4), mask])
