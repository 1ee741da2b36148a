"""Read the definition and the hash of a message type from its installed files.

A ROS package installs `share/<package>/msg/<Name>.msg` with the definition, and next to it
`<Name>.json` with the type hash (REP-2016). A bag contains both, so that reading it needs no ROS.
A few types are known without their package, see `bundled_types`.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from msg_bridge.bag.bundled_types import BUNDLED_TYPES
from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SchemaError", "schema_text", "type_hash"]

_BUILTIN = {
    *("bool", "byte", "char", "float32", "float64", "string", "wstring"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}
_SEPARATOR = "=" * 80  # before every dependency, in the ros2msg encoding of MCAP


class SchemaError(EarthmovingError):
    """The files of a message type are missing or not valid."""


def schema_text(type_name: str) -> str:
    """Return the definition of a type and of all its dependencies, in the encoding `ros2msg`.

    Args:
        type_name: as `std_msgs/msg/String`.

    Raises:
        SchemaError: it is not the name of a message type, or a definition is missing.
    """
    texts = {type_name: _definition(type_name)}
    pending = [type_name]
    while pending:
        user = pending.pop()
        for used in _used_types(user, texts[user]):
            if used not in texts:
                texts[used] = _definition(used)
                pending.append(used)
    own = texts.pop(type_name)
    parts = [own]
    for name, text in texts.items():
        parts.append(f"{_SEPARATOR}\nMSG: {name.replace('/msg/', '/')}\n{text}")
    return "\n".join(part.rstrip("\n") for part in parts) + "\n"


def type_hash(type_name: str) -> str:
    """Return the hash of a type, `RIHS01_` and 64 hexadecimal digits.

    Raises:
        SchemaError: it is not the name of a message type, or the file with its hash is missing.
    """
    try:
        path = _file(type_name, "json")
    except SchemaError:
        if type_name in BUNDLED_TYPES:
            return BUNDLED_TYPES[type_name].type_hash
        raise
    try:
        hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
        named = {each["type_name"]: str(each["hash_string"]) for each in hashes}
        return named[type_name]
    except (ValueError, KeyError, TypeError) as error:
        raise SchemaError(f"{path} has no hash of {type_name}; reinstall its package") from error


def _definition(type_name: str) -> str:
    try:
        return _file(type_name, "msg").read_text(encoding="utf-8")
    except SchemaError:
        if type_name in BUNDLED_TYPES:
            return BUNDLED_TYPES[type_name].definition
        raise


def _used_types(user: str, text: str) -> Iterator[str]:
    """Yield the names of the message types in the fields of a definition, in order."""
    package = user.split("/")[0]
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if not words:
            continue
        # The type precedes its bounds: `pkg/Name[<=3] field`, `string<=10 field`.
        kind = re.split(r"\[|<=", words[0])[0]
        if kind in _BUILTIN:  # so are the types of constants
            continue
        names = kind.split("/")
        yield f"{names[0] if len(names) > 1 else package}/msg/{names[-1]}"


def _file(type_name: str, suffix: str) -> Path:
    """Return the file of a type under the first prefix that has it."""
    parts = type_name.split("/")
    if len(parts) != 3 or parts[1] != "msg" or not all(parts):
        raise SchemaError(
            f"{type_name!r} is not a message type; give a name like std_msgs/msg/Bool"
        )
    prefixes = [
        *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)),
        sys.prefix,
    ]
    paths = [Path(each, "share", parts[0], "msg", f"{parts[2]}.{suffix}") for each in prefixes]
    for path in paths:
        if path.is_file():
            return path
    searched = "".join(f"\n  {path}" for path in paths)
    raise SchemaError(
        f"{type_name} is not installed; install {parts[0]} or source its workspace."
        f" Searched for:{searched}"
    )
