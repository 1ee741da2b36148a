"""Forces of the soil on the tools that move through it: the sweeps of a tick, as wrenches.

- **Cutting.** Resistance to the cutting edge and the plate behind it (`cutting_edge`), and to the
  side of a tool that moves sideways (`side_plate`), summed to a force and a torque about one point.
- **Milling.** Soil that a driven drum engages, as found by `soil_sim.excavation.milled_cut`.
- **Bearing.** Soil under a tool bears it whether it cuts, presses or rests (`bearing_capacity`). A
  machine is supported by this force when the cut lifts its tracks, or when it stands on its bucket.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msg_bridge.contract.rows import (
    FORCE,
    Rows,
    SoilReaction,
    SweepAction,
    empty_rows,
    join_rows,
)
from msg_bridge.kernels import BoxedTable, box_table, fixed_signature_kernel, helper, kernel
from soil_sim.columns.state import Columns
from soil_sim.excavation.milled_cut import CONTACT_FORCE, CONTACT_POINT, Milling
from soil_sim.soils.soil_types import SoilType
from soil_sim.tool_force.bearing_capacity import add_bearing_force
from soil_sim.tool_force.cutting_edge import add_edge_force
from soil_sim.tool_force.side_plate import add_side_plate_force
from soil_sim.tool_force.stationary_drum import add_stationary_drum_force, is_drum
from soil_sim.tool_force.strength_table import (
    ForceColumns,
    ForceGround,
    GridLayout,
    strength_table,
)
from soil_sim.tool_force.wrench import (
    NUM_SUMS,
    WRENCH_FORCE,
    WRENCH_POINT,
    WRENCH_SIZE,
    WRENCH_TORQUE,
    reduce_wrench,
)
from soil_sim.tool_sweeps import ValidSweeps
from soil_sim.vec3 import add, key_point, scale

__all__ = ["ToolForces", "cutting_work", "set_milling_forces", "zero_tool_forces"]

_CUT, _MILL = int(SweepAction.CUT), int(SweepAction.MILL)
_REACTION_MILL, _REACTION_BEARING = int(SoilReaction.MILL), int(SoilReaction.BEARING)


class ToolForces:
    """Computes the wrenches of the soil on tools.

    Attributes:
        strength: `strength_table` of the kinds of soil.
    """

    def __init__(self, columns: Columns, kinds: Sequence[SoilType]) -> None:
        """
        Args:
            columns: the terrain; `compute` reads its current state.
            kinds: the kinds of soil in it, in the order of their ids.
        """
        self.strength = strength_table(kinds)
        self._ground: BoxedTable = box_table(
            ForceGround(
                ForceColumns.from_columns(columns.arrays),
                GridLayout.from_grid(columns.grid),
                self.strength,
            )
        )

    def compute(self, sweeps: ValidSweeps) -> Rows:
        """Return the FORCE rows of a tick: cutting or milling of each tool, then bearing of some.

        The rows of milling are zero; `set_milling_forces` completes them after the excavation.
        Call it before the soil of the tick is excavated. The point of application is the mean of
        the points at which the forces act at the end of the tick, weighted by force magnitude: for
        a level cut a third of the depth above the middle of the edge.

        Args:
            sweeps: validated sweeps of all tools.
        """
        rows, points, first = sweeps
        wrenches = np.zeros((2, first.size, WRENCH_SIZE))
        forces = empty_rows(FORCE, 2 * first.size)
        tools = rows, points, first, self._ground, wrenches, forces
        count, has_drums = _blade_forces(*tools)
        if has_drums:  # in a separate kernel, to save compile time: few machines have a drum
            count = _stationary_drum_forces(*tools)
        return forces[:count]


def zero_tool_forces(sweeps: ValidSweeps) -> Rows:
    """Return a FORCE row of zeros for each tool, at its first key point."""
    first = sweeps.rows[sweeps.first_row]
    forces = empty_rows(FORCE, first.size)
    forces["machine_id"], forces["tool"] = first["machine_id"], first["tool"]
    forces["x"], forces["y"], forces["z"] = first["x1"], first["y1"], first["z1"]
    return forces


def cutting_work(forces: Rows, sweeps: ValidSweeps) -> dict[tuple[int, int], float]:
    """Return the work of the resistance to cutting of each tool in a tick [J], 0 or more.

    Args:
        forces: FORCE rows of `ToolForces.compute`.
        sweeps: the sweeps that they are of.

    Returns:
        Resistance times displacement of the cutting edge, by ids of machine and tool.
    """
    work = {}
    for force, first in zip(forces, sweeps.first_row.tolist(), strict=False):
        edge = sweeps.points[first : first + 2]
        dx, dy, dz = (edge[:, 1] - edge[:, 0]).mean(axis=0).tolist()
        done = -(float(force["fx"]) * dx + float(force["fy"]) * dy + float(force["fz"]) * dz)
        work[int(force["machine_id"]), int(force["tool"])] = max(done, 0.0)
    return work


def set_milling_forces(forces: Rows, millings: Sequence[Milling]) -> Rows:
    """Complete the FORCE rows of drums.

    Args:
        forces: FORCE rows of `ToolForces.compute`; those of milling are changed.
        millings: what each drum engaged, in the order of their rows.

    Returns:
        The rows, followed by one for each drum that soil remains in the way of.
    """
    if not millings:
        return forces
    drum_rows = np.flatnonzero(forces["reaction"] == SoilReaction.MILL)
    remaining = empty_rows(FORCE, len(millings))
    for n, milling, in_the_way in zip(drum_rows, millings, remaining, strict=True):
        row = forces[n]
        row["work"] = milling.work
        in_the_way["machine_id"], in_the_way["tool"] = milling.machine_id, milling.tool
        in_the_way["reaction"] = SoilReaction.BEARING
        for force, contact in zip((row, in_the_way), milling.contacts, strict=True):
            if contact[CONTACT_FORCE].any():
                force["x"], force["y"], force["z"] = contact[CONTACT_POINT]
                force["fx"], force["fy"], force["fz"] = contact[CONTACT_FORCE]
    is_in_the_way = (remaining["fx"] != 0.0) | (remaining["fy"] != 0.0) | (remaining["fz"] != 0.0)
    return join_rows([forces, remaining[is_in_the_way]], FORCE)


@fixed_signature_kernel
def _blade_forces(rows, points, first, ground, wrenches, forces):  # type: ignore[no-untyped-def]
    """Fill the FORCE rows of all tools but drums.

    Returns:
        Number of rows, and the result of `_add_blade_wrenches`.
    """
    has_drums = _add_blade_wrenches(rows, points, first, ground, wrenches)
    return _fill_force_rows(rows, first, wrenches, forces), has_drums


@helper(allocates=True)
def _add_blade_wrenches(rows, points, first, ground, wrenches):  # type: ignore[no-untyped-def]
    """Write the wrenches of all tools but drums; return whether there are drums that do not mill.

    The wrenches have shape (2, tools, 9): [0] cutting, [1] bearing; see `wrench` for the slots.
    They are zeros before.
    """
    columns, grid_layout, strength = ground.table
    sums = np.empty(NUM_SUMS)
    has_drums = False
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else len(points)
        action = rows[first[n]].action
        own = points[first[n] : end]
        origin = scale(0.5, add(key_point(own, 0, 1), key_point(own, 1, 1)))
        for axis in range(3):
            wrenches[:, n, WRENCH_POINT + axis] = origin[axis]
        if action == _MILL:
            continue
        if is_drum(own):
            has_drums = True
            continue
        # A single pair is an edge without a plate and has no rake. A single plate that compacts is
        # a track, whose contact forces the machine computes.
        if len(own) < (4 if action == _CUT else 6):
            continue
        sums[:] = 0.0
        add_edge_force(own, origin, columns, grid_layout, strength, sums)
        add_side_plate_force(own, origin, columns, grid_layout, strength, sums)
        reduce_wrench(sums, origin, wrenches[0, n])
        sums[:] = 0.0
        add_bearing_force(own, origin, columns, grid_layout, strength, sums)
        reduce_wrench(sums, origin, wrenches[1, n])
    return has_drums


@kernel
def _stationary_drum_forces(rows, points, first, ground, wrenches, forces):  # type: ignore[no-untyped-def]
    """Write the wrenches of drums that are not driven into the wrenches of the other tools.

    Returns:
        Number of FORCE rows of all tools.
    """
    columns, grid_layout, strength = ground.table
    sums = np.empty(NUM_SUMS)
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else len(points)
        own = points[first[n] : end]
        origin = scale(0.5, add(key_point(own, 0, 1), key_point(own, 1, 1)))
        if rows[first[n]].action != _MILL and is_drum(own):
            sums[:] = 0.0
            add_stationary_drum_force(own, origin, columns, grid_layout, strength, sums)
            reduce_wrench(sums, origin, wrenches[1, n])
    return _fill_force_rows(rows, first, wrenches, forces)


@helper
def _fill_force_rows(rows, first, wrenches, forces):  # type: ignore[no-untyped-def]
    """Fill FORCE rows: cutting or milling of each tool, then bearing where it is not zero.

    Args:
        rows, first: as of `ValidSweeps`.
        wrenches: as of `_add_blade_wrenches`.
        forces: out, rows of zeros, two for each tool.

    Returns:
        The number of rows.
    """
    count = first.size
    for n in range(first.size):
        row, bearing = rows[first[n]], wrenches[1, n]
        _write_force_row(forces[n], row, wrenches[0, n])
        if row.action == _MILL:
            forces[n].reaction = _REACTION_MILL
        x, y, z = bearing[WRENCH_FORCE], bearing[WRENCH_FORCE + 1], bearing[WRENCH_FORCE + 2]
        if x != 0.0 or y != 0.0 or z != 0.0:
            _write_force_row(forces[count], row, bearing)
            forces[count].reaction = _REACTION_BEARING
            count += 1
    return count


@helper
def _write_force_row(force, row, wrench):  # type: ignore[no-untyped-def]
    """Write the wrench on the tool of a SWEEP row into a FORCE row."""
    force.machine_id, force.tool = row.machine_id, row.tool
    force.x, force.y = wrench[WRENCH_POINT], wrench[WRENCH_POINT + 1]
    force.z = wrench[WRENCH_POINT + 2]
    force.fx, force.fy = wrench[WRENCH_FORCE], wrench[WRENCH_FORCE + 1]
    force.fz = wrench[WRENCH_FORCE + 2]
    force.tx, force.ty = wrench[WRENCH_TORQUE], wrench[WRENCH_TORQUE + 1]
    force.tz = wrench[WRENCH_TORQUE + 2]
