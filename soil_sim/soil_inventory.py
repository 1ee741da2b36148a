"""Kind and moisture of the soil held by each machine, from its excavate and deposit rows.

Each machine reports the volume that it holds. Only the soil needs its kind and moisture: it
deposits the soil of a machine that has left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.rows import ConversionKind, Rows, machine_ids_in
from msg_bridge.kernels import kernel

__all__ = ["SoilInventory"]

_MAX_SOIL_TYPES = 256

_EXCAVATE, _REJECT = int(ConversionKind.EXCAVATE), int(ConversionKind.REJECT)


class _MachineInventory(NamedTuple):
    """Soil of one machine, by kind.

    Attributes:
        volume: bank volume [mm^3], shape (256,), int64.
        water: bank volume times moisture [mm^3 %], shape (256,), int64.
    """

    volume: NDArray[np.int64]
    water: NDArray[np.int64]


class SoilInventory:
    """Kind and moisture of the soil that each machine excavated and has not deposited again."""

    def __init__(self) -> None:
        self._inventories: dict[int, _MachineInventory] = {}

    def record_conversions(self, conversions: Rows) -> None:
        """Add what CONVERSION rows of any machines excavated, and subtract what they deposited."""
        for machine_id in machine_ids_in(conversions):
            inventory = self._inventories.get(machine_id)
            if inventory is None:
                inventory = self._inventories[machine_id] = _MachineInventory(
                    *np.zeros((2, _MAX_SOIL_TYPES), dtype=np.int64)
                )
            _record(conversions, machine_id, inventory)

    def majority_soil(self, machine_id: int) -> tuple[int, int]:
        """Return the kind and moisture that represent all soil that a machine holds.

        Returns:
            (id of the kind with the largest volume, mean moisture by volume of all kinds [%]);
            (0, 0) if the machine holds nothing.
        """
        inventory = self._inventories.get(machine_id)
        volume = 0 if inventory is None else int(inventory.volume.sum())
        if inventory is None or volume <= 0:
            return 0, 0
        moisture = round(int(inventory.water.sum()) / volume)
        return int(inventory.volume.argmax()), min(max(moisture, 0), MOISTURE_LEVELS - 1)

    def remove(self, machine_id: int) -> None:
        """Discard what a machine held: its session has ended, and the next one begins empty."""
        self._inventories.pop(machine_id, None)


@kernel
def _record(conversions, machine_id, inventory):  # type: ignore[no-untyped-def]
    """Apply the conversions of one machine to its inventory."""
    for n in range(conversions.size):
        row = conversions[n]
        if row.machine_id != machine_id or row.kind == _REJECT:
            continue
        volume = np.int64(row.volume_mm3)
        if row.kind != _EXCAVATE:
            volume = -volume
        inventory.volume[row.soil] += volume
        inventory.water[row.soil] += volume * row.moisture
