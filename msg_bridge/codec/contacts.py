"""A contact between machines as a JSON string."""

from __future__ import annotations

import json
from collections.abc import Sequence

from std_msgs.msg import String

__all__ = ["to_contact_string"]


def to_contact_string(
    names: Sequence[str],
    *,
    start_time: float,
    end_time: float,
    max_force: float,
    position: Sequence[float],
    is_over: bool,
) -> String:
    """Encode a contact.

    Args:
        names: names of the two machines, or of a machine and a bin.
        start_time, end_time: simulation times of its first and its last force so far [s].
        max_force: maximum of the sum of the normal forces so far [N].
        position: where it was largest [m], map frame, shape (3,).
        is_over: whether the contact has ended.
    """
    fields = {
        "machines": list(names),
        "start_time": round(start_time, 6),
        "end_time": round(end_time, 6),
        "max_force": round(max_force, 1),
        "position": [round(coordinate, 3) for coordinate in position],
        "is_over": is_over,
    }
    return String(data=json.dumps(fields))
