"""Answers of the soil that cannot be right are rejected as a whole, before any change."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine, machine_on_level_ground
from support.wire import raises

from machine_sim.simulation import MachineSim
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.rows import (
    CONVERSION,
    FORCE,
    MAP_UPDATE,
    ConversionKind,
    Rows,
    empty_rows,
)


class Answer(NamedTuple):
    """The rows of a valid answer, to be broken by a test.

    Row 0 of `conversions` is excavated soil at the lip, row 1 the deposit of a frozen particle.
    """

    conversions: Rows
    map_updates: Rows
    forces: Rows


@pytest.fixture(scope="module")
def sim() -> Iterator[MachineSim]:
    """Return an excavator with two particles, of which the deposit of the first is requested."""
    sim = machine_on_level_ground()
    sim.step()
    positions = [[8.0, 0.0, 1.0], [8.0, 1.0, 1.0]]
    ids = sim.particles.add(positions, np.zeros((2, 3)), [700, 800], [0, 0], [0, 0])
    sim.particles.freeze(ids[:1])
    yield sim
    sim.close()


@pytest.fixture
def answer(sim: MachineSim) -> Answer:
    conversions, map_updates = empty_rows(CONVERSION, 2), empty_rows(MAP_UPDATE, 1)
    lip = sim.tool_coupling.key_points_at(0)[0]
    conversions["x"], conversions["y"], conversions["z"] = lip
    conversions["row"] = conversions["col"] = 64
    conversions["volume_mm3"] = 5_000_000, 700
    conversions["kind"] = ConversionKind.EXCAVATE, ConversionKind.DEPOSIT
    conversions["particle_id"][1] = sim.particles.frozen_ids[0]
    return Answer(conversions, map_updates, empty_rows(FORCE, 1))


def break_field(rows: str, index: int, field: str, value: float) -> Callable[[Answer], None]:
    def break_answer(answer: Answer) -> None:
        getattr(answer, rows)[field][index] = value

    return break_answer


def unfrozen_particle(answer: Answer) -> None:
    answer.conversions["particle_id"][1] += 1
    answer.conversions["volume_mm3"][1] = 800


def repeated_particle(answer: Answer) -> None:
    answer.conversions[0] = answer.conversions[1]


def test_valid_answer_is_accepted(sim: MachineSim, answer: Answer) -> None:
    sim.check_answer(*answer)


@pytest.mark.parametrize(
    ("break_answer", "code"),
    [
        (break_field("map_updates", 0, "row", 129), ErrorCode.OFF_MAP),
        (break_field("map_updates", 0, "col", 2**32 - 1), ErrorCode.OFF_MAP),
        (break_field("map_updates", 0, "z", np.nan), ErrorCode.VALUE),
        (break_field("map_updates", 0, "z", 1e30), ErrorCode.VALUE),
        (break_field("map_updates", 0, "volume_mm3", np.inf), ErrorCode.VALUE),
        (break_field("map_updates", 0, "soil", 9), ErrorCode.VALUE),
        (break_field("map_updates", 0, "moisture", 101), ErrorCode.VALUE),
        (break_field("map_updates", 0, "rut_depth", -0.1), ErrorCode.VALUE),
        (break_field("map_updates", 0, "rut_depth", np.nan), ErrorCode.VALUE),
        (break_field("forces", 0, "fx", np.nan), ErrorCode.VALUE),
        (break_field("forces", 0, "tz", -np.inf), ErrorCode.VALUE),
        (break_field("forces", 0, "fz", 1e30), ErrorCode.VALUE),
        (break_field("forces", 0, "x", np.nan), ErrorCode.VALUE),
        (break_field("forces", 0, "tool", 9), ErrorCode.VALUE),
        (break_field("forces", 0, "reaction", 3), ErrorCode.VALUE),
        (break_field("forces", 0, "work", np.nan), ErrorCode.VALUE),
        (break_field("forces", 0, "work", -1.0), ErrorCode.VALUE),
        (break_field("conversions", 0, "kind", 4), ErrorCode.VALUE),
        (break_field("conversions", 0, "x", np.nan), ErrorCode.VALUE),
        (break_field("conversions", 0, "z", -np.inf), ErrorCode.VALUE),
        (break_field("conversions", 0, "soil", 9), ErrorCode.VALUE),
        (break_field("conversions", 0, "moisture", 200), ErrorCode.VALUE),
        (break_field("conversions", 0, "volume_mm3", 0), ErrorCode.VALUE),
        (break_field("conversions", 0, "row", 129), ErrorCode.OFF_MAP),
        (break_field("conversions", 0, "y", 20.0), ErrorCode.EXCAVATION),
        (break_field("conversions", 0, "volume_mm3", 2**32 - 1), ErrorCode.EXCAVATION),
        (break_field("conversions", 1, "particle_id", 12345), ErrorCode.PARTICLE),
        (break_field("conversions", 1, "volume_mm3", 701), ErrorCode.PARTICLE),
        (unfrozen_particle, ErrorCode.PARTICLE),
        (repeated_particle, ErrorCode.PARTICLE),
    ],
)
def test_invalid_answer_is_rejected(
    sim: MachineSim, answer: Answer, break_answer: Callable[[Answer], None], code: ErrorCode
) -> None:
    break_answer(answer)
    with raises(code):
        sim.check_answer(*answer)


def test_machine_without_a_digging_tool_is_credited_no_soil(answer: Answer) -> None:
    dumper = machine_on_level_ground(load_shipped_machine("dumper"))
    with raises(ErrorCode.EXCAVATION):
        dumper.check_answer(answer.conversions[:1], answer.map_updates, empty_rows(FORCE))
    dumper.close()
