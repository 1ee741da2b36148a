"""A difference over many ticks, told in one sentence."""

from __future__ import annotations

import numpy as np

from msg_bridge.audit.numbered_rows import Numbers
from msg_bridge.audit.report import Check, Finding

__all__ = ["difference_finding"]


def difference_finding(
    check: Check, what: str, ticks: Numbers, difference: Numbers
) -> Finding | None:
    """A finding if any difference [mm^3] is not 0.

    Args:
        check: which it belongs to.
        what: the sentence's beginning.
        ticks, difference: of each tick, shape (n,).
    """
    wrong = np.flatnonzero(difference)
    if not wrong.size:
        return None
    first, last = int(ticks[wrong[0]]), int(ticks[wrong[-1]])
    text = f"{what} by {int(difference[wrong[0]]):+} mm3 in tick {first}"
    if wrong.size > 1:
        worst = int(difference[wrong[np.argmax(np.abs(difference[wrong]))]])
        text += f", and in {wrong.size} ticks up to {last}, at most by {worst:+} mm3"
    return Finding(check, text, first, last)
