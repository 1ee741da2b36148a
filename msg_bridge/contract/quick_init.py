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

    Raises:
        TypeError: the class has a `__post_init__` or slots, or a field with a default factory or
            without a parameter: this constructor would ignore them.
    """
    if hasattr(of, "__post_init__") or "__slots__" in vars(of):
        raise TypeError(f"{of.__name__} has a __post_init__ or slots, which quick_init ignores")
    defaults: dict[str, Any] = {}
    parameters, names = [], []
    for field in fields(of):  # type: ignore[arg-type]
        if field.default_factory is not MISSING or not field.init:
            raise TypeError(f"quick_init makes no constructor for the field {field.name}")
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
