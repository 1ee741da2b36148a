"""Kernels that change the soil of one column.

They keep the invariants of `soil_sim.columns.state`: volumes are whole mm^3, loose soil is never
denser than bank soil, and the height is that of the volumes. Every kernel takes the `ColumnArrays`
of the terrain and the flat index `i` of the column.
"""

from __future__ import annotations

import numpy as np

from msg_bridge.kernels import helper, kernel

__all__ = [
    "add_loose",
    "compact_loose",
    "firm_top",
    "mix_moisture",
    "pack_firm",
    "packed_depth",
    "remove_firm",
    "remove_from_column",
    "remove_loose",
    "stochastic_round",
    "update_height",
]

_ROUNDING_TOLERANCE = 1e-9
"""Rounding error of a mean moisture of large volumes [%]."""


@helper(forceinline=True)
def firm_top(columns, i):  # type: ignore[no-untyped-def]
    """Return the height of the surface of the firm soil of column i [m]."""
    return columns.floor + (columns.firm[i] - columns.packing[i]) * columns.metres_per_mm3


@helper(forceinline=True)
def packed_depth(columns, i):  # type: ignore[no-untyped-def]
    """Return the thickness of the packed soil at the top of the firm soil of column i [m]."""
    packing = columns.packing[i]
    shrinkage = columns.shrinkage[columns.soil[i]]
    if packing == 0 or shrinkage == 0.0:  # packed before the run continued with another soil
        return 0.0
    return packing * ((1.0 - shrinkage) / shrinkage) * columns.metres_per_mm3


@helper(forceinline=True)
def update_height(columns, i):  # type: ignore[no-untyped-def]
    """Compute the height of column i from its volumes, and mark the column as touched.

    Soil that was added to a rut, or removed from it, makes it less deep by its height.
    """
    before = columns.height[i]
    _set_height(columns, i)
    if columns.rut_volume[i] > 0:
        change = abs(columns.height[i] - before) / columns.metres_per_mm3
        columns.rut_volume[i] -= min(np.int64(change + 0.5), columns.rut_volume[i])


@helper(forceinline=True)
def _set_height(columns, i):  # type: ignore[no-untyped-def]
    """Compute the height of column i from its volumes, and mark the column as touched."""
    volume = columns.firm[i] - columns.packing[i] + columns.bulk[i]
    columns.height[i] = columns.floor + volume * columns.metres_per_mm3
    if columns.is_touched[i] == 0:
        columns.is_touched[i] = 1
        columns.touched[0] += 1
        columns.touched[columns.touched[0]] = i


@helper(forceinline=True)
def stochastic_round(x, key):  # type: ignore[no-untyped-def]
    """Round a mean moisture [%] up with a probability equal to its fraction, else down; uint8.

    `key`, an integer that differs from case to case, is hashed to the random number, so that equal
    arguments give equal results.
    """
    low = np.uint8(x + _ROUNDING_TOLERANCE)
    bits = np.uint64(key)  # finalizer of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    random = ((bits ^ (bits >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53
    return np.uint8(low + (random + _ROUNDING_TOLERANCE < x - low))


@kernel(forceinline=True)
def mix_moisture(bank, moisture, other_bank, other_moisture):  # type: ignore[no-untyped-def]
    """Return the moisture [%] of two volumes [mm^3 bank] of soil mixed, uint8.

    At least one of the volumes must be above 0.
    """
    if other_bank == 0 or moisture == other_moisture:
        return np.uint8(moisture)
    if bank == 0:
        return np.uint8(other_moisture)
    total = bank + other_bank
    return stochastic_round((bank * moisture + other_bank * other_moisture) / total, total)


@kernel(forceinline=True)
def add_loose(columns, i, bank, bulk, soil, moisture):  # type: ignore[no-untyped-def]
    """Add loose soil of a bank and a bulk volume [mm^3], a kind and a moisture [%] to column i."""
    had = columns.loose[i]
    if had == 0:
        columns.loose_soil[i] = soil
        columns.loose_moisture[i] = moisture
        columns.minority_volume[i] = 0
    elif soil != columns.loose_soil[i]:
        columns.minority_volume[i] += bank
        if 2 * columns.minority_volume[i] > had + bank:
            columns.minority_volume[i] = had + bank - columns.minority_volume[i]
            columns.loose_soil[i] = soil
    if moisture != columns.loose_moisture[i]:
        columns.loose_moisture[i] = mix_moisture(had, columns.loose_moisture[i], bank, moisture)
    columns.loose[i] = had + bank
    columns.bulk[i] += bulk
    update_height(columns, i)


@kernel(forceinline=True)
def remove_loose(columns, i, bank):  # type: ignore[no-untyped-def]
    """Remove loose soil of a bank volume [mm^3], at most all there is, from column i.

    Returns:
        The bulk volume it had [mm^3].
    """
    had = columns.loose[i]
    bank = min(bank, had)
    if bank == had:
        bulk = columns.bulk[i]
        columns.minority_volume[i] = 0
    else:
        fraction = bank / had
        bulk = min(np.int64(columns.bulk[i] * fraction + 0.5), columns.bulk[i] - (had - bank))
        columns.minority_volume[i] -= np.int64(columns.minority_volume[i] * fraction)
    columns.loose[i] = had - bank
    columns.bulk[i] -= bulk
    update_height(columns, i)
    return bulk


@kernel(forceinline=True)
def remove_from_column(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Remove soil of a bulk volume [mm^3] from the top of column i, loose soil first.

    Returns:
        Bank volumes of the loose and of the firm soil removed [mm^3], integers; never more than
        the column holds.
    """
    from_loose = np.int64(0)
    rest = bulk
    if columns.loose[i] > 0:
        bank = bulk * (columns.loose[i] / columns.bulk[i])
        from_loose = min(np.int64(bank + 0.5), columns.loose[i])
        if from_loose > 0:
            rest = bulk - remove_loose(columns, i, from_loose)
    from_firm = np.int64(0)
    if columns.loose[i] == 0 and rest > 0.5:
        from_firm = remove_firm(columns, i, rest)
    return from_loose, from_firm


@kernel(forceinline=True)
def remove_firm(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Remove firm soil of a bulk volume [mm^3] from column i: packed soil is on top.

    Returns:
        Bank volume of the soil removed [mm^3], an integer; never more than the column holds.
    """
    bulk = np.int64(bulk + 0.5)
    packing = columns.packing[i]
    bank, regained = bulk, np.int64(0)
    if packing > 0:
        shrinkage = columns.shrinkage[columns.soil[i]]
        regained = packing
        if bulk < packed_depth(columns, i) / columns.metres_per_mm3:
            regained = min(np.int64(bulk * (shrinkage / (1.0 - shrinkage)) + 0.5), packing)
        bank = bulk + regained
    if bank > columns.firm[i]:
        bank, regained = columns.firm[i], packing
    if bank > 0:
        columns.firm[i] -= bank
        columns.packing[i] -= regained
        update_height(columns, i)
    return bank


@kernel(forceinline=True)
def compact_loose(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Reduce the bulk volume of the loose soil of column i by `bulk` [mm^3].

    The bulk volume does not become smaller than the bank volume.

    Returns:
        The reduction [mm^3].
    """
    reduction = min(np.int64(bulk), columns.bulk[i] - columns.loose[i])
    if reduction <= 0:
        return np.int64(0)
    columns.bulk[i] -= reduction
    columns.rut_volume[i] += reduction
    _set_height(columns, i)
    return reduction


@kernel(forceinline=True)
def pack_firm(columns, i, bulk):  # type: ignore[no-untyped-def]
    """Reduce the volume of the firm soil of column i by `bulk` [mm^3].

    At most all of it is packed, denser than bank soil by the shrinkage of its kind.

    Returns:
        The reduction [mm^3].
    """
    max_packing = np.int64(columns.firm[i] * columns.shrinkage[columns.soil[i]])
    reduction = min(np.int64(bulk), max_packing - columns.packing[i])
    if reduction <= 0:
        return np.int64(0)
    columns.packing[i] += reduction
    columns.rut_volume[i] += reduction
    _set_height(columns, i)
    return reduction
