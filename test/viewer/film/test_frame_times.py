"""Times of a film's frames."""

import pytest

from viewer.film.frame_times import FrameTimes
from viewer.rendering.errors import RenderError


def test_film_at_double_speed_shows_two_seconds_in_one():
    times = list(FrameTimes(1.0, 3.0, rate=25.0, speed=2.0))
    assert len(times) == 26
    assert times[:2] == pytest.approx([1.0, 1.08])
    assert times[-1] == pytest.approx(3.0)


def test_last_frame_is_not_after_the_end():
    assert list(FrameTimes(0.0, 0.99, rate=10.0)) == pytest.approx([0.1 * k for k in range(10)])


def test_film_without_duration_has_one_frame():
    assert list(FrameTimes(4.0, 4.0)) == [4.0]


@pytest.mark.parametrize(
    "values",
    [
        {"start": 3.0, "end": 2.0},
        {"start": 0.0, "end": float("inf")},
        {"start": 0.0, "end": 1.0, "rate": 0.0},
        {"start": 0.0, "end": 1.0, "speed": -1.0},
        {"start": 0.0, "end": 1e9},
    ],
)
def test_film_that_cannot_be_made_is_rejected(values):
    with pytest.raises(RenderError):
        FrameTimes(**values)
