"""Who rests on a tool: support is followed from contact to contact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LEVEL, STEP, square

from machine_sim.dem.contacts.ground_contacts import GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from machine_sim.dem.sleep.locked_load import trace_support
from machine_sim.dem.tools.rigid_tool import RigidTool, ToolSet

COUNT = 8
RADIUS = 0.05


def trace_supported_rows(
    pairs: NDArray[np.int64], *, on_plate: list[int], on_ground: list[int], sleep_ready: list[int]
) -> tuple[list[int], list[int]]:
    """A string of particles that touch their neighbours, on a plate or on the ground somewhere."""
    tools = ToolSet(4)
    tools.add(0, RigidTool([square(2.0)], (LEVEL, np.zeros(3))))
    tools.begin_step(STEP)
    position = np.zeros((COUNT, 3))
    position[:, 0], position[:, 2] = 2.0 * RADIUS * np.arange(COUNT), RADIUS
    tool_supported, otherwise_supported = np.zeros(COUNT, np.bool_), np.zeros(COUNT, np.bool_)
    trace_support(
        0, np.arange(COUNT), np.isin(np.arange(COUNT), sleep_ready), position,
        np.full(COUNT, RADIUS, np.float32), np.zeros(COUNT, np.int16), np.zeros(COUNT, np.bool_),
        PairContactBlocks(
            pairs[:, 0].astype(np.uint32), pairs[:, 1].astype(np.uint32),
            np.zeros((1, 1), np.float32), np.array([0]), np.array([len(pairs)]),
        ),
        PlateCandidates(np.array(on_plate), np.zeros(len(on_plate), np.int64)),
        GroundContacts(np.array(on_ground, np.int64), np.tile([0, 0, 1.0, 0], (len(on_ground), 1))),
        tools.motion, tool_supported, otherwise_supported,
    )  # fmt: skip
    return np.flatnonzero(tool_supported).tolist(), np.flatnonzero(otherwise_supported).tolist()


@pytest.mark.parametrize("seed", range(20))
def test_all_of_a_string_lean_on_what_one_leans_on(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = rng.permutation(np.stack([np.arange(COUNT - 1), np.arange(1, COUNT)], axis=1))
    pairs = np.where(rng.uniform(size=(COUNT - 1, 1)) < 0.5, pairs, pairs[:, ::-1])
    all_of_them = list(range(COUNT))
    for one in all_of_them:
        found = trace_supported_rows(pairs, on_plate=[one], on_ground=[], sleep_ready=all_of_them)
        assert found == (all_of_them, [])
        found = trace_supported_rows(pairs, on_plate=[0], on_ground=[one], sleep_ready=all_of_them)
        assert found == (all_of_them, all_of_them)


def test_one_that_is_not_calm_hands_nothing_on() -> None:
    pairs = np.stack([np.arange(COUNT - 1), np.arange(1, COUNT)], axis=1)
    sleep_ready = [0, 1, 2, 4, 5, 6, 7]
    assert trace_supported_rows(pairs, on_plate=[0], on_ground=[7], sleep_ready=sleep_ready) == (
        [0, 1, 2],
        [4, 5, 6, 7],
    )
