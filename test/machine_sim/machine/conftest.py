"""Fixtures: one machine in a physics client on synthetic terrain."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine import MachineSpec, TrackedMachine, load_machine_spec
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil

MACHINE_FILE = Path(__file__).resolve().parents[3] / "config" / "machines" / "excavator.yaml"
DT = 0.005
FIRM = LooseSoil()


class Scene:
    """A physics client with one machine on a terrain z(x, y)."""

    def __init__(
        self,
        spec,
        surface=None,
        yaw=0.0,
        position=(0.0, 0.0),
        tracks="kinematic",
        dt=DT,
        soil=FIRM,
    ):
        self.dt = dt
        grid = Grid(257, 257, 0.1)
        x, y = np.meshgrid(grid.x(np.arange(257)), grid.y(np.arange(257)), indexing="ij")
        heights = np.zeros(grid.shape) if surface is None else surface(x, y)
        self.client = BulletClient(pybullet.DIRECT)
        self.client.setTimeStep(dt)
        self.client.setGravity(0.0, 0.0, -9.81)
        moisture = np.full(grid.shape, soil.moisture, dtype=np.uint8)
        self.ground = Ground(grid, heights, soils=[soil], moisture=moisture)
        self.machine = TrackedMachine(spec, self.client, self.ground, position, yaw, tracks)

    def step(self, pull=0.0):
        """Advance by one step; a force `pull` [N] acts toward -x of the map, at ground level."""
        self.machine.before_step(self.dt)
        if pull:
            point = self.machine.base_pose[0]
            com = self.client.getBasePositionAndOrientation(self.machine.body)[0]
            self.client.applyExternalForce(
                self.machine.body,
                -1,
                [-pull, 0.0, 0.0],
                [com[0], com[1], point[2]],
                pybullet.WORLD_FRAME,
            )
        self.client.stepSimulation()
        self.machine.after_step()

    def run(self, seconds, pull=0.0):
        """Advance by a time [s]."""
        for _ in range(round(seconds / self.dt)):
            self.step(pull)

    def lower_ground(self, depth):
        """Lower the whole terrain by a depth [m]."""
        rows, cols = np.indices(self.ground.grid.shape).reshape(2, -1)
        self.ground.set_heights(rows, cols, self.ground.elevation[rows, cols] - depth)

    @property
    def position(self):
        """Origin of the base frame [m], map frame."""
        return self.machine.base_pose[0]


@pytest.fixture(scope="session")
def spec() -> MachineSpec:
    return load_machine_spec(MACHINE_FILE)


@pytest.fixture
def scene(spec) -> Callable[..., Scene]:
    """Return a function that creates scenes; their clients are closed after the test."""
    scenes = []

    def make(surface=None, *, slope_deg=None, spec=spec, **options):
        if slope_deg is not None:
            gradient = math.tan(math.radians(slope_deg))

            def surface(x, y):
                return gradient * x

        scenes.append(Scene(options.pop("machine", spec), surface, **options))
        return scenes[-1]

    yield make
    for created in scenes:
        created.client.disconnect()
