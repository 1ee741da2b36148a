"""What the soil does to the tools that sweep it: the sweeps of a tick, turned into wrenches.

- **Cut.** What resists the lip and the plate behind it (`soil_sim.force.cutting`), and the side of
  a tool that moves along its lip (`soil_sim.force.side`). The forces add up to a force and a torque
  about one point.
- **Milling.** What resists the picks of a drum that spins (`soil_sim.force.milling`).
- **Bearing.** Whether it cuts, presses or rests, soil under a tool bears it
  (`soil_sim.force.bearing`): this is what a machine leans on when the cut lifts its tracks, or when
  it stands on its bucket.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from msg_bridge.contract.rows import FORCE, Action, Holds, Rows, empty_rows, join_rows
from soil_sim.columns import Columns
from soil_sim.force.bearing import add_bearing
from soil_sim.force.cutting import add_lip
from soil_sim.force.milling import add_milling, add_standing, is_ring
from soil_sim.force.side import add_side
from soil_sim.force.strength import Strength, total_wrench
from soil_sim.soils import SoilType
from soil_sim.sweeps import first_of_tools

__all__ = ["Resistance", "no_resistance"]


class Resistance:
    """Wrenches of the soil on the tools that sweep it."""

    def __init__(self, columns: Columns, kinds: Sequence[SoilType]) -> None:
        """
        Args:
            columns: the terrain, read as it is when `wrenches` is called.
            kinds: the kinds of soil in it, by id.
        """
        self._columns = columns
        self._strength = Strength.of(kinds)
        grid = columns.grid
        self._frame = (grid.rows, grid.cols, grid.cell, grid.x_first, grid.y_first)

    def wrenches(self, sweeps: Rows) -> Rows:
        """FORCE rows of a tick: what resists the cut of each tool, then what bears some of them.

        Call it before the tick's cut. The point of application is the mean of where the forces act
        at the end of the tick, by their strength: of a level cut over the lip's middle, a third of
        the depth above it.

        Args:
            sweeps: sound SWEEP rows, by source and tool.
        """
        forces = no_resistance(sweeps)
        if forces.size == 0:
            return forces
        axes = [sweeps[name] for name in ("x0", "y0", "z0", "x1", "y1", "z1")]
        points = np.stack(axes, axis=-1).astype(np.float64).reshape(-1, 2, 3)
        found = _wrenches(
            points, first_of_tools(sweeps), sweeps["action"], self._columns.arrays, self._frame,
            self._strength,
        )  # fmt: skip
        milled = sweeps["action"][first_of_tools(sweeps)] == Action.MILL
        forces["holds"][milled] = Holds.MILL
        borne = np.flatnonzero(found[1, :, 3:6].any(axis=1))
        forces = join_rows([forces, forces[borne]], FORCE)
        forces["holds"][found.shape[1] :] = Holds.BEARING
        values = np.concatenate([found[0], found[1, borne]])
        for n, name in enumerate(("x", "y", "z", "fx", "fy", "fz", "tx", "ty", "tz")):
            forces[name] = values[:, n]
        return forces


def no_resistance(sweeps: Rows) -> Rows:
    """One FORCE row of zeros a tool, at its first key point: no force is said to be zero.

    Args:
        sweeps: sound SWEEP rows, by source and tool.
    """
    if sweeps.size == 0:  # as in ticks without a machine
        return empty_rows(FORCE)
    first = sweeps[first_of_tools(sweeps)]
    forces = empty_rows(FORCE, first.size)
    forces["source"], forces["tool"] = first["source"], first["tool"]
    forces["x"], forces["y"], forces["z"] = first["x1"], first["y1"], first["z1"]
    return forces


@njit(cache=True)
def _wrenches(  # type: ignore[no-untyped-def]
    points, first, action, columns, frame, strength
):
    """Point [m], force [N] and torque about the point [N m], shape (2, tools, 9).

    First of what resists the cut of each tool, then of what bears it.
    """
    out = np.zeros((2, first.size, 9))
    sums = np.empty(10)
    for n in range(first.size):
        end = first[n + 1] if n + 1 < first.size else len(points)
        own = points[first[n] : end]
        middle = 0.5 * (own[0, 1] + own[1, 1])
        out[:, n, :3] = middle
        # One pair alone is an edge without a plate, it has no rake; a plate alone that presses is a
        # track, which stands by itself.
        sums[:] = 0.0
        if action[first[n]] == Action.MILL:
            if len(own) >= 8:
                add_milling(own, middle, columns, frame, strength, sums)
                total_wrench(sums, middle, out[0, n])
            continue
        if is_ring(own):
            add_standing(own, middle, columns, frame, strength, sums)
            total_wrench(sums, middle, out[1, n])
            continue
        if len(own) < (4 if action[first[n]] == Action.CUT else 6):
            continue
        add_lip(own, middle, columns, frame, strength, sums)
        add_side(own, middle, columns, frame, strength, sums)
        total_wrench(sums, middle, out[0, n])
        sums[:] = 0.0
        add_bearing(own, middle, columns, frame, strength, sums)
        total_wrench(sums, middle, out[1, n])
    return out
