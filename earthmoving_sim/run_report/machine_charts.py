"""Pictures of a machine: payload, joints, cylinders, tracks, way, latency."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from earthmoving_sim.run_report.charts import (
    Line,
    Panel,
    Span,
    draw_histogram,
    draw_panels,
    draw_path,
)
from earthmoving_sim.run_report.run_data import MachineData
from earthmoving_sim.run_report.summary import MachineSummary
from earthmoving_sim.run_report.trace import Trace

__all__ = ["draw_machine_charts"]

_MAX_JOINTS = 8
_MIN_WAY = 0.2
"""Way of the base from which on it is drawn [m]."""
_MEGA, _KILO = 1e6, 1e3


def draw_machine_charts(
    name: str, data: MachineData, summary: MachineSummary, folder: Path
) -> dict[str, Path]:
    """Draw what is recorded of a machine; return the pictures by what they show.

    Args:
        name: namespace of the machine.
        data, summary: the machine.
        folder: folder of the pictures.
    """
    prefix = name.strip("/").replace("/", "_") or "machine"
    spans = [
        Span(cycle.start, cycle.end, str(number))
        for number, cycle in enumerate(summary.cycles, start=1)
    ]
    charts: dict[str, Path] = {}

    def draw(kind: str, title: str, subtitle: str, panels: list[Panel]) -> None:
        shown = [panel for panel in panels if panel.lines]
        if shown:
            path = folder / f"{prefix}_{kind}.png"
            charts[kind] = draw_panels(path, f"{name}: {title}", subtitle, shown, spans=spans)

    draw("payload", "payload", "Shaded: cycles.", _payload_panels(data))
    draw(
        "joints",
        "joints",
        "Velocities with the commands in force (dashed).",
        _joint_panels(data),
    )
    draw(
        "cylinders", "cylinders", "Force is positive for a cylinder that pushes.", _cylinders(data)
    )
    draw("tracks", "tracks", "Speeds with the commands in force (dashed).", _track_panels(data))
    draw("base", "base", "Pitch and roll of the base.", _tilt_panels(data))
    if summary.distance > _MIN_WAY:
        x, y = data.way.positions.T
        charts["way"] = draw_path(
            folder / f"{prefix}_way.png",
            f"{name}: way",
            f"{summary.distance:.1f} m",
            x,
            y,
        )
    if data.latency.samples:
        charts["latency"] = draw_histogram(
            folder / f"{prefix}_latency.png",
            f"{name}: latency of commands",
            "From a changed command to the tick in which it is applied.",
            "latency [ms]",
            [1e3 * each.wall for each in data.latency.samples],
        )
    return charts


def _line(name: str, trace: Trace, scale: float = 1.0, *, is_dashed: bool = False) -> Line:
    return Line(name, trace.times, trace.values * scale, is_dashed)


def _lines(traces: Mapping[str, Trace], names: Iterable[str], scale: float = 1.0) -> list[Line]:
    return [_line(name, traces[name], scale) for name in names if len(traces[name])]


def _payload_panels(data: MachineData) -> list[Panel]:
    return [
        Panel("payload\n[m³ bank]", [_line("", data.payload)] if len(data.payload) else []),
        Panel("fill\n[heaped = 1]", [_line("", data.fill)] if len(data.fill) else []),
        Panel(
            "tool force\n[kN]",
            [_line(name, trace, 1 / _KILO) for name, trace in sorted(data.forces.items())],
        ),
    ]


def _joint_panels(data: MachineData) -> list[Panel]:
    names = _driven_joints(data)
    velocities = []
    for name in names:
        lines = [_line(name, data.velocities[name])] if len(data.velocities[name]) else []
        if name in data.commands and len(data.commands[name]):
            lines.append(_line("command", data.commands[name], is_dashed=True))
        velocities.append(Panel(f"{name}\n[rad/s]", lines))
    return [
        Panel("position\n[rad]", _lines(data.positions, names)),
        *velocities,
        Panel("torque\n[kN m]", _lines(data.efforts, names, 1 / _KILO)),
    ]


def _driven_joints(data: MachineData) -> list[str]:
    """Return the names of the joints that are shown: those with commands, or else all."""
    known = [name for name in data.positions | data.velocities if "sprocket" not in name]
    commanded = [name for name in known if name in data.commands]
    return (commanded or known)[:_MAX_JOINTS]


def _cylinders(data: MachineData) -> list[Panel]:
    def panel(label: str, suffix: str, scale: float) -> Panel:
        names = [name for name in data.cylinders if name.endswith(suffix)]
        lines = [_line(name.removesuffix(suffix), data.cylinders[name], scale) for name in names]
        return Panel(label, lines)

    return [
        panel("length [m]", "_length_m", 1.0),
        panel("force [kN]", "_force_n", 1 / _KILO),
        panel("cap side\n[MPa]", "_cap_pa", 1 / _MEGA),
        panel("rod side\n[MPa]", "_rod_pa", 1 / _MEGA),
        Panel("power [kW]", _cylinder_powers(data)),
    ]


def _cylinder_powers(data: MachineData) -> list[Line]:
    lines = []
    for name, force in data.cylinders.items():
        speed = data.cylinders.get(name.replace("_force_n", "_speed_m_s"))
        if name.endswith("_force_n") and speed is not None and len(speed) and len(force):
            speeds = np.interp(force.times, speed.times, speed.values)
            power = force.values * speeds / _KILO
            lines.append(Line(name.removesuffix("_force_n"), force.times, power))
    return lines


def _track_panels(data: MachineData) -> list[Panel]:
    def panel(label: str, field: str, scale: float) -> Panel:
        lines = [
            _line(side, data.tracks[f"{side}_{field}"], scale)
            for side in ("left", "right")
            if f"{side}_{field}" in data.tracks
        ]
        if field == "speed_m_s":
            lines += [
                _line(f"{side} command", data.commands[f"{side}_track"], is_dashed=True)
                for side in ("left", "right")
                if f"{side}_track" in data.commands
            ]
        return Panel(label, lines)

    return [
        panel("speed [m/s]", "speed_m_s", 1.0),
        panel("slip [1]", "slip", 1.0),
        panel("sinkage [mm]", "sinkage_m", 1e3),
        panel("drive force\n[kN]", "drive_force_n", 1 / _KILO),
    ]


def _tilt_panels(data: MachineData) -> list[Panel]:
    lines = [
        _line(name, trace, float(np.degrees(1.0)))
        for name, trace in data.tilt.items()
        if len(trace)
    ]
    return [Panel("inclination\n[deg]", lines)]
