"""How a user records a run from its begin, which audit and replay need."""

from __future__ import annotations

__all__ = ["RECORD_FROM_BEGIN"]

RECORD_FROM_BEGIN = (
    "record from the begin of the run, with required_subscribers: [exchange_recorder] of soil and"
    " machine nodes"
)
"""What to change if a bag lacks the begin of a run; the end of an error's text."""
