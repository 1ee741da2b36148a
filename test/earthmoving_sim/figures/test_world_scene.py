"""A scene shows the world: terrain, particles, and machines where they are."""

import numpy as np
import pytest

from earthmoving_sim.figures.digging import dig_task, excavator_world
from earthmoving_sim.figures.operated_world import OperatedWorld, Script, load_spec
from msg_bridge.contract.grid import Grid

GRID = Grid(65, 65, 0.4)


@pytest.fixture
def world():
    spec = load_spec("excavator")
    made = OperatedWorld(GRID, np.zeros(GRID.shape), [(spec, (1.0, -2.0), 0.5)])
    yield made
    made.close()


def joint(world, name):
    return next(iter(world.scene.machines.values())).joints[name][0]


def test_machine_is_where_the_simulation_has_it(world):
    assert joint(world, "base_x") == pytest.approx(1.0, abs=0.01)
    assert joint(world, "base_y") == pytest.approx(-2.0, abs=0.01)
    assert joint(world, "base_yaw") == pytest.approx(0.5, abs=0.01)


def test_commanded_machine_moves_in_the_scene(world):
    spec = world.machine().machine.spec
    before = joint(world, "swing"), joint(world, "left_sprocket")
    world.operate(Script(spec, lambda now: {"swing": 0.4, "left": 0.5, "right": 0.5}))
    world.run_for(1.0)
    world.show()
    assert world.scene.time == pytest.approx(world.time)
    assert joint(world, "swing") > before[0] + 0.2
    assert joint(world, "left_sprocket") > before[1] + 0.5


def test_viewer_is_given_ten_states_in_a_second(world):
    times = []
    world.on_show(lambda: times.append(world.scene.time))
    world.run_for(1.0)
    assert 9 <= len(times) <= 10
    assert np.diff(times) == pytest.approx(0.1, abs=0.025)


def test_scene_shows_the_hole_and_the_particles_of_a_digging_machine():
    world = excavator_world(nominal_volume=10_000_000)
    dig_task(world, 1)
    world.run_until(lambda: world.machine().payload.fill > 0.3)
    world.show()
    shown = world.scene.terrain.tiles.layer("height")
    assert np.array_equal(shown, world.world.soil.columns.height.astype(np.float32))
    (cloud,) = world.scene.clouds.values()
    assert cloud.size == world.sim.particles.count > 10
    assert np.median(cloud["x"]) > world.machine().machine.base_pose[0][0] + 2.0
    world.close()
