"""Particles and tools that come and go while all moves: nothing is mixed up, nothing lost."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, box, engine, pose

from machine_sim.dem import ParticleEngine

STEPS = 160


class RandomScene:
    """A world where every few steps something is added, taken away, frozen or let go."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.world: ParticleEngine = engine(capacity=5_000)
        self.tools: dict[int, NDArray[np.float64]] = {}
        self.volume_mm3 = 0
        self.seen = 0

    def step(self, k: int) -> None:
        if k % 7 == 0:
            self.release(k)
        if k % 11 == 5 and self.world.count > 20:
            self.take(self.rng.choice(self.world.state.particle_id, 5, replace=False))
        if k % 23 == 3:
            self.world.freeze(self.world.state.particle_id[::40])
        if k % 23 == 13:
            self.world.unfreeze(self.world.state.particle_id[self.world.state.frozen])
        if k % 29 == 0:
            self.seen += 1
            self.tools[self.seen] = self.rng.uniform([-0.4, -0.4, 0.2, -0.4], [0.4, 0.4, 0.8, 0.4])
            self.world.add_tool(
                self.seen, box(0.8, 0.6, 0.5), self.pose(self.seen), is_digging=self.seen % 3 > 0
            )
        if k % 43 == 42:
            gone = int(self.rng.choice(list(self.tools)))
            self.world.remove_tool(gone)
            del self.tools[gone]
        self.move(k)
        self.world.step(STEP)

    def pose(self, tool: int):  # type: ignore[no-untyped-def]
        x, y, z, pitch = self.tools[tool]
        return pose(x, y, z, pitch)

    def move(self, k: int) -> None:
        for tool, at in self.tools.items():
            if (k // 20 + tool) % 3:
                start = self.pose(tool)
                at += [0.004 * np.cos(k / 15.0), 0.0, 0.002 * np.sin(k / 9.0), 0.008]
                self.world.set_tool_motion(tool, start, self.pose(tool))

    def release(self, k: int) -> None:
        """Some at random, some of them in one place, one exactly on an edge of a plate."""
        at = self.rng.uniform(
            [-0.5, -0.5, 0.3], [0.5, 0.5, 1.2], (int(self.rng.integers(3, 60)), 3)
        )
        at[:2] = at[0]
        for tool in list(self.tools)[:1]:
            turn, origin = self.pose(tool)
            at[2] = origin + turn @ [0.4, 0.1, 0.0]
        volume = self.rng.integers(LITRE // 30, LITRE // 2, len(at))
        self.world.add(at, self.rng.normal(size=at.shape), volume, grow=bool(k % 2))
        self.volume_mm3 += int(volume.sum())

    def take(self, ids: NDArray[np.uint32]) -> None:
        self.volume_mm3 -= int(self.world.state.volume_mm3[self.world.state.rows(ids)].sum())
        self.world.remove(ids)


def same(a: ParticleEngine, b: ParticleEngine) -> bool:
    return all(
        np.array_equal(getattr(a.state, name), getattr(b.state, name))
        for name in ("particle_id", "position", "velocity", "angular_velocity", "contact_radius")
    )


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_mixed_up(seed: int) -> None:
    one, two = RandomScene(seed), RandomScene(seed)
    most_tools = 0
    for k in range(STEPS):
        one.step(k)
        two.step(k)
        world, state = one.world, one.world.state
        for name in ("position", "velocity", "angular_velocity", "contact_radius"):
            assert np.isfinite(getattr(state, name)).all(), (k, name)
        for tool in one.tools:
            assert np.isfinite(np.concatenate(world.tool_wrench(tool))).all(), k
        assert state.rows(state.particle_id[::-1]).tolist() == list(range(world.count))[::-1]
        assert world.total_volume_mm3 == one.volume_mm3
        most_tools = max(most_tools, len(one.tools))
    assert same(one.world, two.world)
    assert world.count > 300
    assert most_tools >= 3
    assert world.num_ground_tunnellings == 0
