"""Kernels that are called without Numba's search for the compiled version for the arguments.

For each call Numba determines the type of every argument, which takes 2 microseconds per boxed
table or tuple: with the tables of a simulation several times as long as a short kernel. A kernel of
which there is one version, for arguments that the project's own code makes, needs no search.
"""

from __future__ import annotations

import os
from functools import partial
from typing import Any

from numba import _dispatcher, typeof, types

from msg_bridge.kernels.boxed import BoxedTable
from msg_bridge.kernels.decorators import kernel

__all__ = ["CHECK_VARIABLE", "FixedSignatureKernel", "fixed_signature_kernel"]

CHECK_VARIABLE = "EARTHMOVING_CHECK_KERNEL_ARGUMENTS"
"""Environment variable; if it is not empty, each call checks the types. Tests set it."""


class FixedSignatureKernel(partial[Any]):
    """A kernel whose arguments have the types of the first call in all calls.

    Numbers are converted. Arrays of another data type or memory layout, and other tables, would be
    misread: pass only what the code around the kernel makes itself, no argument of a user's.

    A call raises a TypeError for other types if `CHECK_VARIABLE` is set.

    It is a `partial` without arguments, whose function is replaced after the first call: that calls
    the compiled version from C, where a method would add 60 ns to each call.

    Attributes:
        dispatcher: the kernel, as returned by `kernel`.
    """

    def __init__(self, dispatcher: Any) -> None:
        """
        Args:
            dispatcher: the kernel, as returned by `kernel`.
        """
        self.dispatcher = dispatcher
        self._replace_function(self._compile_and_call)

    def __reduce__(self) -> tuple[type[FixedSignatureKernel], tuple[Any]]:
        """Pickle the kernel: that of a `partial` would pickle a method of this object."""
        return type(self), (self.dispatcher,)

    @property
    def _numba_type_(self) -> Any:
        """Type of this object for Numba, in a kernel that calls it."""
        return self.dispatcher._numba_type_

    def _replace_function(self, function: Any) -> None:
        """Call a function from now on."""
        stateful: Any = self  # typeshed lacks the method
        stateful.__setstate__((function, (), {}, self.__dict__))

    def _compile_and_call(self, *args: Any) -> Any:
        """Call the kernel by its dispatcher, and the compiled version in all later calls."""
        result = self.dispatcher(*args)
        # Kernels that call this one may have compiled other versions of it.
        if os.environ.get(CHECK_VARIABLE):
            self._replace_function(_CheckedCall(self.dispatcher, args))
        else:
            self._replace_function(self.dispatcher.overloads[_types_of(args)].entry_point)
        return result


class _CheckedCall:
    """Calls of a dispatcher that check the types of the arguments.

    Numba takes 20 microseconds to determine a type, and 1 to compute the fingerprints of all
    arguments: the types are compared once for each combination of fingerprints.
    """

    def __init__(self, dispatcher: Any, args: tuple[Any, ...]) -> None:
        self._dispatcher = dispatcher
        self._types = _types_of(args)
        self._accepted = {_fingerprint(args)}

    def __call__(self, *args: Any) -> Any:
        fingerprint = _fingerprint(args)
        if fingerprint not in self._accepted:
            self._check(args)
            self._accepted.add(fingerprint)
        return self._dispatcher(*args)

    def _check(self, args: tuple[Any, ...]) -> None:
        """Raise a TypeError if the types of some arguments are not those of the first call."""
        for k, (kind, first) in enumerate(zip(_types_of(args), self._types, strict=True)):
            if _writable(kind) != _writable(first):
                raise TypeError(
                    f"argument {k} of the kernel {self._dispatcher.py_func.__qualname__} has the"
                    f" type {kind!r} after {first!r}; decorate it with `kernel`, or convert it"
                )


def _fingerprint(value: Any) -> Any:
    """Return what is equal for values of equal types: bytes, a Numba type, or a tuple of these."""
    try:
        return _dispatcher.compute_fingerprint(value)
    except NotImplementedError:
        if isinstance(value, tuple):
            return type(value), tuple(map(_fingerprint, value))
        return value._numba_type_ if isinstance(value, BoxedTable) else type(value)


def _types_of(args: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return Numba's types of some arguments."""
    return tuple(map(typeof, args))


def _writable(kind: Any) -> Any:
    """Return the type of an array that may be written to; a kernel only reads from the others."""
    return kind.copy(readonly=False) if isinstance(kind, types.Array) else kind


def fixed_signature_kernel(function: Any = None, **options: Any) -> Any:
    """Compile a kernel that is called without a search; use as `kernel`."""
    if function is None:
        return lambda function: fixed_signature_kernel(function, **options)
    return FixedSignatureKernel(kernel(function, **options))
