"""Write an array of heights as a terrain file.

    python examples/own_terrain.py out/terrain.npz
    earthmoving demo --terrain out/terrain.npz

Row 0 of the array lies at the largest x and column 0 at the largest y, as in grid_map; rows run
toward -x and columns toward -y. The origin of the map frame is the middle of the map:

              +x
        (0,0) ^ (0,cols-1)
          +---|---+
          |   |   |
    +y <------o   |
          |       |
          +-------+
    (rows-1,0)  (rows-1,cols-1)
"""

import argparse
from pathlib import Path

import numpy as np

CELL = 0.2  # spacing of the points [m]
ROWS = COLS = 257


def heights() -> np.ndarray:
    """Return ground that rises gently toward +x, with a heap on the +y side [m], (rows, cols)."""
    half_x, half_y = 0.5 * (ROWS - 1) * CELL, 0.5 * (COLS - 1) * CELL
    x = np.linspace(half_x, -half_x, ROWS)[:, np.newaxis]  # of each row
    y = np.linspace(half_y, -half_y, COLS)[np.newaxis, :]  # of each column
    heap = np.maximum(1.5 - 0.5 * np.hypot(x - 5.0, y - 12.0), 0.0)
    return 0.05 * x + heap


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "path", nargs="?", type=Path, default=Path("out/terrain.npz"), help="file to write"
    )
    path = parser.parse_args().path
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, heights=heights(), cell=CELL)
    print(f"{path}: {ROWS} x {COLS} points, {CELL} m apart")


if __name__ == "__main__":
    main()
