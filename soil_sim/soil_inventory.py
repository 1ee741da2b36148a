"""What the soil that machines hold is like, by the rows that gave it to them and took it back.

How much a machine holds is told by its own reports; of which kind it is, and how moist, only the
soil needs to know, for when it puts down what a machine has left behind.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import ConversionKind, Rows, machine_ids_in
from msg_bridge.kernels import kernel

__all__ = ["SoilInventory"]

_MAX_SOIL_TYPES = 256

_EXCAVATE, _REFUSE = int(ConversionKind.EXCAVATE), int(ConversionKind.REJECT)


class _MachineInventory(NamedTuple):
    """One source's soil by kind, shape (256,): bank volume [mm^3] and water [mm^3 %]."""

    volume: NDArray[np.int64]
    water: NDArray[np.int64]


class SoilInventory:
    """Kind and moisture of what each source was given and has not put down again."""

    def __init__(self) -> None:
        self._inventories: dict[int, _MachineInventory] = {}

    def record_conversions(self, conversions: Rows) -> None:
        """Count what CONVERSION rows of any sources moved."""
        for machine_id in machine_ids_in(conversions):
            held = self._inventories.get(machine_id)
            if held is None:
                held = self._inventories[machine_id] = _MachineInventory(
                    *np.zeros((2, _MAX_SOIL_TYPES), dtype=np.int64)
                )
            _record(conversions, machine_id, *held)

    def majority_soil(self, machine_id: int) -> tuple[int, int]:
        """Soil that stands for all that a source holds.

        Returns:
            (id of the kind that most of it is, moisture of the whole by volume [%]); 0, 0 if it
            holds nothing.
        """
        held = self._inventories.get(machine_id)
        volume = 0 if held is None else int(held.volume.sum())
        if held is None or volume <= 0:
            return 0, 0
        moisture = round(int(held.water.sum()) / volume)
        return int(held.volume.argmax()), min(max(moisture, 0), 100)


@kernel
def _record(conversions, machine_id, volume, water):  # type: ignore[no-untyped-def]
    """Count one source's conversions by kind."""
    for n in range(conversions.size):
        row = conversions[n]
        if row.machine_id != machine_id or row.kind == _REFUSE:
            continue
        moved = np.int64(row.volume_mm3)
        if row.kind != _EXCAVATE:
            moved = -moved
        volume[row.soil] += moved
        water[row.soil] += moved * row.moisture
