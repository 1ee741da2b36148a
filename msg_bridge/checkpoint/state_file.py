"""A file with the state of a simulation: a line that describes it, and the state, compressed.

The file is complete or it is not there: it is written beside its place and then renamed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msg_bridge.checkpoint.state_pickle import dump_state, load_state
from msg_bridge.codec.run_config import versions
from msg_bridge.contract.errors import EarthmovingError

__all__ = ["StateFileError", "load_state_file", "save_state_file"]

_FORMAT = "earthmoving_sim state 3"
_MAX_LINE = 1 << 16


class StateFileError(EarthmovingError):
    """A file is not the state of a simulation that can be continued here."""


def save_state_file(path: Path, state: Any, about: Mapping[str, Any]) -> None:
    """Write a state.

    Args:
        path: the file; an existing one is replaced.
        state: a graph of objects, see `state_pickle`.
        about: what it is the state of, for `load_state_file`; values for JSON.

    Raises:
        StateFileError: the file cannot be written.
    """
    content = dump_state(state)
    line = {
        "format": _FORMAT,
        "sha256": hashlib.sha256(content).hexdigest(),
        "versions": versions(),
        **about,
    }
    part = path.with_name(f"{path.name}.part")
    try:
        part.write_bytes(json.dumps(line).encode() + b"\n" + content)
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise StateFileError(f"{path} cannot be written ({error}); give another path") from error


def load_state_file(path: Path, about: Mapping[str, Any]) -> Any:
    """Return the state in a file; load only files that you have written, as of pickle.

    Args:
        path: the file.
        about: what it must be the state of: values that it was saved with.

    Raises:
        StateFileError: no such file, another format or version, a damaged file, or the state of
            something else.
    """
    try:
        first, _, content = path.read_bytes().partition(b"\n")
    except OSError as error:
        raise StateFileError(f"{path} cannot be read ({error}); give a file of --save") from error
    try:
        line = json.loads(first[:_MAX_LINE])
    except ValueError:
        line = {}
    if not isinstance(line, dict) or line.get("format") != _FORMAT:
        raise StateFileError(f"{path} is no state of a simulation; give a file of --save")
    if line.get("sha256") != hashlib.sha256(content).hexdigest():
        raise StateFileError(f"{path} is truncated or damaged; save the state again")
    if line.get("versions") != versions():
        raise StateFileError(
            f"{path} was saved with {line.get('versions')}, and this is {versions()}; save the"
            " state again with this version"
        )
    for name, value in about.items():
        if line.get(name) != value:
            raise StateFileError(
                f"{path} is the state of {name} {line.get(name)}, not of {name} {value}; give the"
                " state of this run"
            )
    try:
        return load_state(content)
    except (pickle.UnpicklingError, AttributeError, ImportError, TypeError) as error:
        raise StateFileError(
            f"{path} was saved by other code of the same version ({error}); save the state again"
        ) from error
