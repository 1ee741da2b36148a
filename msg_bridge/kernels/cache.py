"""A cache of compiled Numba kernels that is invalidated by every change of the code they use.

Numba's own cache is keyed by the file that a kernel is in. It does not detect a change in another
file whose functions or constants the kernel uses, and would run the old machine code. Here the key
of a kernel is a digest of the code of its module and of all that it imports; see `CodeDigests`.
"""

from __future__ import annotations

import fcntl
import hashlib
import tempfile
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from numba import types
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)
from numba.core.runtime.nrt import rtsys

from msg_bridge.kernels.code_digests import CodeDigests
from msg_bridge.kernels.compilation import kernel_state
from msg_bridge.kernels.linking_bitcode import parse_when_linked

__all__ = ["KernelFiles", "cached"]


def cached(kernel: Any) -> Any:
    """Make a dispatcher, as returned by `numba.njit`, keep its machine code between processes."""
    kernel._cache = _KernelCache(kernel.py_func)
    if not kernel.targetoptions.get("parallel"):  # these are for an option: more than one thread
        kernel_state.kernels[kernel._cache.kernel_name] = kernel._cache.cache_path
    return kernel


_DIGESTS = CodeDigests({"soil_sim", "machine_sim", "msg_bridge"})


@cache
def _ensure_writable(folder: str) -> None:
    """Create a folder if it is missing, and check once that files can be created in it.

    Raises:
        OSError: they cannot.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()


class _DigestStamp:
    """Cache locator whose source stamp is the digest of the code, not the time of its file."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[call-arg]
        self._module = str(py_func.__module__)

    def ensure_cache_path(self) -> None:
        _ensure_writable(self.get_cache_path())  # type: ignore[attr-defined]

    def get_source_stamp(self) -> bytes:
        return _DIGESTS.digest(self._module)

    def get_disambiguator(self) -> str:
        # Numba's default, the line number, changes with every docstring above. Names are unique in
        # a module.
        return ""


class _UserProvided(_DigestStamp, UserProvidedCacheLocator):
    """Locator of the folder that the environment variable `NUMBA_CACHE_DIR` names."""


class _InTree(_DigestStamp, InTreeCacheLocator):
    """Locator of the `__pycache__` folder next to the module."""


class _UserWide(_DigestStamp, UserWideCacheLocator):
    """Locator of the user's cache folder, for an installation that is not writable."""


class KernelFiles(IndexDataCacheFile):
    """The files of one kernel: machine code by signature, and their index.

    Numba numbers the files by what is in the index, which it writes before the machine code. Two
    processes that compile a kernel for different signatures at the same time then take the same
    number, and one runs the machine code of the other. Here a file is named by its signature and
    the code of the kernel, is there before the index names it, and one process writes at a time.
    """

    def save(self, key: Any, data: Any) -> None:
        """Save the machine code of a signature, and remove what no signature uses any more."""
        folder = Path(self._cache_path)
        digest = hashlib.sha256(self._dump((self._source_stamp, key))).hexdigest()[:16]  # type: ignore[no-untyped-call]
        name = self._data_name_pattern.replace("{number:d}", digest)
        with (folder / f"{self._index_name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file is closed
            self._save_data(name, data)  # type: ignore[no-untyped-call]
            overloads = self._load_index()  # type: ignore[no-untyped-call]
            overloads[key] = name
            self._save_index(overloads)  # type: ignore[no-untyped-call]
            used = set(overloads.values())
            for path in folder.glob(self._data_name_pattern.replace("{number:d}", "*")):
                if path.name not in used:
                    path.unlink(missing_ok=True)


class _KernelCacheImpl(CompileResultCacheImpl):
    _locator_classes = [_UserProvided, _InTree, _UserWide]  # noqa: RUF012

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the kernel of a cache entry."""
        result = super().rebuild(target_context, payload)  # type: ignore[no-untyped-call]
        _, kind, code = payload[0]
        if kind == "object":  # with the bitcode for linking
            parse_when_linked(result.library, code[1])
        return result


class _KernelCache(FunctionCache):
    _impl_class = _KernelCacheImpl

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)  # type: ignore[no-untyped-call]
        self._cache_file = KernelFiles(  # type: ignore[no-untyped-call]
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )
        self.kernel_name = f"{py_func.__module__}.{py_func.__qualname__}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for a signature; None if it must be compiled.

        Numba reads the types of an old entry before its stamp. If one of them, a NamedTuple for
        example, was renamed or moved since, that fails, and the entry is discarded.
        """
        result = self._load(sig, target_context)
        if result is None:
            kernel_state.start(self.kernel_name)
        else:
            kernel_state.ready.add(self.kernel_name)
        return result

    def _load(self, sig: Any, target_context: Any) -> Any:
        # The method of the base class also sets up type inference, which only compilation needs.
        rtsys.initialize(target_context)
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except (AttributeError, ImportError):
            self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the machine code for a signature, which was compiled just now."""
        super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        kernel_state.end(self.kernel_name)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return the key of the machine code for a signature.

        Numba identifies a NamedTuple by its name and the types of its fields. The kernel need not
        import its module, so that a change of the order of the fields would not be detected.
        """
        key = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, tuple(_named_fields(sig)))


def _named_fields(argument_types: Iterable[Any]) -> Iterator[tuple[str, ...]]:
    """Yield the field names of each NamedTuple among Numba types, nested ones included."""
    for each in argument_types:
        if isinstance(each, types.BaseNamedTuple):
            yield each.fields  # type: ignore[attr-defined]
        if isinstance(each, types.BaseTuple):
            yield from _named_fields(each)  # type: ignore[arg-type]
