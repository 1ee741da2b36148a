"""Import foxglove-sdk, which is optional."""

from __future__ import annotations

import importlib
from typing import Any

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["FoxgloveServerError", "load_sdk"]


class FoxgloveServerError(EarthmovingError):
    """The server cannot start."""


def load_sdk() -> Any:
    """Return the module `foxglove`.

    Raises:
        FoxgloveServerError: foxglove-sdk is not installed.
    """
    try:
        return importlib.import_module("foxglove")
    except ImportError as error:
        raise FoxgloveServerError(
            f"foxglove-sdk cannot be imported ({error}); run: pip install foxglove-sdk"
        ) from error
