"""The machines' rows of a tick, as the soil processes them."""

from __future__ import annotations

from typing import NamedTuple

from msg_bridge.contract.rows import Rows

__all__ = ["TickInput"]


class TickInput(NamedTuple):
    """Everything the machines sent for one tick. The rows must not be modified.

    Attributes:
        tick: its number; 0 is the welcome, before anything moves.
        sweeps: SWEEP rows, ordered by machine and number.
        deposit_requests: DEPOSIT_REQUEST rows, ordered by machine and number.
    """

    tick: int
    sweeps: Rows
    deposit_requests: Rows
