"""Digests of the code that a kernel uses, by which the kernel cache detects changes.

The digest of a module is that of its Python bytecode and of the bytecode of all modules that it
imports, directly or indirectly. Comments, docstrings and line numbers are not part of it, so
editing prose does not recompile anything.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import pkgutil
import sys
import sysconfig
from collections.abc import Collection
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import CodeType
from typing import Any

import numba

__all__ = ["CodeDigests"]

_LIBRARY_FOLDERS = frozenset({"site-packages", "dist-packages"})

_STANDARD_LIBRARY = [Path(sysconfig.get_path(each)).resolve() for each in ("stdlib", "platstdlib")]


class CodeDigests:
    """Digests of modules together with the modules they import, installed libraries excepted.

    Every module is read once: changes of files after that are not detected.
    """

    def __init__(self, packages: Collection[str]) -> None:
        """
        Args:
            packages: names of the top-level packages whose modules import, of all that counts, only
                each other. Modules of others, as of tests and users' scripts, also import code of
                their own. Installed libraries are identified by the Numba version alone.
        """
        self._packages = frozenset(packages)
        self._is_own: dict[str, bool] = {}
        self._codes: dict[str, CodeType | None] = {}
        self._imported: dict[str, set[str]] = {}
        self._submodules: dict[str, set[str]] = {}
        self._own_digests: dict[str, bytes] = {}
        self._digests: dict[str, bytes] = {}

    def digest(self, module: str) -> bytes:
        """Return the SHA-256 of the bytecode of a module and of all modules it imports."""
        if module not in self._digests:
            self._digests[module] = self._compute_digest(module)
        return self._digests[module]

    def _compute_digest(self, module: str) -> bytes:
        digest = hashlib.sha256(numba.__version__.encode())
        for name in sorted(self._import_closure(module)):
            digest.update(name.encode())
            digest.update(self._own_digest(name))
        return digest.digest()

    def _import_closure(self, module: str) -> set[str]:
        closure: set[str] = set()
        pending = [module]
        while pending:
            name = pending.pop()
            if name not in closure:
                closure.add(name)
                pending += self._imports(name)
        return closure

    def _imports(self, module: str) -> set[str]:
        """Return the modules that a module imports anywhere in it."""
        if module not in self._imported:
            code = self._code(module)
            names = set() if code is None else _names_in(code)
            packages: set[str] = set()  # from which an import may be relative
            if _top_level(module) in self._packages:
                dotted = {name for name in names if _top_level(name) in self._packages}
            else:
                packages = _packages_around(module)
                dotted = {name for name in names if self._is_own_code(_top_level(name))}
            # In `from package import module` the bytecode names the module without its package.
            dotted |= {
                f"{package}.{name}"
                for package in dotted | packages
                for name in self._submodules_of(package) & names
            }
            self._imported[module] = {name for name in dotted if self._code(name) is not None}
        return self._imported[module]

    def _is_own_code(self, name: str) -> bool:
        """Return whether there is a module of a name at the top level, of no installed library."""
        if name not in self._is_own:
            self._is_own[name] = name in self._packages or not _is_installed(_find_spec(name))
        return self._is_own[name]

    def _submodules_of(self, package: str) -> set[str]:
        """Return the names of the modules in the folder of a package; none for other names."""
        if package not in self._submodules:
            spec = _find_spec(package)
            folders = (spec and spec.submodule_search_locations) or ()
            self._submodules[package] = {each.name for each in pkgutil.iter_modules(folders)}
        return self._submodules[package]

    def _code(self, module: str) -> CodeType | None:
        if module not in self._codes:
            self._codes[module] = _load_code(module)
        return self._codes[module]

    def _own_digest(self, module: str) -> bytes:
        if module not in self._own_digests:
            digest, code = hashlib.sha256(), self._code(module)
            if code is not None:
                _add_code(digest, code)
            else:  # typed into an interpreter
                digest.update(os.urandom(32))
            self._own_digests[module] = digest.digest()
        return self._own_digests[module]


def _load_code(module: str) -> CodeType | None:
    """Return the bytecode of a module, from its `.pyc` file if that is current; None if it has
    none."""
    spec = _find_spec(module)
    loader: Any = spec.loader if spec else None
    try:
        code: CodeType | None = loader.get_code(module)
    except (ImportError, AttributeError):  # a script, or a test whose assertions pytest rewrites
        file = getattr(sys.modules.get(module), "__file__", None)
        return compile(Path(file).read_bytes(), file, "exec", dont_inherit=True) if file else None
    return code


def _find_spec(module: str) -> ModuleSpec | None:
    """Return where a module is imported from; None for a script, or if there is no such module."""
    try:
        return importlib.util.find_spec(module)
    except (ImportError, AttributeError, ValueError):
        return None


def _is_installed(spec: ModuleSpec | None) -> bool:
    """Return whether a module is part of Python or of an installed library, or is not there."""
    if spec is None:
        return True
    folders = [*(spec.submodule_search_locations or ())]
    if not folders and spec.origin in (None, "built-in", "frozen"):
        return True
    path = Path(folders[0] if folders else str(spec.origin)).resolve()
    return not _LIBRARY_FOLDERS.isdisjoint(path.parts) or any(
        path.is_relative_to(each) for each in _STANDARD_LIBRARY
    )


def _packages_around(module: str) -> set[str]:
    """Return the package that a module is in, and those around that one."""
    package = getattr(sys.modules.get(module), "__package__", None) or module.rpartition(".")[0]
    parts = package.split(".") if package else []
    return {".".join(parts[: k + 1]) for k in range(len(parts))}


def _top_level(module: str) -> str:
    return module.partition(".")[0]


def _names_in(code: CodeType) -> set[str]:
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _names_in(constant)
    return names


def _add_code(digest: Any, code: CodeType) -> None:
    """Add everything that determines the behaviour of code: of strings, only those without spaces.

    A string with a space is prose, as docstrings are; one without may be a name.
    """
    digest.update(repr((code.co_code, code.co_names, code.co_varnames, code.co_freevars)).encode())
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _add_code(digest, constant)
        elif not (isinstance(constant, str) and " " in constant):
            digest.update(_canonical(constant).encode())


def _canonical(constant: Any) -> str:
    """Return a text of a constant that is the same in every process.

    The order of a set of strings depends on the hash seed of the process.
    """
    if isinstance(constant, frozenset):
        return f"frozenset({sorted(map(_canonical, constant))})"
    if isinstance(constant, tuple):
        return f"tuple({[_canonical(each) for each in constant]})"
    return repr(constant)
