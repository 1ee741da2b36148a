"""Text in a picture."""

import numpy as np

from viewer.film.overlay import draw_overlay


def test_text_is_in_the_lower_left_corner_only():
    picture = np.full((180, 320, 3), 200, dtype=np.uint8)
    drawn = draw_overlay(picture, ["12.0 s", "load 80 %"])
    changed = np.argwhere((drawn != picture).any(axis=2))
    assert changed.size
    assert changed[:, 0].min() > 90
    assert changed[:, 1].max() < 160
    assert (picture == 200).all()


def test_without_text_the_picture_is_unchanged():
    picture = np.zeros((180, 320, 3), dtype=np.uint8)
    assert np.array_equal(draw_overlay(picture, []), picture)
