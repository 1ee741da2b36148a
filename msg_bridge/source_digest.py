"""A digest of the source of this software, by which recordings and saved states name it.

The version alone does not: between two releases the code changes with every commit.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterable
from functools import cache
from pathlib import Path

__all__ = ["digest_of_sources", "source_digest"]

_PACKAGES = ("earthmoving_sim", "machine_sim", "msg_bridge", "soil_sim")
"""Packages whose code determines the result of a run, or whose objects are in saved states."""

_NUM_DIGITS = 12


@cache
def source_digest() -> str:
    """Return the digest of the source of the packages that compute a run, as it is at this call."""
    folders: list[Path] = []
    for name in _PACKAGES:
        spec = importlib.util.find_spec(name)
        folders += map(Path, (spec and spec.submodule_search_locations) or ())
    return digest_of_sources(folders)


def digest_of_sources(folders: Iterable[Path]) -> str:
    """Return the SHA-256 of the Python files in some folders, cut to 12 hexadecimal digits."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            content = path.read_bytes()
            place = path.relative_to(folder.parent).as_posix()
            digest.update(f"{place} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:_NUM_DIGITS]
