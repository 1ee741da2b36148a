"""Tables of arrays that are converted for kernels once, not in each call.

Numba converts each array of a NamedTuple whenever the tuple is passed to a kernel, which takes 0.1
to 0.2 microseconds per array: for the tables of a simulation as long as all of the Python code of a
step. A boxed table is passed in half a microsecond.
"""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import Any

from numba import types
from numba.experimental import structref

from msg_bridge.kernels.decorators import kernel

__all__ = ["BoxedTable", "box_table"]

_unliteral: Any = types.unliteral  # without stubs
_define_proxy: Any = structref.define_proxy


@structref.register
class _BoxedTableType(types.StructRef):
    """Numba type of a `BoxedTable`."""

    def preprocess_fields(self, fields: Any) -> Any:
        """Return the fields with general types in place of literal ones."""
        return tuple((name, _unliteral(kind)) for name, kind in fields)


class BoxedTable(structref.StructRefProxy):
    """A NamedTuple of arrays for kernels, which get it by the attribute `table`.

    It refers to the arrays, and must be made again when one of them is replaced.

    Attributes:
        source: the NamedTuple.
    """

    source: Any

    def __reduce__(self) -> tuple[Any, tuple[Any]]:
        """Pickle as the NamedTuple of arrays: of the memory only addresses are known here."""
        return box_table, (self.source,)


_define_proxy(BoxedTable, _BoxedTableType, ["table"])


def box_table(table: Any) -> BoxedTable:
    """Return the `BoxedTable` of a NamedTuple of arrays and numbers, nested ones included."""
    table_type: Any = type(table)
    boxed: BoxedTable = _boxing_kernel(table_type)(table)
    boxed.source = table
    return boxed


@cache
def _boxing_kernel(table_type: Any) -> Any:
    """Return the kernel that boxes tables of one type.

    With one kernel for all types, a process would import the types of all programs that have filled
    the cache: machines, and their physics engine, in a soil node.
    """
    name = f"{_box.__name__}_{table_type.__module__}_{table_type.__qualname__}".replace(".", "_")
    function = FunctionType(_box.__code__, _box.__globals__, name)
    function.__qualname__, function.__module__ = name, _box.__module__
    return kernel(function)


def _box(table):  # type: ignore[no-untyped-def]
    return BoxedTable(table)  # type: ignore[no-untyped-call]
