"""What the soil does to the tools that sweep it: the sweeps of a tick, turned into wrenches.

- **Cut.** What resists the lip and the plate behind it (`soil_sim.tool_force.cutting_edge`), and the side of
  a tool that moves along its lip (`soil_sim.tool_force.side_plate`). The forces add up to a force and a torque
  about one point.
- **Milling.** What resists the picks of a drum that spins (`soil_sim.tool_force.drum`).
- **Bearing.** Whether it cuts, presses or rests, soil under a tool bears it
  (`soil_sim.tool_force.bearing_capacity`): this is what a machine leans on when the cut lifts its tracks, or when
  it stands on its bucket.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msg_bridge.contract.rows import FORCE, Rows, SoilReaction, SweepAction, empty_rows
from msg_bridge.kernels import helper, kernel
from soil_sim.columns.state import Columns
from soil_sim.soils.soil_types import SoilType
from soil_sim.tool_force.bearing_capacity import add_bearing_force
from soil_sim.tool_force.cutting_edge import add_edge_force
from soil_sim.tool_force.drum import add_milling_force, add_stationary_drum_force, is_drum
from soil_sim.tool_force.side_plate import add_side_plate_force
from soil_sim.tool_force.strength_table import ForceColumns, reduce_wrench, strength_table
from soil_sim.tool_sweeps import ValidSweeps
from soil_sim.vec3 import add, key_point, scale

__all__ = ["ToolForces", "zero_tool_forces"]

_CUT, _MILL = int(SweepAction.CUT), int(SweepAction.MILL)
_HOLDS_MILL, _HOLDS_BEARING = int(SoilReaction.MILL), int(SoilReaction.BEARING)


class ToolForces:
    """Wrenches of the soil on the tools that sweep it."""

    def __init__(self, columns: Columns, kinds: Sequence[SoilType]) -> None:
        """
        Args:
            columns: the terrain, read as it is when `compute` is called.
            kinds: the kinds of soil in it, by id.
        """
        self._columns = ForceColumns.from_columns(columns.arrays)
        self._strength = strength_table(kinds)
        grid = columns.grid
        self._frame = (grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first)

    def compute(self, sweeps: ValidSweeps) -> Rows:
        """FORCE rows of a tick: what resists the cut of each tool, then what bears some of them.

        Call it before the tick's cut. The point of application is the mean of where the forces act
        at the end of the tick, by their strength: of a level cut over the lip's middle, a third of
        the depth above it.

        Args:
            sweeps: sound ones.
        """
        rows, points, first = sweeps
        tables = self._columns, self._frame, self._strength
        found, drums = _blade_wrenches(rows, points, first, *tables)
        if drums:  # a kernel of its own: few machines have one
            _add_drum_wrenches(rows, points, first, *tables, found)
        forces: Rows = _force_rows(rows, first, found)
        return forces


def zero_tool_forces(sweeps: ValidSweeps) -> Rows:
    """One FORCE row of zeros a tool, at its first key point: no force is said to be zero."""
    first = sweeps.rows[sweeps.first_row]
    forces = empty_rows(FORCE, first.size)
    forces["machine_id"], forces["tool"] = first["machine_id"], first["tool"]
    forces["x"], forces["y"], forces["z"] = first["x1"], first["y1"], first["z1"]
    return forces


@kernel
def _blade_wrenches(  # type: ignore[no-untyped-def]
    rows, points, first, columns, grid_layout, strength
):
    """(wrenches of the tools but drums, whether there are drums).

    Point [m], force [N] and torque about the point [N m], shape (2, tools, 9): first of what
    resists the cut of each tool, then of what bears it.
    """
    out = np.zeros((2, first.size, 9))
    sums = np.empty(10)
    drums = False
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else len(points)
        action = rows[first[n]].action
        own = points[first[n] : end]
        origin = scale(0.5, add(key_point(own, 0, 1), key_point(own, 1, 1)))
        for axis in range(3):
            out[:, n, axis] = origin[axis]
        if action == _MILL or is_drum(own):
            drums = True
            continue
        # One pair alone is an edge without a plate, it has no rake; a plate alone that presses is a
        # track, which stands by itself.
        if len(own) < (4 if action == _CUT else 6):
            continue
        sums[:] = 0.0
        add_edge_force(own, origin, columns, grid_layout, strength, sums)
        add_side_plate_force(own, origin, columns, grid_layout, strength, sums)
        reduce_wrench(sums, origin, out[0, n])
        sums[:] = 0.0
        add_bearing_force(own, origin, columns, grid_layout, strength, sums)
        reduce_wrench(sums, origin, out[1, n])
    return out, drums


@kernel
def _add_drum_wrenches(  # type: ignore[no-untyped-def]
    rows, points, first, columns, grid_layout, strength, out
):
    """Add the wrenches of drums, that mill or stand, to those that `_wrenches` found."""
    sums = np.empty(10)
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else len(points)
        own = points[first[n] : end]
        origin = scale(0.5, add(key_point(own, 0, 1), key_point(own, 1, 1)))
        sums[:] = 0.0
        if rows[first[n]].action == _MILL:
            if len(own) >= 8:
                add_milling_force(own, origin, columns, grid_layout, strength, sums)
                reduce_wrench(sums, origin, out[0, n])
        elif is_drum(own):
            add_stationary_drum_force(own, origin, columns, grid_layout, strength, sums)
            reduce_wrench(sums, origin, out[1, n])


@kernel
def _force_rows(rows, first, wrenches):  # type: ignore[no-untyped-def]
    """FORCE rows: what resists the cut of each tool, then what bears some of them."""
    tools = first.size
    borne = np.zeros(tools, dtype=np.bool_)
    for n in range(tools):
        for axis in range(3, 6):
            borne[n] |= wrenches[1, n, axis] != 0.0
    forces = np.zeros(tools + borne.sum(), FORCE)
    for n in range(tools):
        _write_force_row(forces[n], rows[first[n]], wrenches[0, n])
        if rows[first[n]].action == _MILL:
            forces[n].reaction = _HOLDS_MILL
    k = tools
    for n in range(tools):
        if borne[n]:
            _write_force_row(forces[k], rows[first[n]], wrenches[1, n])
            forces[k].reaction = _HOLDS_BEARING
            k += 1
    return forces


@helper
def _write_force_row(force, row, wrench):  # type: ignore[no-untyped-def]
    """Write a wrench on the tool of a SWEEP row into a FORCE row."""
    force.machine_id, force.tool = row.machine_id, row.tool
    force.x, force.y, force.z = wrench[0], wrench[1], wrench[2]
    force.fx, force.fy, force.fz = wrench[3], wrench[4], wrench[5]
    force.tx, force.ty, force.tz = wrench[6], wrench[7], wrench[8]
