"""LLVM vectors of array elements, for intrinsics of kernels.

Numba has no vector types: where the compiler does not vectorise a loop, or not well, an intrinsic
(`numba.extending.intrinsic`) is written as LLVM instructions on vectors. The compiler splits a
vector where the processor has narrower ones.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types

__all__ = ["broadcast", "data_pointers", "load_vector", "store_vector"]


def data_pointers(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
    """Return the arguments, with the data pointer of each array in its place, and None for None."""
    values: list[Any] = []
    for kind, value in zip(signature.args, arguments, strict=True):
        if isinstance(kind, types.Array):
            value = context.make_array(kind)(context, builder, value).data
        values.append(None if kind == types.none else value)
    return values


def load_vector(builder: Any, data: Any, begin: Any, kind: Any, align: int) -> Any:
    """Return the elements of an array from `begin` on as a vector.

    Args:
        builder: LLVM builder.
        data: data pointer of the array.
        begin: number of the first element, an LLVM integer.
        kind: type of the vector.
        align: alignment of the elements [bytes].
    """
    pointer = builder.bitcast(builder.gep(data, [begin]), kind.as_pointer())
    return builder.load(pointer, align=align)


def store_vector(builder: Any, vector: Any, data: Any, begin: Any, align: int) -> None:
    """Write a vector to an array from element `begin` on; arguments as of `load_vector`."""
    pointer = builder.bitcast(builder.gep(data, [begin]), vector.type.as_pointer())
    builder.store(vector, pointer, align=align)


def broadcast(builder: Any, value: Any, size: int) -> Any:
    """Return a vector with a value in each of `size` elements."""
    undefined = ir.Constant(ir.VectorType(value.type, size), ir.Undefined)
    index = ir.IntType(32)
    first = builder.insert_element(undefined, value, ir.Constant(index, 0))
    zeros = ir.Constant(ir.VectorType(index, size), [0] * size)
    return builder.shuffle_vector(first, undefined, zeros)
