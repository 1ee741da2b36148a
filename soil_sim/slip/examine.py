"""Examining columns one by one: a kernel of `soil_sim.slip`, and what all its kernels share.

A ring holds the columns that wait. The first one gives soil to the neighbour it is too steep
against by most, again and again until it is steep against none; whoever got some, and whoever
stands too steep above what it left, is put into the ring in turn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from soil_sim.columns import add_loose, settle_height, take_loose

__all__ = [
    "LAYER",
    "Ring",
    "SlipRule",
    "disturb",
    "examine",
    "push",
    "push_steep_above",
    "uniform",
]

LAYER = 0.25
"""Thickness of what moves at once, at most, in parts of a cell."""


class SlipRule(NamedTuple):
    """What decides whether a column's soil slips, and where it may go.

    Attributes:
        rows, cols: of the map.
        offsets: (row, col) of the neighbours [cells], shape (n, 2).
        distance: of each of them [m], shape (n,).
        reach: largest offset [cells].
        tolerance: excess of height left standing [m].
        slope, stands: as in `soil_sim.soils.SoilTables`.
        steeper: tangent of each column's angle over that of its soil, flat; empty: 1.
        gentlest: least tangent of any column at any moisture.
        uneven: how much chance there is in where soil slips to, 0 to 1.
        random: state of the random numbers, shape (1,), uint64.
    """

    rows: int
    cols: int
    offsets: NDArray[np.int64]
    distance: NDArray[np.float64]
    reach: int
    tolerance: float
    slope: NDArray[np.float64]
    stands: NDArray[np.float64]
    steeper: NDArray[np.float64]
    gentlest: float
    uneven: float
    random: NDArray[np.uint64]


class Ring(NamedTuple):
    """Columns that wait, first in, first out, none of them twice.

    Attributes:
        queue: flat indices, round and round.
        queued: 1 for those in it, flat, uint8.
        ends: where the first is, and where the next one goes.
    """

    queue: NDArray[np.int64]
    queued: NDArray[np.uint8]
    ends: NDArray[np.int64]


@njit(cache=True, inline="always")
def uniform(random):  # type: ignore[no-untyped-def]
    """The next random number from 0 to 1 (xorshift64*, Vigna 2016); the state is changed."""
    x = random[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    random[0] = x
    return ((x * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, forceinline=True)
def push(i, ring):  # type: ignore[no-untyped-def]
    """Put a column into the ring if it is not there yet."""
    if ring.queued[i] == 0:
        ring.queued[i] = 1
        ring.queue[ring.ends[1]] = i
        ring.ends[1] = (ring.ends[1] + 1) % ring.queue.size


@njit(cache=True)
def disturb(cells, around, rule, ring):  # type: ignore[no-untyped-def]
    """Put columns into the ring, with `around` all their neighbours, too."""
    offsets = rule.offsets
    for i in cells:
        push(i, ring)
        if around:
            row, col = i // rule.cols, i % rule.cols
            for k in range(offsets.shape[0]):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if 0 <= r < rule.rows and 0 <= c < rule.cols:
                    push(r * rule.cols + c, ring)


@njit(cache=True, error_model="numpy")
def examine(columns, rule, held, ring, budget):  # type: ignore[no-untyped-def]
    """Examine columns that wait, with at most about `budget` looks around; returns how many."""
    firm, loose, height = columns.firm, columns.loose, columns.height
    offsets, distance, tolerance = rule.offsets, rule.distance, rule.tolerance
    rows, cols, reach = rule.rows, rule.cols, rule.reach
    metres_per_mm3, floor = columns.metres_per_mm3, columns.floor
    queue, queued, ends = ring.queue, ring.queued, ring.ends
    count = offsets.shape[0]
    flat = offsets[:, 0] * cols + offsets[:, 1]
    most_at_once = LAYER * distance[0]
    looks = 0
    forward = True
    while ends[0] != ends[1] and looks < budget:
        i = queue[ends[0]]
        ends[0] = (ends[0] + 1) % queue.size
        queued[i] = 0
        looks += 1
        if held[i]:
            continue
        row, col = i // cols, i % cols
        interior = reach <= row < rows - reach and reach <= col < cols - reach
        if interior and not _may_slip(height, flat, distance, i, rule.gentlest, tolerance):
            continue
        gave = False
        while True:
            kind, moisture = columns.soil[i], columns.moisture[i]
            firm_tangent = tangent = rule.slope[kind, moisture]
            if loose[i] > 0:
                tangent = rule.slope[columns.loose_soil[i], columns.loose_moisture[i]]
            if rule.steeper.size:
                tangent *= rule.steeper[i]
                firm_tangent *= rule.steeper[i]
            base = floor + firm[i] * metres_per_mm3
            carried = rule.stands[kind, moisture]
            gentle = min(tangent, firm_tangent)
            firm_excess = 0.0
            best, most, least = 0.0, 0.0, tolerance
            target = np.int64(-1)
            # Ties go to alternate ends of the list, or a heap would drift to one side.
            forward = not forward
            for n in range(count):
                k = n if forward else count - 1 - n
                if not interior:
                    r, c = row + offsets[k, 0], col + offsets[k, 1]
                    if r < 0 or r >= rows or c < 0 or c >= cols:
                        continue
                j = i + flat[k]
                drop = height[i] - height[j]
                if drop - gentle * distance[k] <= least or held[j] != 0:
                    continue
                # What can go: loose soil as far as there is any, and firm if it stands too high.
                excess = min(drop - tangent * distance[k], height[i] - base)
                fails = base - height[j] - firm_tangent * distance[k]
                if fails > tolerance and base - height[j] > carried:
                    excess = max(drop - tangent * distance[k], fails) if loose[i] > 0 else fails
                else:
                    fails = 0.0
                if excess <= least:
                    continue
                if rule.uneven > 0.0:
                    liking = excess * (1.0 + rule.uneven * (2.0 * uniform(rule.random) - 1.0))
                    if liking <= most:
                        continue
                    most = liking
                else:
                    least = excess
                best, firm_excess = excess, fails
                target = j
            looks += 1
            if target < 0 or not _slip(columns, i, target, best, firm_excess, most_at_once):
                break
            gave = True
            push(target, ring)
        if gave:
            push_steep_above(columns, rule, i, ring)
    return looks


@njit(cache=True, forceinline=True)
def _may_slip(height, flat, distance, i, gentlest, tolerance):  # type: ignore[no-untyped-def]
    """Whether a column is steeper against any neighbour than the gentlest soil may be."""
    highest = height[i] - tolerance
    for k in range(flat.size):  # noqa: SIM110 - not for Numba
        if highest - height[i + flat[k]] > gentlest * distance[k]:
            return True
    return False


@njit(cache=True)
def push_steep_above(columns, rule, i, ring):  # type: ignore[no-untyped-def]
    """Put those into the ring that stand too steep above column i, which got lower."""
    height, loose, slope = columns.height, columns.loose, rule.slope
    offsets, rows, cols = rule.offsets, rule.rows, rule.cols
    row, col = i // cols, i % cols
    for k in range(offsets.shape[0]):
        r, c = row + offsets[k, 0], col + offsets[k, 1]
        if r < 0 or r >= rows or c < 0 or c >= cols:
            continue
        j = r * cols + c
        rise = height[j] - height[i] - rule.tolerance
        # Most are not steeper than the gentlest angle of any soil: their own needs no look.
        if rise > rule.gentlest * rule.distance[k]:
            limit = slope[columns.soil[j], columns.moisture[j]]
            if loose[j] > 0:
                upper = slope[columns.loose_soil[j], columns.loose_moisture[j]]
                limit = min(upper, limit)
            limit *= rule.distance[k]
            if rule.steeper.size:
                limit *= rule.steeper[j]
            if rise > limit:
                push(j, ring)


@njit(cache=True, forceinline=True)
def _slip(columns, i, j, excess, firm_excess, most_at_once):  # type: ignore[no-untyped-def]
    """Move half of an excess of height [m] from column i to j; returns whether anything went.

    Loose soil goes first and is loosened anew if it was packed; of firm soil goes half of what it
    has too much itself, and swells where it lands. No more than `most_at_once` [m] moves.
    """
    metres_per_mm3 = columns.metres_per_mm3
    went = False
    rest = min(excess, 2.0 * most_at_once)
    if columns.loose[i] > 0:
        kind = columns.loose_soil[i]
        growth = columns.growth[kind]
        packed = columns.bulk[i] / columns.loose[i]
        # i falls by packed, j rises by growth, for each mm^3 of bank volume.
        move = min(np.int64(rest / metres_per_mm3 / (packed + growth)), columns.loose[i])
        if move > 0:
            moisture = columns.loose_moisture[i]
            take_loose(columns, i, move)
            add_loose(columns, j, move, np.int64(move * growth + 0.5), kind, moisture)
            rest -= move * (packed + growth) * metres_per_mm3
            went = True
    if firm_excess > 0.0 and columns.loose[i] == 0:
        kind = columns.soil[i]
        growth = columns.growth[kind]
        rest = min(rest, firm_excess)
        fail = min(np.int64(rest / metres_per_mm3 / (1.0 + growth)), columns.firm[i])
        if fail > 0:
            columns.firm[i] -= fail
            settle_height(columns, i)
            bulk = np.int64(fail * growth + 0.5)
            add_loose(columns, j, fail, bulk, kind, columns.moisture[i])
            went = True
    return went
