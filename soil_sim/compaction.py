"""Compaction: tracks and the back of a bucket press soil down to the surface that they sweep.

- **Loose soil** yields as far as its bank volume.
- **Firm soil** yields to a pressure p only as far as it makes a plate of width b sink below the
  undisturbed surface (Bekker; Wong, Theory of Ground Vehicles, section 2.4),

      z = (p / (k_c / b + k_phi))^(1 / n),

  and is packed: see `soil_sim.columns.state`. A rut gets deeper only under a larger pressure. Soils
  without Bekker's coefficients do not yield.

No soil is removed, or displaced to the sides. A column counts as under a plate if its centre is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import MOISTURE_LEVELS
from msg_bridge.kernels import fixed_signature_kernel, helper
from soil_sim.columns.operations import compact_loose, pack_firm
from soil_sim.columns.state import Columns
from soil_sim.soils.soil_types import SoilType
from soil_sim.tool_sweeps import MachineSweeps, interpolate_key_point, pressed_pairs

__all__ = ["SINKAGE_DTYPE", "CompactedColumns", "compact", "sinkage_table", "sort_distinct"]

SINKAGE_DTYPE = np.dtype(
    [
        ("k_c", np.float64),  # Bekker's moduli of dry soil [N/m^(n + 1)], [N/m^(n + 2)]
        ("k_phi", np.float64),
        ("exponent", np.float64),  # n
        ("factor", np.float64, (MOISTURE_LEVELS,)),  # moduli over those of dry soil, by moisture
    ]
)
"""Coefficients of sinkage of one kind of soil."""

_MAX_POSES = 64
"""Maximum number of poses of a plate in a tick."""

_MIN_WIDTH = 0.01
"""Smallest width of a plate [m]."""

_MAX_GAP = 0.02
"""Largest gap below a plate that rests on a column [m]."""

_MIN_AREA = 1e-12
"""Smallest value of twice the area of a triangle, seen from above [m^2]."""


def sinkage_table(kinds: Sequence[SoilType]) -> NDArray[np.void]:
    """Return the coefficients of kinds of soil by id, shape (kinds,), `SINKAGE_DTYPE`."""
    table = np.zeros(len(kinds), SINKAGE_DTYPE)
    for row, kind in zip(table, kinds, strict=True):
        row["k_c"], row["k_phi"], row["exponent"] = (
            kind.bekker_k_c,
            kind.bekker_k_phi,
            kind.bekker_n,
        )
        soil = kind.loose_soil
        row["factor"] = [soil.moisture_bearing_factor(m) for m in range(MOISTURE_LEVELS)]
    return table


class CompactedColumns(NamedTuple):
    """Columns under the plates of a tick, by their flat indices.

    Attributes:
        yielded: those whose soil yielded, sorted.
        pressed: those that each tool rests on under pressure, sorted, by the id of the tool; tools
            without pressure are left out.
    """

    yielded: NDArray[np.int64]
    pressed: dict[int, NDArray[np.int64]]


_NOTHING_COMPACTED = CompactedColumns(np.zeros(0, np.int64), {})


def compact(columns: Columns, sweeps: MachineSweeps, sinkage: NDArray[np.void]) -> CompactedColumns:
    """Press soil down under the plates of a tick.

    Args:
        columns: the terrain; changed.
        sweeps: sweeps of one machine, of which some pairs may compact.
        sinkage: `sinkage_table` of the kinds of soil.
    """
    if not sweeps.compacts:
        return _NOTHING_COMPACTED
    tools = np.empty((sweeps.rows.size // 2, 2), np.int64)
    num_tools, num_yielded, cells = _compact(
        sweeps.rows, sweeps.points, columns.boxed_arrays, columns.frame, sinkage, tools
    )
    pressed = {}
    begin = num_yielded
    for tool, end in tools[:num_tools].tolist():
        pressed[tool] = cells[begin:end]
        begin = end
    return CompactedColumns(cells[:num_yielded], pressed)


@fixed_signature_kernel
def _compact(  # type: ignore[no-untyped-def]
    rows, key_points, boxed_columns, frame, sinkage, tools
):
    """Compact soil as `compact`.

    Args:
        rows, key_points: as of `MachineSweeps`.
        boxed_columns, frame: `ColumnArrays`, boxed, and `GridFrame` of the terrain; changed.
        sinkage: `sinkage_table` of the kinds of soil.
        tools: out, id of each tool with pressure, ascending, and the index after the last of its
            columns below; it has room for all pairs.

    Returns:
        (number of those tools, number of columns that yielded, flat indices of the columns that
        yielded, sorted, followed by those under each of these tools, sorted).
    """
    points, has_plate, pressure, tool = pressed_pairs(rows, key_points)
    columns = boxed_columns.table
    under, count = np.empty(64, dtype=np.int64), np.int64(0)
    first_under = np.empty(points.shape[0] + 1, dtype=np.int64)  # of each pair, among `under`
    for n in range(points.shape[0]):
        first_under[n] = count
        if not has_plate[n]:
            continue
        distance = 0.0
        for m in range(n, n + 2):
            for p in range(2):
                for axis in range(3):
                    distance = max(distance, abs(points[m, 1, p, axis] - points[m, 0, p, axis]))
        poses = min(max(1, int(np.ceil(2.0 * distance / frame.cell))), _MAX_POSES)
        width = _width(points, n)
        p_a, p_b, p_c, p_d = pressure[n, 0], pressure[n, 1], pressure[n + 1, 0], pressure[n + 1, 1]
        for pose in range(1, poses + 1):
            t = pose / poses
            # Left and right end of this pair, then of the next.
            a = interpolate_key_point(points, (n, 0), t)
            b = interpolate_key_point(points, (n, 1), t)
            c = interpolate_key_point(points, (n + 1, 0), t)
            d = interpolate_key_point(points, (n + 1, 1), t)
            for third, p_third in ((a, p_a), (d, p_d)):
                under, count = _compact_triangle(
                    (b, c, third), (p_b, p_c, p_third), width, columns, frame, sinkage, under, count
                )
    first_under[points.shape[0]] = count
    return _columns_under(under, first_under, pressure, tool, tools)


@helper(allocates=True)
def _columns_under(under, first_under, pressure, tool, tools):  # type: ignore[no-untyped-def]
    """Return the columns that yielded, and those under each tool with pressure, as `_compact`.

    Args:
        under: flat indices of the columns under plates, one for each triangle; that of a column
            that does not yield is inverted.
        first_under: index of the first column of each key-point pair, then the number of columns.
        pressure, tool: pressure [Pa] and tool of the pairs.
        tools: out, as of `_compact`.
    """
    num_pairs, count = tool.size, first_under[tool.size]
    cells = np.empty(2 * count, dtype=np.int64)
    num_yielded = 0
    for k in range(count):
        if under[k] >= 0:
            cells[num_yielded] = under[k]
            num_yielded += 1
    num_yielded = sort_distinct(cells, 0, num_yielded)
    num_tools, first, end = 0, 0, num_yielded
    while first < num_pairs:
        after, is_pressing = first, False
        while after < num_pairs and tool[after] == tool[first]:
            is_pressing = is_pressing or pressure[after, 0] > 0.0 or pressure[after, 1] > 0.0
            after += 1
        if is_pressing:
            begin = end
            for k in range(first_under[first], first_under[after]):
                cells[end] = ~under[k] if under[k] < 0 else under[k]
                end += 1
            end = sort_distinct(cells, begin, end)
            tools[num_tools, 0], tools[num_tools, 1] = tool[first], end
            num_tools += 1
        first = after
    return num_tools, num_yielded, cells


@helper(allocates=True)
def sort_distinct(cells, begin, end):  # type: ignore[no-untyped-def]
    """Sort the indices `begin` to `end`, and keep each once; return the index after the last."""
    if end - begin < 2:
        return end
    cells[begin:end].sort()
    last = begin
    for k in range(begin + 1, end):
        if cells[k] != cells[last]:
            last += 1
            cells[last] = cells[k]
    return last + 1


@helper
def _width(points, n):  # type: ignore[no-untyped-def]
    """Return the width of the plate between pair n and the next [m]: the mean of the pairs."""
    width = 0.0
    for m in range(n, n + 2):
        x = points[m, 1, 1, 0] - points[m, 1, 0, 0]
        y = points[m, 1, 1, 1] - points[m, 1, 0, 1]
        width += 0.5 * np.sqrt(x * x + y * y)
    return width


@helper(allocates=True)
def _compact_triangle(  # type: ignore[no-untyped-def]
    corners, pressures, width, columns, frame, sinkage, under, count
):
    """Compact the columns whose centre is under a triangle down to it, and record them.

    Args:
        corners: the three corners (x, y, z) [m].
        pressures: on the ground at the corners [Pa].
        width: width of the plate [m].
        columns: `ColumnArrays` of the terrain; changed.
        frame: `GridFrame` of the terrain.
        sinkage: `sinkage_table` of the kinds of soil.
        under: flat indices as of `_columns_under`, of which the first `count` are in use; changed.
        count: number of indices in use.

    Returns:
        (`under`, or a larger array in its place, number of indices in use).
    """
    a, b, c = corners
    area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    if abs(area) < _MIN_AREA:  # upright
        return under, count
    x0, x1 = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
    y0, y1 = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
    first_row = max(np.ceil((frame.x_first - x1) / frame.cell), 0.0)
    last_row = min(np.floor((frame.x_first - x0) / frame.cell), frame.rows - 1.0)
    first_col = max(np.ceil((frame.y_first - y1) / frame.cell), 0.0)
    last_col = min(np.floor((frame.y_first - y0) / frame.cell), frame.cols - 1.0)
    if last_row < first_row or last_col < first_col:
        return under, count
    for i in range(np.int64(first_row), np.int64(last_row) + 1):
        x = frame.x_first - i * frame.cell
        for j in range(np.int64(first_col), np.int64(last_col) + 1):
            y = frame.y_first - j * frame.cell
            # Barycentric coordinates of the centre of the column.
            u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
            v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
            if u < 0.0 or v < 0.0 or u + v > 1.0:
                continue
            k = i * frame.cols + j
            excess = columns.height[k] - (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]))
            p_a, p_b, p_c = pressures
            pressure = p_a + u * (p_b - p_a) + v * (p_c - p_a)
            has_yielded = excess > 0.0 and _press(
                columns, k, excess / columns.metres_per_mm3, pressure, width, sinkage
            )
            if not has_yielded and (pressure <= 0.0 or excess < -_MAX_GAP):
                continue
            if count == under.size:
                larger = np.empty(2 * count, dtype=np.int64)
                larger[:count] = under
                under = larger
            under[count] = k if has_yielded else ~k
            count += 1
    return under, count


@helper
def _press(columns, i, excess, pressure, width, sinkage):  # type: ignore[no-untyped-def]
    """Press the soil of column i down.

    Args:
        columns: `ColumnArrays` of the terrain; changed.
        i: flat index of the column.
        excess: volume above the plate [mm^3].
        pressure: of the plate on the ground [Pa].
        width: width of the plate [m].
        sinkage: `sinkage_table` of the kinds of soil.

    Returns:
        Whether it yielded.
    """
    # The kind at the surface, as machines find it on the map.
    kind, moisture = columns.soil[i], columns.moisture[i]
    if columns.loose[i] > 0:
        kind, moisture = columns.loose_soil[i], columns.loose_moisture[i]
    yielded = compact_loose(columns, i, excess)
    soil = sinkage[kind]
    modulus = (soil.k_c / max(width, _MIN_WIDTH) + soil.k_phi) * soil.factor[moisture]
    if pressure > 0.0 and modulus > 0.0 and yielded < excess:
        depth = (pressure / modulus) ** (1.0 / soil.exponent)
        rest = min(depth / columns.metres_per_mm3 - columns.rut_volume[i], excess - yielded)
        if rest > 0.0:
            yielded += pack_firm(columns, i, rest)
    return yielded > 0
