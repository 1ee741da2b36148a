"""Frozen dataclasses that are made several times in a tick.

The constructor of a frozen dataclass sets its fields one by one, through `object.__setattr__`: for
a header 2 microseconds. This one sets all of them at once, in a quarter of the time.
"""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any, TypeVar

__all__ = ["quick_init"]

_Dataclass = TypeVar("_Dataclass")


def quick_init(of: type[_Dataclass]) -> type[_Dataclass]:
    """Give a frozen dataclass a constructor with the same parameters that takes less time.

    Its fields must have no default factories, and it no `__post_init__` and no slots.
    """
    defaults: dict[str, Any] = {}
    parameters, names = [], []
    for field in fields(of):  # type: ignore[arg-type]
        names.append(field.name)
        if field.default is MISSING:
            parameters.append(field.name)
        else:
            defaults[f"_{field.name}"] = field.default
            parameters.append(f"{field.name}=_{field.name}")
    values = ", ".join(f"{name!r}: {name}" for name in names)
    namespace = {**defaults, "_set": object.__setattr__}
    exec(  # as `dataclasses` does; the names are those of a class of this project
        f"def __init__(self, {', '.join(parameters)}):\n    _set(self, '__dict__', {{{values}}})\n",
        namespace,
    )
    init: Any = namespace["__init__"]
    init.__qualname__ = f"{of.__qualname__}.__init__"
    of.__init__ = init  # type: ignore[method-assign]
    return of
