"""A film of a recording, drawn by a real browser."""

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from earthmoving_sim.cli import main

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

BAG = "bags/format_2"


def yellow_share(picture):
    """Return the share of pixels with the colour of the excavator's paint."""
    red, green, blue = picture.astype(int).transpose(2, 0, 1)
    return float(np.mean((red > 150) & (green > 100) & (blue < 0.55 * red) & (green < 0.95 * red)))


def test_film_of_a_recording_shows_the_machine_at_work(tmp_path, chromium, monkeypatch):
    monkeypatch.setenv("CHROMIUM", chromium)
    options = ["--size", "320x180", "--quality", "low", "--fps", "1", "--speed", "4"]
    folder = tmp_path / "frames"
    assert main(["film", BAG, "-o", str(folder), "--start", "12", "--end", "20", *options]) == 0
    paths = sorted(folder.iterdir())
    assert len(paths) == 3
    pictures = [np.asarray(Image.open(path)) for path in paths]
    assert {picture.shape for picture in pictures} == {(180, 320, 3)}
    for picture in pictures:
        assert 0.01 < yellow_share(picture) < 0.5
    for before, after in pairwise(pictures):
        # The arm moves, and the background does not.
        differs = np.abs(before.astype(int) - after.astype(int)).max(axis=2) > 40
        assert 0.002 < differs.mean() < 0.5
