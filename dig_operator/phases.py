"""OperatorPhase: the phases of the operator's tasks."""

from __future__ import annotations

import enum

__all__ = ["OperatorPhase"]


class OperatorPhase(str, enum.Enum):
    """Phase of an operator's task; the value is its name in topics, diagnostics and pictures."""

    # Excavator, `DigTask`: drive to the dig, then wait a fixed time while the base rocks.
    APPROACH = "approach"
    BRACE = "brace"
    # Excavator, `DigCycle`, in this order.
    REACH = "reach"
    DIG = "dig"
    CURL = "curl"
    LIFT = "lift"
    WAIT = "wait"  # with a full bucket, until the dump is ready
    SWING = "swing"
    DUMP = "dump"
    # Excavator, `DigTask`, between two cycles: lift the bucket, and drive to the next station;
    # then `BRACE`.
    STOW = "stow"
    RETREAT = "retreat"
    # Excavator, `DigTask`: wait until all soil is at rest.
    SETTLE = "settle"
    # Road header, `FaceCuttingTask`.
    START = "start"
    SUMP = "sump"
    SLEW = "slew"
    RISE = "rise"
    LOWER = "lower"
    BACK = "back"
    # Dumper, `HaulTask`, between APPROACH and LOWER.
    SPOT = "spot"
    LOAD = "load"
    HAUL = "haul"
    TIP = "tip"  # after BACK
    PULL_OFF = "pull_off"
    # All.
    DONE = "done"

    # As in enum.StrEnum of Python 3.11: print the value and not the member's name.
    def __str__(self) -> str:
        return str(self.value)

    def __format__(self, format_spec: str) -> str:
        return format(self.value, format_spec)
