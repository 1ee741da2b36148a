"""The lines that the terminal shows: levers, state of the machine, keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from teleop.key_layout import Deflections

__all__ = ["MachineView", "page_lines"]

_BAR_WIDTH = 10
"""Characters of a bar on each side of its middle."""

_LEVER_MEANINGS = {
    "iso": {"left_x": "swing", "left_y": "arm", "right_x": "bucket", "right_y": "boom"},
    "sae": {"left_x": "swing", "left_y": "boom", "right_x": "bucket", "right_y": "arm"},
}

_KEY_LINES = (
    "  left lever     w s  forward, back       a d  left, right",
    "  right lever    i k  forward, back       j l  left, right",
    "  tracks         arrows: both             t g  left     y h  right",
    "  space  EMERGENCY STOP     x  release the stop     + -  speed     q  quit",
)


@dataclass
class MachineView:
    """What is known of the machine.

    Attributes:
        joints: position [rad] and velocity [rad/s] of the joints that levers can move.
        sim_time: simulation time of the state [s]; None before the first.
        fill: soil in the tool over its heaped capacity; None if it carries none.
        pattern: pattern of the levers, "iso" or "sae".
        condition: "OK", "WARN" or "ERROR", and the message of the machine's diagnostics.
        is_silent: whether no state has arrived for a second.
        is_stopped: whether the emergency stop is pressed, by this program or another one.
        other_machines: namespaces of the machines that are found while this one has sent nothing.
    """

    joints: dict[str, tuple[float, float]] = field(default_factory=dict)
    sim_time: float | None = None
    fill: float | None = None
    pattern: str = "iso"
    condition: str = ""
    is_silent: bool = True
    is_stopped: bool = False
    other_machines: list[str] = field(default_factory=list)


def page_lines(
    machine: str, view: MachineView, deflections: Deflections, speed: float, *, has_releases: bool
) -> list[str]:
    """Return the lines.

    Args:
        machine: namespace of the machine.
        view: its state.
        deflections: of levers and pedals.
        speed: full deflection of a held key.
        has_releases: whether the terminal reports released keys.
    """
    lines = [_headline(machine, view), ""]
    lines += _lever_lines(view.pattern, deflections)
    lines += ["", f"  speed {100.0 * speed:.0f} %", ""]
    lines += _joint_lines(view.joints)
    if view.fill is not None:
        lines.append(f"  {'load':<14}{100.0 * view.fill:8.0f} % of the heaped capacity")
    lines += ["", f"  {view.condition}", "", *_KEY_LINES]
    if not has_releases:
        lines.append("  This terminal does not report released keys: hold one key at a time.")
    return lines


def _headline(machine: str, view: MachineView) -> str:
    if view.is_stopped:
        state = "EMERGENCY STOP - press x to release it"
    elif view.sim_time is None:
        state = "waiting for the machine; are soil_sim and machine_sim running?"
        if view.other_machines:
            state = f"no such machine yet; --machine may be {', '.join(view.other_machines)}"
    elif view.is_silent:
        state = "NO STATE FROM THE MACHINE"
    else:
        state = "driving"
    time = "" if view.sim_time is None else f"   {view.sim_time:.1f} s"
    return f"  {machine}{time}   {state}"


def _lever_lines(pattern: str, deflections: Mapping[str, float]) -> list[str]:
    """Return a line with a bar for each axis; left and forward are on the right of the bar."""
    meanings = _LEVER_MEANINGS[pattern]
    names = {
        "left_x": "left lever, left",
        "left_y": "left lever, forward",
        "right_x": "right lever, left",
        "right_y": "right lever, forward",
        "left_pedal": "left track",
        "right_pedal": "right track",
    }
    return [
        f"  {name:<22}{_bar(deflections[control])}  {meanings.get(control, '')}".rstrip()
        for control, name in names.items()
    ]


def _bar(deflection: float) -> str:
    bar = "#" * round(_BAR_WIDTH * abs(deflection))
    low, high = ("", bar) if deflection > 0.0 else (bar, "")
    return f"[{low:.>{_BAR_WIDTH}}|{high:.<{_BAR_WIDTH}}]"


def _joint_lines(joints: Mapping[str, tuple[float, float]]) -> list[str]:
    return [
        f"  {name:<14}{math.degrees(position):8.1f} deg{math.degrees(velocity):8.1f} deg/s"
        for name, (position, velocity) in joints.items()
    ]
