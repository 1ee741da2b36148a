"""Piles of figure 5: round with a neighbourhood that is large enough."""

from earthmoving_sim.figures.piles import make_pile, measure_roundness


def test_pile_is_round_from_a_radius_of_2_3_cells_on():
    assert measure_roundness(make_pile(2.3)) < 1.1
    assert measure_roundness(make_pile(1.0)) > 1.3
