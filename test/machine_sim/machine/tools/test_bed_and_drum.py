"""Shapes of drums and beds: plates, capacities, key points, and invalid values."""

import math

import numpy as np
import pytest
from support.containers import rows_in_heap
from support.machine_scenes import load_shipped_machine

from machine_sim.machine import MachineError
from machine_sim.machine.tools.bed import BedShape
from machine_sim.machine.tools.drum import DrumShape

BED = BedShape(np.array([[-0.5, 0.5], [0.0, 0.0], [3.0, 0.0], [3.0, 1.0]]), 2.0)
DRUM = DrumShape(0.5, 0.4, 1.2, offset=0.1)


def test_bed_contains_points_below_its_opening():
    # The opening slopes from 1.0 m at the front to 0.5 m at the rear.
    area = 0.5 * (0.5 + 1.0) * 3.5 - 0.5 * 0.5 * 0.5
    assert BED.struck_capacity == pytest.approx(2.0 * area)
    # ISO 6483: a hip roof with slopes of 2:1 on an opening of 2 m by its length.
    length = math.hypot(3.5, 0.5)
    heap = 0.5 * 2.0**2 * (3.0 * length - 2.0) / 12.0
    assert BED.heaped_capacity == pytest.approx(BED.struck_capacity + heap)
    inside = BED.contains([[1.5, 0.0, 0.3], [1.5, 1.1, 0.3], [1.5, 0.0, -0.1], [1.5, 0.0, 1.0]])
    assert inside.tolist() == [True, False, False, False]
    assert rows_in_heap(BED, np.array([[1.5, 0.0, 1.0]])) == [0]
    assert BED.opening_normal[2] > 0.9


def test_bed_has_plates_for_floor_and_sides_only():
    plates = BED.plates()
    assert len(plates) == 3 + 2
    for plate in plates:
        assert (plate[:, 2] <= 1.0).all()


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        ([[3.0, 1.0], [3.0, 0.0], [0.0, 0.0], [-0.5, 0.5]], "counter-clockwise"),
        ([[0.0, 0.0], [1.0, 0.0]], "give 3 or more points"),
        ([[-0.5, math.nan], [0.0, 0.0], [3.0, 0.0], [3.0, 1.0]], "not finite"),
    ],
)
def test_invalid_bed_is_rejected(profile, words):
    with pytest.raises(MachineError, match=words):
        BedShape(np.array(profile), 2.0)


def test_key_points_are_pick_tips_on_one_closed_circle():
    points = DRUM.key_points.reshape(-1, 2, 3)
    np.testing.assert_allclose(np.hypot(points[..., 0], points[..., 2]), 0.5)
    np.testing.assert_allclose(points[:, 0, 1] - points[:, 1, 1], 1.2)
    np.testing.assert_allclose(points[..., 1].mean(), 0.1)
    np.testing.assert_array_equal(points[0], points[-1])


def test_plates_are_the_closed_envelope_of_the_tips():
    plates = DRUM.plates()
    for plate in plates:
        assert 3 <= len(plate) <= 8
        np.testing.assert_allclose(np.hypot(plate[:, 0], plate[:, 2]), 0.5)
    area = sum(_area(plate) for plate in plates)
    perimeter, end = 32 * 0.5 * math.sin(math.pi / 16), 8 * 0.25 * math.sin(math.pi / 8)
    assert area == pytest.approx(perimeter * 1.2 + 2.0 * end)


def _area(polygon):
    fans = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return 0.5 * float(np.linalg.norm(fans, axis=1).sum())


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_release_points_are_outside_the_tips_on_the_side_away_from_the_face(side):
    rng = np.random.default_rng(0)
    excavated = rng.uniform((0.2, -0.6, -0.5), (0.5, 0.6, 0.5), (200, 3))
    excavated[:, 0] *= side
    pitch = 0.4
    up = np.array([math.sin(pitch), 0.0, math.cos(pitch)])
    forward = np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
    released = DRUM.release_points(excavated, 0.02, up)
    np.testing.assert_allclose(np.hypot(released[:, 0], released[:, 2]), 0.52)
    assert (side * (released @ forward) < 0.0).all()
    assert (released @ up < 0.0).all()
    assert (np.abs(released[:, 1] - 0.1) <= 0.6).all()


def test_release_points_of_a_drum_with_vertical_axis_are_beside_it():
    released = DRUM.release_points([[0.1, 0.2, -0.2]], 0.02, np.array([0.0, 1.0, 0.0]))
    assert np.hypot(released[0, 0], released[0, 2]) == pytest.approx(0.52)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"body_radius": 0.6}, "0 < body_radius < radius"),
        ({"width": 0.0}, "drum.width is 0.0"),
        ({"vanes": 0}, "drum.vanes is 0"),
    ],
)
def test_invalid_drum_is_rejected(change, words):
    values = {"radius": 0.5, "body_radius": 0.4, "width": 1.2, **change}
    with pytest.raises(MachineError, match=words):
        DrumShape(**values)


def test_road_header_has_a_drum_and_dumper_a_bed():
    assert isinstance(load_shipped_machine("road_header").tools["head"].shape, DrumShape)
    bed = load_shipped_machine("dumper").tools["bed"].shape
    assert isinstance(bed, BedShape)
    assert 4.0 < bed.struck_capacity < 5.5
    with pytest.raises(MachineError, match="has no bucket"):
        _ = load_shipped_machine("dumper").bucket
