"""JSON objects with fixed names and types, for messages that contain text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode

__all__ = ["parse_json_object"]


def parse_json_object(text: str, types: Mapping[str, type], content: str) -> dict[str, Any]:
    """Return the values of the known names of a JSON object; other names are left out.

    Args:
        text: the JSON.
        types: type of the value of each known name. A bool is not an int.
        content: what the text should contain, for the error message.

    Raises:
        CodecError: JSON: not JSON, not an object, a name is missing or has another type.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CodecError(f"{content} must be JSON: {error}", ErrorCode.JSON) from None
    if not isinstance(found, dict) or any(
        type(found.get(name)) is not kind for name, kind in types.items()
    ):
        wanted = ", ".join(f"{name} ({kind.__name__})" for name, kind in types.items())
        raise CodecError(
            f"{content} must be a JSON object of {wanted}; it is {text!r}", ErrorCode.JSON
        )
    return {name: found[name] for name in types}
