"""Examining columns one by one: a kernel of `soil_sim.slip`.

A ring holds the columns that wait. The first one gives soil to the neighbour it is too steep
against by most, again and again until it is steep against none; whoever got some, and whoever
stands too steep above what it left, is put into the ring in turn.
"""

from __future__ import annotations

import numpy as np

from soil_sim.columns import add_loose, settle_height, take_loose
from soil_sim.jit import helper, kernel
from soil_sim.slip.face import is_too_high, push_too_high_over
from soil_sim.slip.rule import push, uniform

__all__ = ["LAYER", "disturb", "examine", "push_steep_above"]

LAYER = 0.25
"""Thickness of what moves at once, at most, in parts of a cell."""


@kernel()
def disturb(columns, cells, around, sunk, rule, ring):  # type: ignore[no-untyped-def]
    """Put columns into the ring, with `around` all their neighbours, with `sunk` what is too high
    above them and farther away."""
    offsets, far = rule.offsets, rule.faces.offsets.shape[0] > 0
    for i in cells:
        push(i, ring)
        if sunk and far:
            push_too_high_over(columns, rule, i, ring)
        if around:
            row, col = i // rule.cols, i % rule.cols
            for k in range(offsets.shape[0]):
                r, c = row + offsets[k, 0], col + offsets[k, 1]
                if 0 <= r < rule.rows and 0 <= c < rule.cols:
                    push(r * rule.cols + c, ring)


@kernel(error_model="numpy")
def examine(columns, rule, held, ring, budget):  # type: ignore[no-untyped-def]
    """Examine columns that wait, with at most about `budget` looks around; returns how many."""
    firm, loose, height = columns.firm, columns.loose, columns.height
    offsets, distance, tolerance = rule.offsets, rule.distance, rule.tolerance
    rows, cols, reach = rule.rows, rule.cols, rule.reach
    metres_per_mm3, floor = columns.metres_per_mm3, columns.floor
    queue, queued, ends = ring.queue, ring.queued, ring.ends
    count = offsets.shape[0]
    flat = np.empty(count, dtype=np.int64)
    for k in range(count):
        flat[k] = offsets[k, 0] * cols + offsets[k, 1]
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
        coheres = rule.faces.near[columns.soil[i], columns.moisture[i], 0] > 0.0
        too_high = not coheres
        while True:
            kind, moisture = columns.soil[i], columns.moisture[i]
            firm_tangent = tangent = rule.slope[kind, moisture]
            if loose[i] > 0:
                tangent = rule.slope[columns.loose_soil[i], columns.loose_moisture[i]]
            if rule.steeper.size:
                tangent *= rule.steeper[i]
                firm_tangent *= rule.steeper[i]
            base = floor + firm[i] * metres_per_mm3
            gentle = min(tangent, firm_tangent)
            firm_excess = 0.0
            leans = False
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
                leans |= fails > tolerance
                if fails > tolerance and too_high:
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
            if leans and not too_high and is_too_high(columns, rule, held, i):
                too_high = True  # look again the same way, at the firm soil, too
                forward = not forward
                continue
            if target < 0 or not _slip(columns, i, target, best, firm_excess, most_at_once):
                break
            gave = True
            too_high = not coheres
            push(target, ring)
        if gave:
            push_steep_above(columns, rule, i, ring)
    return looks


@helper(forceinline=True)
def _may_slip(height, flat, distance, i, gentlest, tolerance):  # type: ignore[no-untyped-def]
    """Whether a column is steeper against any neighbour than the gentlest soil may be."""
    highest = height[i] - tolerance
    for k in range(flat.size):  # noqa: SIM110 - not for Numba
        if highest - height[i + flat[k]] > gentlest * distance[k]:
            return True
    return False


@helper()
def push_steep_above(columns, rule, i, ring):  # type: ignore[no-untyped-def]
    """Put those into the ring that stand too steep or too high above column i, which got lower."""
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
    if rule.faces.offsets.shape[0] > 0:
        push_too_high_over(columns, rule, i, ring)


@helper(inline="always")
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
