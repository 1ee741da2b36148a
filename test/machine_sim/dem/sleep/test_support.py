"""Support of particles at rest: it spreads from contact to contact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LEVEL, STEP, square

from machine_sim.dem.contacts.ground_contacts import GroundContacts
from machine_sim.dem.contacts.pair_contacts import PairContactBlocks
from machine_sim.dem.contacts.plate_contact_list import PlateCandidates
from machine_sim.dem.contacts.step_contacts import StepContacts
from machine_sim.dem.sleep.support import trace_support
from machine_sim.dem.state import ParticleState
from machine_sim.dem.tools import RigidTool, ToolSet

COUNT = 8
RADIUS = 0.05
ALL = list(range(COUNT))
CHAIN = np.stack([np.arange(COUNT - 1), np.arange(1, COUNT)], axis=1)
"""Pairs of a row of particles, each of which touches the next."""


def supported_rows(
    pairs: NDArray[np.int64], *, on_plate: list[int], on_ground: list[int], sleep_ready: list[int]
) -> tuple[list[int], list[int]]:
    """Return the rows of a chain supported by the tool, and those supported by the ground."""
    tools = ToolSet(4)
    tools.add(0, RigidTool([square(2.0)], (LEVEL, np.zeros(3))))
    tools.begin_step(STEP)
    position = np.zeros((COUNT, 3))
    position[:, 0], position[:, 2] = 2.0 * RADIUS * np.arange(COUNT), RADIUS
    state = ParticleState(COUNT)
    state.add(COUNT, position=position, radius=RADIUS, contact_radius=RADIUS)
    contacts = StepContacts(
        PairContactBlocks(
            pairs[:, 0].astype(np.uint32), pairs[:, 1].astype(np.uint32),
            np.zeros((1, 1), np.float32), np.array([0]), np.array([len(pairs)]),
        ),
        PlateCandidates(np.array(on_plate), np.zeros(len(on_plate), np.int64)),
        GroundContacts(
            np.array(on_ground, np.int64),
            np.tile([0, 0, 1.0, 0], (len(on_ground), 1)),
            np.zeros((len(on_ground), 3)),
        ),
    )  # fmt: skip
    on_tool, on_other = np.zeros(COUNT, np.bool_), np.zeros(COUNT, np.bool_)
    trace_support(
        0, np.arange(COUNT), np.isin(ALL, sleep_ready), state.columns, contacts,
        tools.motion, on_tool, on_other,
    )  # fmt: skip
    return np.flatnonzero(on_tool).tolist(), np.flatnonzero(on_other).tolist()


@pytest.mark.parametrize("seed", range(20))
def test_support_of_one_particle_reaches_all_of_a_chain(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = rng.permutation(CHAIN)
    pairs = np.where(rng.uniform(size=(COUNT - 1, 1)) < 0.5, pairs, pairs[:, ::-1])
    for row in ALL:
        found = supported_rows(pairs, on_plate=[row], on_ground=[], sleep_ready=ALL)
        assert found == (ALL, [])
        found = supported_rows(pairs, on_plate=[0], on_ground=[row], sleep_ready=ALL)
        assert found == (ALL, ALL)


def test_moving_particle_gives_no_support() -> None:
    sleep_ready = [0, 1, 2, 4, 5, 6, 7]
    found = supported_rows(CHAIN, on_plate=[0], on_ground=[7], sleep_ready=sleep_ready)
    assert found == ([0, 1, 2], [4, 5, 6, 7])
