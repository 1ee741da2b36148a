"""Kind and moisture of the soil in each account, from the excavate and deposit rows of its machine.

Each machine reports the volume that it holds. Only the soil needs its kind and moisture: it
deposits the soil of a machine that has left.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.contract.rows import ConversionKind, Rows, machine_ids_in
from msg_bridge.kernels import fixed_signature_kernel

__all__ = ["SoilInventory"]

_MAX_SOIL_TYPES = 256

_EXCAVATE, _REJECT = int(ConversionKind.EXCAVATE), int(ConversionKind.REJECT)


class _AccountInventory(NamedTuple):
    """Soil of one account, by kind.

    Attributes:
        volume: bank volume [mm^3], shape (256,), int64.
        water: bank volume times moisture [mm^3 %], shape (256,), int64.
    """

    volume: NDArray[np.int64]
    water: NDArray[np.int64]


class SoilInventory:
    """Kind and moisture of the soil that was excavated and not deposited again, by account."""

    def __init__(self) -> None:
        self._inventories: dict[int, _AccountInventory] = {}  # by number of the account

    def record_conversions(self, conversions: Rows, accounts: Mapping[int, int]) -> None:
        """Add what CONVERSION rows excavated, and subtract what they deposited.

        Args:
            conversions: rows of any machines; those of released soil belong to no account.
            accounts: number of the account of each machine that takes part, by machine id.
        """
        for machine_id in machine_ids_in(conversions):
            account = accounts.get(machine_id)
            if account is None:
                continue
            inventory = self._inventories.get(account)
            if inventory is None:
                inventory = self._inventories[account] = _empty_inventory()
            _record(conversions, machine_id, inventory)

    def majority_soil(self, account: int) -> tuple[int, int]:
        """Return the kind and moisture that represent all soil in an account.

        Returns:
            (id of the kind with the largest volume, mean moisture by volume of all kinds [%]);
            (0, 0) if there is none.
        """
        inventory = self._inventories.get(account)
        volume = 0 if inventory is None else int(inventory.volume.sum())
        if inventory is None or volume <= 0:
            return 0, 0
        moisture = round(int(inventory.water.sum()) / volume)
        return int(inventory.volume.argmax()), min(max(moisture, 0), MOISTURE_LEVELS - 1)

    def merge(self, account: int, target: int) -> None:
        """Add the soil of an account to that of another one, and discard the account."""
        inventory = self._inventories.pop(account, None)
        if inventory is None:
            return
        sum_ = self._inventories.setdefault(target, _empty_inventory())
        sum_.volume[:] += inventory.volume
        sum_.water[:] += inventory.water

    def remove(self, account: int) -> None:
        """Discard the soil of an account: it was released."""
        self._inventories.pop(account, None)

    def retain(self, accounts: Container[int]) -> None:
        """Discard the soil of all accounts but these."""
        self._inventories = {n: each for n, each in self._inventories.items() if n in accounts}


def _empty_inventory() -> _AccountInventory:
    return _AccountInventory(*np.zeros((2, _MAX_SOIL_TYPES), dtype=np.int64))


@fixed_signature_kernel
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
