"""Particles and tools that are added and removed while all move: no mix-up, no loss of volume.

One of two equal scenes is saved and loaded now and then.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, box, engine, pose

from machine_sim.dem import ParticleEngine, Pose
from msg_bridge.checkpoint.state_pickle import dump_state, load_state

STEPS = 160


class RandomScene:
    """A scene in which particles and tools are added, removed, frozen or unfrozen at random."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.world: ParticleEngine = engine(capacity=5_000)
        self.tools: dict[int, NDArray[np.float64]] = {}
        self.volume_mm3 = 0
        self.num_tools_added = 0

    def step(self, k: int) -> None:
        world = self.world
        if k % 7 == 0:
            self.release(k)
        if k % 11 == 5 and world.count > 20:
            self.remove(self.rng.choice(world.ids, 5, replace=False))
        if k % 23 == 3:
            world.freeze(world.ids[::40])
        if k % 23 == 13:
            world.unfreeze(world.frozen_ids)
        if k % 29 == 0:
            self.num_tools_added += 1
            tool = self.num_tools_added
            self.tools[tool] = self.rng.uniform([-0.4, -0.4, 0.2, -0.4], [0.4, 0.4, 0.8, 0.4])
            world.add_tool(tool, box(0.8, 0.6, 0.5), self.pose(tool), is_digging=tool % 3 > 0)
        if k % 43 == 42:
            tool = int(self.rng.choice(list(self.tools)))
            world.remove_tool(tool)
            del self.tools[tool]
        self.move_tools(k)
        world.step(STEP)

    def pose(self, tool: int) -> Pose:
        return pose(*self.tools[tool])

    def move_tools(self, k: int) -> None:
        for tool, coordinates in self.tools.items():
            if (k // 20 + tool) % 3:
                start = self.pose(tool)
                coordinates += [0.004 * np.cos(k / 15.0), 0.0, 0.002 * np.sin(k / 9.0), 0.008]
                self.world.set_tool_motion(tool, start, self.pose(tool))

    def release(self, k: int) -> None:
        """Add particles at random, two of them coincident and one exactly on an edge of a plate."""
        count = int(self.rng.integers(3, 60))
        points = self.rng.uniform([-0.5, -0.5, 0.3], [0.5, 0.5, 1.2], (count, 3))
        points[:2] = points[0]
        for tool in list(self.tools)[:1]:
            rotation, origin = self.pose(tool)
            points[2] = origin + rotation @ [0.4, 0.1, 0.0]
        volume = self.rng.integers(LITRE // 30, LITRE // 2, count)
        self.world.add(points, self.rng.normal(size=points.shape), volume, grow=bool(k % 2))
        self.volume_mm3 += int(volume.sum())

    def remove(self, ids: NDArray[np.uint32]) -> None:
        self.volume_mm3 -= int(self.world.volumes_mm3[self.world.rows_of(ids)].sum())
        self.world.remove(ids)


def motion(world: ParticleEngine) -> tuple[NDArray[np.floating], ...]:
    """Return the arrays that describe the motion of the particles."""
    return world.positions, world.velocities, world.angular_velocities, world.contact_radii


@pytest.mark.parametrize("seed", range(3))
def test_ids_volume_and_repeatability_under_random_changes(seed: int) -> None:
    scene, twin = RandomScene(seed), RandomScene(seed)
    world, max_tools = scene.world, 0
    for k in range(STEPS):
        scene.step(k)
        twin.step(k)
        if k % 50 == 30:
            twin.world = load_state(dump_state(twin.world))
        assert all(np.isfinite(array).all() for array in motion(world)), k
        for tool in scene.tools:
            assert np.isfinite(np.concatenate(world.tool_wrench(tool))).all(), k
        assert world.rows_of(world.ids[::-1]).tolist() == list(range(world.count))[::-1]
        assert world.total_volume_mm3 == scene.volume_mm3
        max_tools = max(max_tools, len(scene.tools))
    np.testing.assert_array_equal(world.ids, twin.world.ids)
    for array, twin_array in zip(motion(world), motion(twin.world), strict=True):
        np.testing.assert_array_equal(array, twin_array)
    assert world.count > 300
    assert max_tools >= 3
    assert world.num_ground_tunnellings == 0
