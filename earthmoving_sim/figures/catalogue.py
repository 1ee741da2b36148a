"""All figures by number, in the groups that share a run."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from earthmoving_sim.figures import digging, machine_counts, piles, resolution
from earthmoving_sim.figures.figure import Figure
from earthmoving_sim.figures.studio import Studio
from msg_bridge.contract.errors import EarthmovingError

__all__ = ["GROUPS", "NUMBERS", "FigureGroup", "groups_of"]


class FigureGroup(NamedTuple):
    """Figures that are made together.

    Attributes:
        numbers: their numbers.
        make: makes them.
    """

    numbers: tuple[int, ...]
    make: Callable[[Studio], list[Figure]]


GROUPS = (
    FigureGroup((5,), piles.piles_at_a_point),
    FigureGroup((18,), digging.dig_a_hole),
    FigureGroup((19, 20), digging.pile_from_a_hole),
    FigureGroup((21,), digging.movement),
    FigureGroup((22,), machine_counts.road_header),
    FigureGroup((23, 24), resolution.resolutions),
    FigureGroup((25,), resolution.particle_counts),
    FigureGroup((26,), digging.full_bucket),
    FigureGroup((27,), machine_counts.road_header_counts),
    FigureGroup((28,), machine_counts.excavator_counts),
    FigureGroup((29, 30), digging.cab_and_smoke),
)

NUMBERS = tuple(number for group in GROUPS for number in group.numbers)


def groups_of(numbers: Collection[int]) -> list[FigureGroup]:
    """Return the groups that make some figures.

    Raises:
        EarthmovingError: there is no figure of a number.
    """
    unknown = sorted(set(numbers) - set(NUMBERS))
    if unknown:
        raise EarthmovingError(
            f"there is no figure {unknown[0]}; give some of {', '.join(map(str, NUMBERS))}"
        )
    return [group for group in GROUPS if set(group.numbers) & set(numbers)]
