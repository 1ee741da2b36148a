"""The terrain of every tick, counted twice: by conversion rows and cell by cell."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.differences import difference_finding
from msg_bridge.audit.keyframes import Keyframes
from msg_bridge.audit.membership import SoilTicks
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["TerrainAudit", "audit_terrain"]

_MAX_FINDINGS = 10  # keyframes that disagree, told one by one


@dataclass
class TerrainAudit:
    """What became of the terrain.

    Attributes:
        totals: bank volume after each soil tick by conversion rows [mm^3], None without a keyframe.
        keyframes: how many were checked, the first included.
        checks, findings: how far it went, and what is wrong.
    """

    totals: Numbers | None = None
    keyframes: int = 0
    checks: list[CheckResult] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


def audit_terrain(
    soil: SoilTicks,
    window: Window,
    conversions: NumberedRows,
    changed: NumberedRows,
    keyframes: Keyframes,
    *,
    has_map_updates: bool,
) -> TerrainAudit:
    """Count the terrain of every tick in the window.

    Args:
        has_map_updates: whether the bag has the topic of changed cells, or needs none.
    """
    result = TerrainAudit()
    for what, wrong in (
        ("two different terrain maps are", keyframes.conflicting),
        (
            "a terrain map that comes after newer ones or has another grid is",
            keyframes.out_of_order,
        ),
    ):
        result.findings += [
            Finding(Check.KEYFRAMES, f"{what} of revision {revision}") for revision in wrong
        ]
    places = _keyframe_indices(soil, window, keyframes, result)
    if not places:
        why = "no terrain map of a tick that is audited"
        result.checks += [CheckResult(c, False, why) for c in (Check.TERRAIN, Check.KEYFRAMES)]
        return result
    anchor = next(iter(places.values()))
    volume = conversions.rows["volume_mm3"].astype(np.int64)
    kind = conversions.rows["kind"]
    signed = np.where(
        kind == ConversionKind.DEPOSIT,
        volume,
        np.where(kind == ConversionKind.EXCAVATE, -volume, 0),
    )
    sums = np.concatenate([[0], np.cumsum(signed)])
    moved = sums[conversions.count_through(soil.spans[Stream.CONVERSION].last)]
    walk = _CellReplay(soil, window, changed, keyframes, places, result)
    result.totals = walk.first_total + moved - moved[anchor]
    if not has_map_updates:
        why = "the bag has no changed cells"
        result.checks += [CheckResult(c, False, why) for c in (Check.TERRAIN, Check.KEYFRAMES)]
        return result
    cells = walk.totals(result.totals)
    ticks = soil.ticks[anchor : window.last + 1]
    finding = difference_finding(
        Check.TERRAIN,
        "the terrain by changed cells differs from that by conversion rows",
        ticks,
        cells[anchor : window.last + 1] - result.totals[anchor : window.last + 1],
    )
    result.findings += [finding] if finding else []
    early = soil.spans[Stream.MAP_UPDATE]
    before = int(early.last[anchor]) >= int(early.first[window.first]) and anchor > window.first
    detail = f"ticks {ticks[0]}..{ticks[-1]}, by conversion rows and cell by cell"
    if before:
        detail += f"; the first terrain map is of tick {ticks[0]}, so cells before it are unknown"
    result.checks.append(CheckResult(Check.TERRAIN, not before, detail))
    last = soil.ticks[list(places.values())[-1]]
    detail = f"{result.keyframes} terrain map(s), cell by cell, the last of tick {last}"
    compared = result.keyframes > 1 or int(early.last[window.last]) <= int(early.last[anchor])
    if not compared:
        detail = "there is one terrain map only, and nothing to compare with it"
    result.checks.append(CheckResult(Check.KEYFRAMES, compared, detail))
    return result


class _CellReplay:
    """From keyframe to keyframe, applying changed cells and comparing."""

    def __init__(
        self,
        soil: SoilTicks,
        window: Window,
        changed: NumberedRows,
        keyframes: Keyframes,
        places: dict[int, int],
        result: TerrainAudit,
    ) -> None:
        self._soil, self._window, self._result = soil, window, result
        self._keyframes, self._keyframe_indices = keyframes, places
        assert keyframes.grid is not None
        self._shape = keyframes.grid.shape
        rows = changed.rows
        inside = (rows["row"] < self._shape[0]) & (rows["col"] < self._shape[1])
        volume = rows["volume_mm3"]
        proper = inside & (volume >= 0.0) & (volume < 2**53) & (volume == np.rint(volume))
        if not proper.all():
            number = int(changed.numbers[~proper][0])
            tick = int(soil.spans[Stream.MAP_UPDATE].tick_of(changed.numbers[~proper][:1])[0])
            text = f"{(~proper).sum()} changed cell(s) are no cell or volume, first row {number}"
            result.findings.append(Finding(Check.TERRAIN, f"{text} (tick {tick})", tick))
        self._numbers = changed.numbers[proper]
        self._cell = rows["row"][proper].astype(np.int64) * self._shape[1] + rows["col"][proper]
        self._volume = volume[proper].astype(np.int64)
        first = next(volumes for revision, volumes in keyframes if revision in places)
        self.first_total = int(first.sum())

    def totals(self, by_conversions: Numbers) -> Numbers:
        """Terrain after each soil tick by changed cells, from the first keyframe placed on."""
        span = self._soil.spans[Stream.MAP_UPDATE]
        ends = np.searchsorted(self._numbers, span.last, side="right")
        totals = by_conversions.copy()
        state: Numbers | None = None
        at = 0
        wrong = 0
        for revision, volumes in self._keyframes:
            place = self._keyframe_indices.get(revision)
            if place is None:
                continue
            if state is not None:
                self._apply(state, totals, ends, at, place)
                self._result.keyframes += 1
                wrong += self._compare(state, volumes, revision, at, place, wrong)
                if (total := int(volumes.sum())) != by_conversions[place]:
                    self._report_total_difference(
                        revision, place, total - int(by_conversions[place])
                    )
            else:
                self._result.keyframes = 1
                totals[place] = int(volumes.sum())
            # Each stretch starts from the map itself, so that one wrong cell is told once.
            state, at = volumes.copy(), place
        if state is not None:
            self._apply(state, totals, ends, at, self._window.last)
        if wrong > _MAX_FINDINGS:
            text = f"{wrong - _MAX_FINDINGS} more terrain maps differ from their changed cells"
            self._result.findings.append(Finding(Check.KEYFRAMES, text))
        return totals

    def _apply(self, state: Numbers, totals: Numbers, ends: Numbers, at: int, to: int) -> None:
        """Bring `state` from soil header `at` to `to`, and note the totals after each."""
        if to <= at:
            return
        low, high = int(ends[at]), int(ends[to])
        cell, volume = self._cell[low:high], self._volume[low:high]
        order = np.argsort(cell, kind="stable")
        same = np.concatenate([[False], cell[order][1:] == cell[order][:-1]])
        before = np.where(same, np.roll(volume[order], 1), state[cell[order]])
        rise = np.empty_like(volume)
        rise[order] = volume[order] - before
        sums = np.concatenate([[0], np.cumsum(rise)])
        totals[at + 1 : to + 1] = int(state.sum()) + sums[ends[at + 1 : to + 1] - low]
        last_of = np.concatenate([~same[1:], [True]]) if cell.size else same[:0]
        state[cell[order][last_of]] = volume[order][last_of]

    def _compare(
        self, state: Numbers, volumes: Numbers, revision: int, at: int, place: int, wrong: int
    ) -> int:
        """Compare with the map at `place`; 1 if it differs."""
        differs = np.flatnonzero(state != volumes)
        if not differs.size:
            return 0
        if wrong < _MAX_FINDINGS:
            row, col = divmod(int(differs[0]), self._shape[1])
            low, high = int(self._soil.ticks[at]), int(self._soil.ticks[place])
            text = (
                f"the terrain map of tick {high} (revision {revision}) differs from its changed"
                f" cells in {differs.size} cell(s), first row {row}, col {col}: the map has"
                f" {volumes[differs[0]]} mm3, its changes since tick {low} make"
                f" {state[differs[0]]} mm3"
            )
            self._result.findings.append(Finding(Check.KEYFRAMES, text, low + 1, high))
        return 1

    def _report_total_difference(self, revision: int, place: int, by: int) -> None:
        known = [f for f in self._result.findings if f.text.startswith("the total of")]
        if known:
            return
        tick = int(self._soil.ticks[place])
        text = (
            f"the total of the terrain map of tick {tick} (revision {revision}) differs by {by:+}"
            " mm3 from that by conversion rows since the first map"
        )
        self._result.findings.append(Finding(Check.KEYFRAMES, text, tick))


def _keyframe_indices(
    soil: SoilTicks, window: Window, keyframes: Keyframes, result: TerrainAudit
) -> dict[int, int]:
    """Index of the soil header that each keyframe shows the end of, by revision."""
    revisions = soil.revisions[window.indices]
    places = {}
    for revision in keyframes.revisions:
        same = np.flatnonzero(revisions == revision)
        if same.size:
            places[revision] = window.first + int(same[0])
        elif (revisions < revision).any() and (revisions > revision).any() and not soil.missing():
            text = f"a terrain map has revision {revision}, which no tick ends with"
            result.findings.append(Finding(Check.KEYFRAMES, text))
    return places
