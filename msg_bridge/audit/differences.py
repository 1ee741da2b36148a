"""Describe a difference over many ticks in one finding."""

from __future__ import annotations

import numpy as np

from msg_bridge.audit.numbered_rows import Numbers
from msg_bridge.audit.report import Check, Finding

__all__ = ["difference_finding"]


def difference_finding(
    check: Check, subject: str, ticks: Numbers, difference: Numbers
) -> Finding | None:
    """Return a finding if any difference is not 0, else None.

    Args:
        check: the check that it belongs to.
        subject: start of the sentence, which continues with "by ... mm3".
        ticks: the soil ticks, shape (n,).
        difference: of each tick [mm^3], shape (n,).
    """
    wrong = np.flatnonzero(difference)
    if not wrong.size:
        return None
    first, last = int(ticks[wrong[0]]), int(ticks[wrong[-1]])
    text = f"{subject} by {int(difference[wrong[0]]):+} mm3 in tick {first}"
    if wrong.size > 1:
        largest = int(difference[wrong[np.argmax(np.abs(difference[wrong]))]])
        text += f", and in {wrong.size} ticks up to {last}, at most by {largest:+} mm3"
    return Finding(check, text, first, last)
