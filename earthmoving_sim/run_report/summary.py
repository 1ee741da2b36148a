"""The figures of the report, also for JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from itertools import dropwhile, pairwise
from typing import Any

import numpy as np

from earthmoving_sim.run_report.run_data import MachineData, RunData
from earthmoving_sim.run_report.work_cycles import WorkCycle, find_work_cycles

__all__ = ["CycleSummary", "LatencySummary", "MachineSummary", "RunSummary", "summarise"]

_MM3 = 1e-9
"""Cubic metres in a cubic millimetre."""

_PHASE_GROUPS = {
    "dig": "dig",
    "curl": "dig",
    "load": "dig",
    "lift": "lift",
    "swing": "swing",
    "haul": "swing",
    "dump": "dump",
    "tip": "dump",
}
"""Part of a cycle to which a phase of the operator belongs; others are the return."""

_FIRST_PHASES = ("approach", "brace", "reach", "start", "sump")
"""Phases with which a cycle begins."""


@dataclass(frozen=True)
class CycleSummary:
    """All cycles of a machine, by its payload or as its operator reported them.

    Attributes:
        count: number of cycles.
        volume: sum of their volumes [m^3 bank].
        mean_volume: of a cycle [m^3 bank].
        median_duration, min_duration, max_duration: [s].
        productivity: volume over the sum of the durations [m^3/h].
    """

    count: int
    volume: float
    mean_volume: float
    median_duration: float
    min_duration: float
    max_duration: float
    productivity: float


@dataclass(frozen=True)
class LatencySummary:
    """Latency of the commands of a machine [s]; of simulation time only where they are stamped."""

    count: int
    median: float
    p95: float
    max: float
    simulated_median: float | None


@dataclass
class MachineSummary:
    """Figures of a machine.

    Attributes:
        cycles: its cycles by payload.
        summary: all these cycles together; None without any.
        reported: the cycles that its operator reported.
        reported_summary: all reported cycles together; None without any.
        phase_times: mean time of each part of a reported cycle by the operator's phases [s].
        max_payload: [m^3 bank].
        distance: way of the base [m].
        latency: of its commands; None without any.
        max_forces: largest force of the soil on each tool [N].
    """

    cycles: list[WorkCycle] = field(default_factory=list)
    summary: CycleSummary | None = None
    reported: list[dict[str, Any]] = field(default_factory=list)
    reported_summary: CycleSummary | None = None
    phase_times: dict[str, float] = field(default_factory=dict)
    max_payload: float = 0.0
    distance: float = 0.0
    latency: LatencySummary | None = None
    max_forces: dict[str, float] = field(default_factory=dict)

    @property
    def total(self) -> CycleSummary | None:
        """All cycles as the operator reported them, by payload without an operator."""
        return self.reported_summary or self.summary


@dataclass
class RunSummary:
    """Figures of a run; volumes in [m^3 bank].

    Attributes:
        run_id: number of the run.
        simulated_time, wall_time: [s].
        first_tick: tick of the first ledger; None without any.
        cut, fill: sums over the columns that hold less, and more, at the end than in the first map.
        start_revision: revision of the first map, 0 if the terrain had not changed before; None
            without any.
        excavated, deposited: by machine id; sums of the conversion rows that are recorded.
        earlier_conversions: number of conversion rows before the first one that is recorded.
        missing_conversions: number of those between the first and the last one that are missing.
        max_imbalance: largest imbalance of the ledger [mm^3]; None without a ledger.
        late_ticks: number of ticks that were late; None if it is not recorded.
        design: remaining volumes at the end.
        machines: by namespace.
    """

    run_id: int | None
    simulated_time: float
    wall_time: float
    first_tick: int | None = None
    cut: float | None = None
    fill: float | None = None
    start_revision: int | None = None
    excavated: dict[int, float] = field(default_factory=dict)
    deposited: dict[int, float] = field(default_factory=dict)
    earlier_conversions: int = 0
    missing_conversions: int = 0
    max_imbalance: int | None = None
    late_ticks: int | None = None
    design: dict[str, float] = field(default_factory=dict)
    machines: dict[str, MachineSummary] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values."""
        content = asdict(self)
        for name, machine in self.machines.items():
            content["machines"][name]["cycles"] = [
                {**asdict(each), "duration": each.duration, "productivity": each.productivity}
                for each in machine.cycles
            ]
        return content


def summarise(run: RunData) -> RunSummary:
    """Return the figures of a run."""
    summary = RunSummary(run.run_id, run.simulated_time, run.wall_time, run.first_tick)
    received = run.volumes.received
    summary.earlier_conversions = max((received.first or 1) - 1, 0)  # their numbers begin with 1
    summary.missing_conversions = received.num_missing
    if run.terrain.grid is not None:
        change = run.terrain.volume_change
        summary.cut = int(-change[change < 0].sum()) * _MM3
        summary.fill = int(change[change > 0].sum()) * _MM3
        summary.start_revision = run.terrain.start_revision
    for totals, into in (
        (run.excavated, summary.excavated),
        (run.deposited, summary.deposited),
    ):
        into.update({number: float(trace.values[-1]) for number, trace in totals.items()})
    if len(run.imbalance):
        values = run.imbalance.values
        summary.max_imbalance = int(values[np.argmax(np.abs(values))])
    if len(run.late_ticks):
        summary.late_ticks = int(run.late_ticks.values[-1])
    summary.design = {name: float(trace.values[-1]) for name, trace in run.design.items()}
    summary.machines = {
        name: _machine(machine)
        for name, machine in sorted(run.machines.items())
        if _has_content(machine)
    }
    return summary


def _has_content(machine: MachineData) -> bool:
    return bool(
        len(machine.payload)
        or machine.positions
        or machine.velocities
        or len(machine.way)
        or machine.commands
    )


def _machine(data: MachineData) -> MachineSummary:
    summary = MachineSummary(reported=data.reports)
    summary.reported_summary = _all_cycles(_reported_cycles(data.reports))
    if len(data.payload):
        payload = data.payload.values
        summary.max_payload = float(payload.max())
        has_swing = bool(len(data.swing))
        summary.cycles = find_work_cycles(
            data.payload.times,
            payload,
            data.swing.times if has_swing else None,
            data.swing.values if has_swing else None,
        )
        summary.summary = _all_cycles([(each.volume, each.duration) for each in summary.cycles])
    summary.phase_times = _phase_times(data)
    summary.distance = data.way.length
    summary.latency = _latency(data)
    summary.max_forces = {name: float(trace.values.max()) for name, trace in data.forces.items()}
    return summary


def _reported_cycles(reports: list[dict[str, Any]]) -> list[tuple[float, float]]:
    """Return volume [m^3] and duration [s] of each reported cycle; none if one lacks either."""
    try:
        cycles = [(float(each["moved_volume"]), float(each["duration"])) for each in reports]
    except (KeyError, TypeError, ValueError):
        return []
    return cycles if np.isfinite(cycles).all() else []


def _all_cycles(cycles: list[tuple[float, float]]) -> CycleSummary | None:
    """Return the sums over cycles of a volume [m^3] and a duration [s]; None without any."""
    if not cycles:
        return None
    durations = np.array([duration for _, duration in cycles])
    volume = sum(volume for volume, _ in cycles)
    return CycleSummary(
        len(cycles),
        volume,
        volume / len(cycles),
        float(np.median(durations)),
        float(durations.min()),
        float(durations.max()),
        3600.0 * volume / float(durations.sum()) if durations.sum() > 0 else 0.0,
    )


def _phase_times(data: MachineData) -> dict[str, float]:
    """Return the mean time of each part of a reported cycle by the operator's phases [s].

    Phases of a cycle that was not completed, or that began before the bag, do not count.
    """
    reported = [each.get("number") for each in data.reports]
    phases = data.phases
    if phases and phases[0].phase not in _FIRST_PHASES:
        cycle = phases[0].cycle
        phases = list(dropwhile(lambda each: each.cycle == cycle, phases))
        if cycle in reported:
            reported.remove(cycle)
    numbers = [number for number in {each.cycle for each in phases} if number in reported]
    if not numbers:
        return {}
    sums = dict.fromkeys(("return", "dig", "lift", "swing", "dump"), 0.0)
    for phase, following in pairwise(phases):
        if phase.cycle in numbers:
            sums[_PHASE_GROUPS.get(phase.phase, "return")] += following.time - phase.time
    # An operator that is restarted counts from 1 again.
    count = sum(number in numbers for number in reported)
    return {name: total / count for name, total in sums.items()}


def _latency(data: MachineData) -> LatencySummary | None:
    samples = data.latency.samples
    if not samples:
        return None
    wall = np.array([each.wall for each in samples])
    simulated = [each.simulated for each in samples if each.simulated is not None]
    return LatencySummary(
        len(samples),
        float(np.median(wall)),
        float(np.percentile(wall, 95)),
        float(wall.max()),
        float(np.median(simulated)) if simulated else None,
    )
