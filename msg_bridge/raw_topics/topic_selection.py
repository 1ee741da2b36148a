"""Select topics by regular expressions."""

from __future__ import annotations

import re

from msg_bridge.contract.errors import ParameterError

__all__ = ["is_topic_selected", "validate_expression"]


def is_topic_selected(topic: str, include: str, exclude: str) -> bool:
    """Return whether a topic matches `include` and not `exclude`.

    Args:
        topic: its name.
        include: regular expression that is found in the name; empty: any name.
        exclude: regular expression that is not found in the name; empty: none.
    """
    if exclude and re.search(exclude, topic):
        return False
    return re.search(include, topic) is not None


def validate_expression(name: str, text: str) -> None:
    """Check a regular expression.

    Args:
        name: name of its parameter.
        text: the expression.

    Raises:
        ParameterError: it is not valid.
    """
    try:
        re.compile(text)
    except re.error as error:
        raise ParameterError(
            f"{name} is {text!r}, which is not a regular expression: {error}"
        ) from error
