"""A cache of compiled Numba kernels that notices every change of the code they were made from.

Numba's own cache is keyed by the file that a kernel is in. It does not notice a change in another
file whose functions or constants the kernel uses, and would run the old machine code. Here the key
of a kernel is a digest of the Python bytecode of its module and of all modules of this project that
it imports, directly or not. Comments, docstrings and line numbers are not part of it, so editing
prose compiles nothing.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

__all__ = ["cached", "module_digest"]

_PACKAGES = frozenset({"soil_sim", "machine_sim", "msg_bridge"})
"""Packages whose modules kernels may import."""


def cached(kernel: Any) -> Any:
    """Let a dispatcher, as returned by `numba.njit`, keep its machine code between processes."""
    kernel._cache = _KernelCache(kernel.py_func)  # type: ignore[no-untyped-call]
    return kernel


def module_digest(module: str) -> bytes:
    """Return the SHA-256 of the bytecode of a module and of all project modules it imports."""
    digest = hashlib.sha256(numba.__version__.encode())
    for name in sorted(_import_closure(module)):
        digest.update(name.encode())
        digest.update(_code_digest(name))
    return digest.digest()


def _import_closure(module: str) -> set[str]:
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _imports(name)
    return found


@cache
def _code(module: str) -> CodeType | None:
    """Bytecode of a module, from its `.pyc` file where that is current; None if it has none."""
    try:
        spec = importlib.util.find_spec(module)
        loader: Any = spec.loader if spec else None
        code: CodeType | None = loader.get_code(module)
    except (ImportError, AttributeError, ValueError):  # no such module, or a script
        return None
    return code


@cache
def _imports(module: str) -> frozenset[str]:
    """Project modules that a module imports anywhere in it."""
    code = _code(module)
    if code is None:
        return frozenset()
    names = _names_in(code)
    dotted = {name for name in names if name.partition(".")[0] in _PACKAGES}
    # `from package import module` names the module apart from its package.
    dotted |= {f"{package}.{name}" for package in dotted for name in names if "." not in name}
    return frozenset(name for name in dotted if _code(name) is not None)


def _names_in(code: CodeType) -> set[str]:
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names_in(constant)
    return names


@cache
def _code_digest(module: str) -> bytes:
    code, digest = _code(module), hashlib.sha256()
    if code is not None:
        _add_code(digest, code)
    else:  # a script or a test, which no import finds
        file = getattr(sys.modules.get(module), "__file__", None)
        digest.update(Path(file).read_bytes() if file else os.urandom(32))
    return digest.digest()


def _add_code(digest: Any, code: CodeType) -> None:
    """Add all that decides what code does; of texts, only those that can be names."""
    digest.update(repr((code.co_code, code.co_names, code.co_varnames, code.co_freevars)).encode())
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _add_code(digest, constant)
        elif not (isinstance(constant, str) and " " in constant):
            digest.update(repr(constant).encode())


class _DigestStamp:
    """Makes a digest of the code the stamp that decides whether a cache entry is current."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[call-arg]
        self._module = str(py_func.__module__)

    def get_source_stamp(self) -> bytes:
        return module_digest(self._module)

    def get_disambiguator(self) -> str:
        # Not the line number: it changes with every docstring above. Names are unique in a module.
        return ""


class _UserProvided(_DigestStamp, UserProvidedCacheLocator):
    """In the folder that `NUMBA_CACHE_DIR` names."""


class _InTree(_DigestStamp, InTreeCacheLocator):
    """In `__pycache__` beside the module."""


class _UserWide(_DigestStamp, UserWideCacheLocator):
    """In the user's cache folder, for an installation that is not writable."""


class _KernelCacheImpl(CompileResultCacheImpl):
    _locator_classes = [_UserProvided, _InTree, _UserWide]  # noqa: RUF012


class _KernelCache(FunctionCache):
    _impl_class = _KernelCacheImpl
