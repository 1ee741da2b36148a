"""Times of a film's frames."""

from pathlib import Path

import pytest

from viewer.film.film import END, FilmRequest, frame_times
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


@pytest.mark.parametrize(("at", "time"), [(2.0, 2.0), (END, 7.5)])
def test_picture_has_one_frame_at_its_time_or_at_the_end_of_the_bag(at, time):
    request = FilmRequest(Path("bag"), Path("picture.png"), at=at)
    assert list(frame_times(request, 7.5)) == [time]


def test_picture_after_the_end_of_the_bag_is_rejected():
    with pytest.raises(RenderError, match=r"0 to 7\.50 s"):
        frame_times(FilmRequest(Path("bag"), Path("picture.png"), at=9.0), 7.5)


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
