"""A machine on a made-up ground, and a way to run it."""

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
    """One client with one machine on a terrain z(x, y)."""

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
        """One step; `pull` [N] drags backward on the map's x axis, on the ground."""
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
        for _ in range(round(seconds / self.dt)):
            self.step(pull)

    def dig(self, depth):
        rows, cols = np.indices(self.ground.grid.shape).reshape(2, -1)
        self.ground.set_heights(rows, cols, self.ground.elevation[rows, cols] - depth)

    @property
    def place(self):
        return self.machine.base_pose[0]


@pytest.fixture(scope="session")
def spec() -> MachineSpec:
    return load_machine_spec(MACHINE_FILE)


@pytest.fixture
def scene(spec) -> Callable[..., Scene]:
    """Make scenes; their clients are closed after the test."""
    made = []

    def make(surface=None, *, slope_deg=None, **options):
        if slope_deg is not None:
            rise = math.tan(math.radians(slope_deg))

            def surface(x, y):
                return rise * x

        made.append(Scene(spec, surface, **options))
        return made[-1]

    yield make
    for one in made:
        one.client.disconnect()
