"""Working memory of a step, kept from step to step."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.body_records import BODY_RECORD_SIZE, FORCE_RECORD_SIZE

__all__ = ["StepBuffers"]


class StepBuffers:
    """Arrays with a row for each particle and each tool, and spare capacity.

    Attributes:
        body_records: float32 records of the bodies, see `body_records`.
        force_sums: sums of contact forces, see `body_records`.
    """

    def __init__(self) -> None:
        self._allocate(0)

    def reserve(self, count: int) -> bool:
        """Make room for `count` rows; return whether that cleared the arrays."""
        if len(self.body_records) >= count:
            return False
        self._allocate(max(count, 2 * len(self.body_records)))
        return True

    def _allocate(self, count: int) -> None:
        self.body_records = np.zeros((count, BODY_RECORD_SIZE), np.float32)
        self.force_sums = np.zeros((count, FORCE_RECORD_SIZE), np.float32)
