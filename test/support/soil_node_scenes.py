"""Scenes of a soil node: without machines, excavated, on a site with layers or a design."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from msg_bridge.contract.grid import Grid
from msg_bridge.testing.ros_context import Ros
from soil_sim.terrain import HeightMap, Layers, save_terrain
from support.node_scenes import Scene, dig, machine_file, ready_to_dig

NO_MACHINES = {"sync": "realtime", "expected_machines": []}


def excavating_scene(ros: Ros, folder: Path, **parameters: object) -> Scene:
    """Return a scene whose machine has excavated soil."""
    scene = Scene(ros, **parameters)
    options = {"commands.command_timeout": 60.0, "machine": machine_file(folder, ready_to_dig())}
    machine = scene.machine(**options)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    return scene


def layered_site_parameters(folder: Path) -> dict[str, object]:
    """Return parameters of level ground: half of it clay, moisture [%] equal to the row."""
    grid = Grid(65, 65, 0.4)
    ids = np.zeros(grid.shape, dtype=np.uint8)
    ids[:, 30:] = 1
    moisture = np.repeat(np.arange(65, dtype=np.uint8)[:, None], 65, axis=1)
    path = folder / "site.npz"
    save_terrain(path, HeightMap(grid, np.zeros(grid.shape)), layers=Layers(ids, moisture))
    soils = {"soil.soil": "dry sand", "soil.additional_soils": ["dry clay"]}
    return {"site.terrain": str(path), **soils}


def write_pit_design(folder: Path) -> str:
    """Write a design with a pit of 0.5 m where the machine digs, NaN elsewhere; return its path."""
    heights = np.full((65, 65), np.nan)
    heights[8:48, 28:37] = -0.5
    np.save(folder / "design.npy", heights)
    return str(folder / "design.npy")
