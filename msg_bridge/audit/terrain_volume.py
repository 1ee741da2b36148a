"""Recompute the terrain volume of every tick twice: by conversion rows and cell by cell."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.differences import difference_finding
from msg_bridge.audit.keyframes import Keyframes
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["TerrainAudit", "audit_terrain"]

_MAX_FINDINGS = 10  # wrong terrain maps that have a finding of their own


@dataclass
class TerrainAudit:
    """Result of auditing the terrain.

    Attributes:
        totals: bank volume after each soil tick by conversion rows [mm^3], shape (ticks,); None
            without a terrain map.
        keyframes: number of checked terrain maps, the first included.
        checks, findings: extent of the checks, and faults.
    """

    totals: Numbers | None = None
    keyframes: int = 0
    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


def audit_terrain(
    soil: SoilTicks,
    window: Window,
    conversions: NumberedRows,
    map_updates: NumberedRows,
    keyframes: Keyframes,
    *,
    has_map_updates: bool,
) -> TerrainAudit:
    """Recompute the terrain volume of every tick in the window and compare with the maps.

    Args:
        soil, window, conversions: the run.
        map_updates: rows of updated cells.
        keyframes: the terrain maps.
        has_map_updates: whether map updates were recorded, or headers count none.
    """
    result = TerrainAudit()
    _check_keyframe_order(keyframes, result)
    indices = _keyframe_indices(soil, window, keyframes, result)
    if not indices:
        why = "no terrain map of an audited tick"
        result.checks += [CheckResult(c, False, why) for c in (Check.TERRAIN, Check.KEYFRAMES)]
        return result
    anchor = next(iter(indices.values()))
    moved = _net_deposited(soil, conversions)
    replay = _CellReplay(soil, window, map_updates, keyframes, indices, result)
    result.totals = replay.first_total + moved - moved[anchor]
    if not has_map_updates:
        why = "the bag has no map updates"
        result.checks += [CheckResult(c, False, why) for c in (Check.TERRAIN, Check.KEYFRAMES)]
        return result
    by_cells = replay.totals(result.totals)
    ticks = soil.ticks[anchor : window.last + 1]
    finding = difference_finding(
        Check.TERRAIN,
        "the terrain by map updates differs from that by conversion rows",
        ticks,
        (by_cells - result.totals)[anchor : window.last + 1],
    )
    result.findings += [finding] if finding else []
    last_tick = int(soil.ticks[list(indices.values())[-1]])
    result.checks += _check_results(soil, window, anchor, result.keyframes, last_tick)
    return result


def _net_deposited(soil: SoilTicks, conversions: NumberedRows) -> Numbers:
    """Return the volume deposited minus that excavated up to each soil tick [mm^3]."""
    volume = conversions.rows["volume_mm3"].astype(np.int64)
    kind = conversions.rows["kind"]
    signed = np.where(
        kind == ConversionKind.DEPOSIT,
        volume,
        np.where(kind == ConversionKind.EXCAVATE, -volume, 0),
    )
    sums = np.concatenate([[0], np.cumsum(signed)])
    net: Numbers = sums[conversions.count_through(soil.spans[Stream.CONVERSION].last)]
    return net


def _check_keyframe_order(keyframes: Keyframes, result: TerrainAudit) -> None:
    for subject, revisions in (
        ("two different terrain maps are", keyframes.conflicting),
        ("a terrain map after newer ones or of another grid is", keyframes.out_of_order),
    ):
        result.findings += [
            Finding(Check.KEYFRAMES, f"{subject} of revision {revision}") for revision in revisions
        ]


def _check_results(
    soil: SoilTicks, window: Window, anchor: int, num_keyframes: int, last_tick: int
) -> list[CheckResult]:
    """Return the extent of both checks.

    Args:
        soil, window: the run.
        anchor: index of the soil header of the first terrain map.
        num_keyframes: number of checked terrain maps.
        last_tick: tick of the last one.
    """
    span = soil.spans[Stream.MAP_UPDATE]
    first, last = soil.ticks[anchor], soil.ticks[window.last]
    misses_cells = anchor > window.first and int(span.last[anchor]) >= int(span.first[window.first])
    terrain = f"ticks {first}..{last}, by conversion rows and cell by cell"
    if misses_cells:
        terrain += f"; the first terrain map is of tick {first}, so cells before it are unknown"
    compared = num_keyframes > 1 or int(span.last[window.last]) <= int(span.last[anchor])
    maps = f"{num_keyframes} terrain map(s), cell by cell, the last of tick {last_tick}"
    if not compared:
        maps = "there is only one terrain map, and nothing to compare it with"
    return [
        CheckResult(Check.TERRAIN, not misses_cells, terrain),
        CheckResult(Check.KEYFRAMES, compared, maps),
    ]


class _CellReplay:
    """Replays map updates from one terrain map to the next and compares.

    Attributes:
        first_total: volume of the first terrain map in the window [mm^3].
    """

    def __init__(
        self,
        soil: SoilTicks,
        window: Window,
        map_updates: NumberedRows,
        keyframes: Keyframes,
        indices: dict[int, int],
        result: TerrainAudit,
    ) -> None:
        """Select the valid updates; the others are findings.

        Args:
            soil, window: the run.
            map_updates: rows of updated cells.
            keyframes: the terrain maps.
            indices: index of the soil header of each map, by revision.
            result: receives findings and the number of checked maps.
        """
        self._soil, self._window, self._result = soil, window, result
        self._keyframes, self._keyframe_indices = keyframes, indices
        assert keyframes.grid is not None
        self._shape = keyframes.grid.shape
        rows = map_updates.rows
        inside = (rows["row"] < self._shape[0]) & (rows["col"] < self._shape[1])
        volume = rows["volume_mm3"]
        valid = inside & (volume >= 0.0) & (volume < 2**53) & (volume == np.rint(volume))
        if not valid.all():
            number = int(map_updates.numbers[~valid][0])
            tick = int(soil.spans[Stream.MAP_UPDATE].tick_of(map_updates.numbers[~valid][:1])[0])
            text = (
                f"{(~valid).sum()} map update(s) have a cell outside of the map or an invalid"
                f" volume, the first is row {number} (tick {tick})"
            )
            result.findings.append(Finding(Check.TERRAIN, text, tick))
        self._numbers = map_updates.numbers[valid]
        self._cell = rows["row"][valid].astype(np.int64) * self._shape[1] + rows["col"][valid]
        self._volume = volume[valid].astype(np.int64)
        first = next(volumes for revision, volumes in keyframes if revision in indices)
        self.first_total = int(first.sum())

    def totals(self, by_conversions: Numbers) -> Numbers:
        """Return the terrain volume after each soil tick by map updates [mm^3], shape (ticks,).

        Args:
            by_conversions: the same by conversion rows; used before the first map.
        """
        span = self._soil.spans[Stream.MAP_UPDATE]
        ends = np.searchsorted(self._numbers, span.last, side="right")
        totals = by_conversions.copy()
        state: Numbers | None = None
        start = num_wrong = 0
        for revision, volumes in self._keyframes:
            index = self._keyframe_indices.get(revision)
            if index is None:
                continue
            if state is not None:
                self._apply(state, totals, ends, start, index)
                self._result.keyframes += 1
                if (state != volumes).any():
                    num_wrong += 1
                    if num_wrong <= _MAX_FINDINGS:
                        self._report_cell_difference(state, volumes, revision, start, index)
                difference = int(volumes.sum()) - int(by_conversions[index])
                if difference:
                    self._report_total_difference(revision, index, difference)
            else:
                self._result.keyframes = 1
                totals[index] = int(volumes.sum())
            # Continue from the map itself, so that one wrong cell is reported once.
            state, start = volumes.copy(), index
        if state is not None:
            self._apply(state, totals, ends, start, self._window.last)
        if num_wrong > _MAX_FINDINGS:
            text = f"{num_wrong - _MAX_FINDINGS} more terrain maps differ from their updates"
            self._result.findings.append(Finding(Check.KEYFRAMES, text))
        return totals

    def _apply(self, state: Numbers, totals: Numbers, ends: Numbers, start: int, end: int) -> None:
        """Advance the cells from soil header `start` to `end`, and set the totals after each.

        Args:
            state: volume of each cell [mm^3]; changed in place.
            totals: volume after each soil tick [mm^3]; changed in place.
            ends: number of updates up to each soil header.
            start, end: indices of soil headers.
        """
        if end <= start:
            return
        low, high = int(ends[start]), int(ends[end])
        cell, volume = self._cell[low:high], self._volume[low:high]
        order = np.argsort(cell, kind="stable")
        same = np.concatenate([[False], cell[order][1:] == cell[order][:-1]])
        before = np.where(same, np.roll(volume[order], 1), state[cell[order]])
        rise = np.empty_like(volume)
        rise[order] = volume[order] - before
        sums = np.concatenate([[0], np.cumsum(rise)])
        totals[start + 1 : end + 1] = int(state.sum()) + sums[ends[start + 1 : end + 1] - low]
        last_of = np.concatenate([~same[1:], [True]]) if cell.size else same[:0]
        state[cell[order][last_of]] = volume[order][last_of]

    def _report_cell_difference(
        self, state: Numbers, volumes: Numbers, revision: int, start: int, index: int
    ) -> None:
        """Add a finding about a map that differs from its updates.

        Args:
            state: volumes by updates [mm^3].
            volumes: volumes of the map [mm^3].
            revision: that of the map.
            start, index: soil headers of the map before and of this one.
        """
        differs = np.flatnonzero(state != volumes)
        row, col = divmod(int(differs[0]), self._shape[1])
        first, last = int(self._soil.ticks[start]), int(self._soil.ticks[index])
        text = (
            f"the terrain map of tick {last} (revision {revision}) differs from its updates in"
            f" {differs.size} cell(s), first row {row}, col {col}: the map has"
            f" {volumes[differs[0]]} mm3, the updates since tick {first} lead to"
            f" {state[differs[0]]} mm3"
        )
        self._result.findings.append(Finding(Check.KEYFRAMES, text, first + 1, last))

    def _report_total_difference(self, revision: int, index: int, difference: int) -> None:
        """Add a finding about the first map whose total differs from the conversion rows."""
        if any(f.text.startswith("the total of") for f in self._result.findings):
            return
        tick = int(self._soil.ticks[index])
        text = (
            f"the total of the terrain map of tick {tick} (revision {revision}) differs by"
            f" {difference:+} mm3 from that by conversion rows since the first map"
        )
        self._result.findings.append(Finding(Check.KEYFRAMES, text, tick))


def _keyframe_indices(
    soil: SoilTicks, window: Window, keyframes: Keyframes, result: TerrainAudit
) -> dict[int, int]:
    """Return the index of the first soil header with the revision of each map, by revision."""
    revisions = soil.revisions[window.indices]
    indices = {}
    for revision in keyframes.revisions:
        same = np.flatnonzero(revisions == revision)
        if same.size:
            indices[revision] = window.first + int(same[0])
        elif (revisions < revision).any() and (revisions > revision).any() and not soil.missing():
            text = f"a terrain map has revision {revision}, which is that of no tick"
            result.findings.append(Finding(Check.KEYFRAMES, text))
    return indices
